"""The shape of the files, as pydantic models; exported as JSON Schema for editors. ASP inside strings is not read here."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Expression = Annotated[str, Field(description="atoms, terms and constraints, written as in ASP")]
Names = Annotated[list[str], Field(description="names, or ranges such as depot_1..4")]


def _or_empty(value: Any) -> Any:
    return {} if value is None else value


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StaticEntry(_Strict):
    """A static or derived predicate has no attributes: write `{}`."""


class FluentEntry(_Strict):
    """A fluent or event."""

    weight: int | None = Field(None, ge=0, description="criticality: heavier goals are worked on first")


class CommandEntry(_Strict):
    """What the executive sends, and the reply it expects."""

    stream: Expression
    reply: Expression = "done"
    result: Expression | None = None


class EffectEntry(_Strict):
    """A conditional effect; variables that are not in the header range over all values."""

    when: Expression
    adds: Expression | None = None
    deletes: Expression | None = None


class OperatorEntry(_Strict):
    """A static operator."""

    types: dict[str, str] = Field(default_factory=dict, description="narrows the inferred type of a variable")
    where: Expression | None = Field(None, description="constraints over statics: an ASP body")
    preconditions: Expression | None = None
    adds: Expression | None = None
    deletes: Expression | None = Field(None, description="explicit deletes; add after delete")
    effects: list[EffectEntry] = Field(default_factory=list)
    resources: Expression | None = Field(None, description="what the step holds while it lasts")
    duration: str | int | None = Field(
        None, description="a number with a unit, such as 15 min, or a variable"
    )
    cost: str | int | None = Field(None, description="a number or a variable; 1 unless given")
    command: CommandEntry | None = None


class DeductiveEntry(_Strict):
    """What a new (or, with `not`, a denied) fact implies and denies."""

    when: Expression
    types: dict[str, str] = Field(default_factory=dict)
    where: Expression | None = None
    implies: Expression | None = None
    denies: Expression | None = None


class PhraseEntry(_Strict):
    """A sentence pattern, and the goal or workflow stage it stands for."""

    say: str
    goal: Expression | None = None
    stage: Expression | None = None


class CommandsEntry(_Strict):
    """The words and phrases of commands in words."""

    words: dict[str, list[str]] = Field(default_factory=dict)
    phrases: list[PhraseEntry] = Field(default_factory=list)


StaticEntries = dict[str, Annotated[StaticEntry, BeforeValidator(_or_empty)]]
FluentEntries = dict[str, Annotated[FluentEntry, BeforeValidator(_or_empty)]]
Operators = dict[str, Annotated[OperatorEntry, BeforeValidator(_or_empty)]]


class DomainFile(_Strict):
    """A `domain.yaml`."""

    domain: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the domain's name")
    include: list[str] = Field(default_factory=list, description="ASP files beside this one")
    units: dict[str, str] = Field(default_factory=dict, description="time: ms, s, min or h")
    types: dict[str, str | list[str]] = Field(
        default_factory=dict, description="name: parent, or a closed list"
    )
    functions: dict[str, str] = Field(
        default_factory=dict, description="compound terms: meas(measurement): place"
    )
    objects: dict[str, Names] = Field(default_factory=dict, description="type: what every problem has")
    statics: StaticEntries = Field(default_factory=dict)
    derived: StaticEntries = Field(default_factory=dict)
    fluents: FluentEntries = Field(default_factory=dict)
    events: FluentEntries = Field(default_factory=dict)
    defaults: list[Expression] = Field(default_factory=list)
    operators: Operators = Field(default_factory=dict)
    deductive_operators: list[DeductiveEntry] = Field(default_factory=list)
    commands: CommandsEntry = Field(default_factory=lambda: CommandsEntry())


class WorkflowEntry(_Strict):
    """Ordered stages for each binding of `for`."""

    name: str | None = None
    for_: dict[str, Names] = Field(default_factory=dict, alias="for")
    subject: str | None = Field(None, description="the object whose history this is, when there is no `for`")
    stages: Expression
    after: list[str] = Field(default_factory=list, description="names of workflow entries that come first")


class ProblemFile(_Strict):
    """A file in `problems/`."""

    problem: str
    domain: str
    objects: dict[str, Names] = Field(default_factory=dict)
    statics: list[Expression] = Field(default_factory=list)
    initial: list[Expression] = Field(default_factory=list)
    complete: bool = Field(False, description="initial is the whole state: no defaults, no deduction")
    goals: list[Expression] = Field(default_factory=list)
    workflow: list[WorkflowEntry] = Field(default_factory=list)
    command: str | None = Field(None, description="a command in words, instead of goals and workflow")


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of file: `domain`, `problem` or `plan`."""
    from kb.schema.plan import PlanFile  # it builds on the shapes above

    files: dict[str, type[BaseModel]] = {"domain": DomainFile, "problem": ProblemFile, "plan": PlanFile}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **files[kind].model_json_schema(by_alias=True),
    }
