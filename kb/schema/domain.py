"""The form of `domain.yaml`: what a domain file may contain."""

from typing import Literal, get_args

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME
from cellwright.kb.schema.form_base import (
    Expression,
    Names,
    Strict,
    Truth,
    VariableTypes,
    WholeNumber,
)
from cellwright.kb.schema.time_forms import (
    CALENDARS_ABOUT,
    WINDOWS_ABOUT,
    CalendarEntry,
    WindowEntry,
)


class StaticEntry(Strict):
    """A static or derived predicate has no attributes: write `{}`."""


class FluentEntry(Strict):
    """A fluent or an event."""

    weight: WholeNumber | None = Field(
        None,
        ge=0,
        description="criticality: goals of greater weight are worked on first; computed if left "
        "out",
    )


class UnitsEntry(Strict):
    """The units of numbers."""

    time: Literal["ms", "s", "min", "h"] = Field(
        "s", description="the unit of numbers of type `time`"
    )


class MotionEntry(Strict):
    """How long it takes from place to place, along straight lines."""

    speed: str | int = Field(description="of the arm along the line: 250 mm/s, 0.2 m/s, 12 m/min")
    settling: str | int | None = Field(
        None,
        description="time to start and to stop, for every way between two different places; 0 if "
        "left "
        "out",
    )
    frame: str = Field(
        "world",
        description="the frame of the cell in which the positions of facts are; the places follow "
        "it",
    )


class TimeoutsEntry(Strict):
    """After how long without a reply commands are given up, where nothing else says so."""

    factor: str | int | None = Field(
        None, description="so many times the forecast: 1.5; 2 if left out"
    )
    floor: str | int | None = Field(
        None, description="and never sooner than this: 1 min; 30 s if left out"
    )


class MeasuresEntry(Strict):
    """What a step measures: of what, in which unit, and between which limits it must be."""

    of: Expression = Field(description="what is measured: Id, or a name")
    value: Expression = Field(description="the variable of the reply that holds the value")
    unit: str = Field(description="the unit of all numbers here: um, mm, g, degC, ...")
    quantity: str | None = Field(
        None,
        pattern=r"^[a-z][A-Za-z0-9_]*$",
        description="which quantity: thickness; else the operator",
    )
    by: Expression | None = Field(None, description="the tool that measures")
    nominal: str | int | None = Field(
        None,
        description="what the value should be: a number, nominal(Id), a variable, or arithmetic",
    )
    tolerance: str | int | None = Field(
        None,
        description="how wide the zone around the nominal value is in which the value must lie",
    )
    lower: str | int | None = Field(
        None, description="the least value that passes, in place of a tolerance"
    )
    upper: str | int | None = Field(
        None, description="the greatest value that passes, in place of a tolerance"
    )
    uncertainty: str | int | None = Field(
        None,
        description="the expanded uncertainty of a value, two standard deviations: a number, "
        "accuracy(Tool), arithmetic",
    )
    risk: str | int | None = Field(
        None,
        description="how many percent of the decisions may be wrong; 5 if there is an uncertainty",
    )
    usual: str | int | None = Field(
        None,
        description="about what a value is where no nominal value is known: a simulated part gives "
        "it; "
        "nothing is judged by it",
    )
    worth: str | int | None = Field(
        None,
        description="how long further measurements may take for one decision: 2 min; 0 if left out",
    )


class CommandEntry(Strict):
    """The command that the executive sends for a step, and the expected reply."""

    stream: Expression = Field(
        description="the receiver of the command, with the command and its arguments: "
        "arm(pick(Item, "
        "Place))"
    )
    reply: Expression = Field(
        "done", description="the pattern of a successful reply, which binds the variables in it"
    )
    result: Expression | None = Field(
        None, description="the fact that follows from a reply: reads(Sensor, Value)"
    )
    measures: MeasuresEntry | None = Field(
        None, description="the quantity that the reply tells, with its nominal value and its limits"
    )


class OnlineEntry(Strict):
    """A condition that is looked at in the cell itself when a step is carried out, not in the
    model.
    """

    fact: Expression = Field(
        description="what has to be so when the step begins: a joint state, a reading: "
        "shows(grip_width, on_probe)"
    )
    during: Truth = Field(False, description="true: it has to stay so until the step ends")


class EffectEntry(Strict):
    """A conditional effect; variables that are not in the header range over all values."""

    when: Expression = Field(description="what must hold before the step")
    adds: Expression | None = Field(None, description="what becomes true, if `when` held")
    deletes: Expression | None = Field(
        None, description="what becomes false, if `when` held; deletes come before adds"
    )


class VaryingDurationEntry(Strict):
    """A duration that nobody decides: a range, a spread, or both."""

    least: str | int | None = Field(None, alias="from", description="the least duration; with `to`")
    most: str | int | None = Field(None, alias="to", description="the greatest duration")
    usual: str | int | None = Field(
        None, description="what is planned with; the middle of the range if left out"
    )
    spread: str | int | None = Field(
        None,
        description="the standard deviation; without a range, the step lasts its usual duration "
        "and three times the spread less or more",
    )


class OperatorEntry(Strict):
    """A static operator: the key is its header, name(Variable, ...)."""

    types: VariableTypes = Field(default_factory=dict)
    where: Expression | None = Field(
        None,
        description="constraints over statics: an ASP body; variables outside the header are "
        "existential",
    )
    preconditions: Expression | None = Field(
        None, description="what must hold while the step lasts"
    )
    adds: Expression | None = Field(
        None, description="what becomes true at its end; deductive operators add the consequences"
    )
    deletes: Expression | None = Field(
        None, description="explicit deletes; deletes come before adds"
    )
    effects: list[EffectEntry] = Field(default_factory=list, description="conditional effects")
    increase: dict[str, str | int] = Field(
        default_factory=dict, description="by how much quantities rise: volume(Bottle): Amount"
    )
    decrease: dict[str, str | int] = Field(
        default_factory=dict, description="by how much quantities fall: volume(Bottle): Amount"
    )
    assign: dict[str, str | int] = Field(
        default_factory=dict, description="what quantities become: volume(Bottle): 5000"
    )
    resources: Expression | None = Field(
        None,
        description="what the step occupies while it lasts: steps with a common resource never "
        "overlap",
    )
    duration: str | int | VaryingDurationEntry | None = Field(
        None,
        description="a number with a unit, such as 15 min, a variable, travel(From, To), or "
        "arithmetic; 0 when left out; or a range, `{from: 60 s, to: 90 s}`, for what nobody "
        "decides",
    )
    cost: str | int | None = Field(
        None,
        description="a number, a variable, a static such as weight(Tool), or arithmetic; 1 when "
        "left "
        "out",
    )
    timeout: str | int | None = Field(
        None,
        description="after how long without a reply a step is given up: like `duration`; if left "
        "out, what `timeouts` says",
    )
    command: CommandEntry | None = Field(None, description="the command that the executive sends")
    online: list[OnlineEntry] = Field(
        default_factory=list,
        description="what is looked at in the cell when a step begins, and while it lasts",
    )


class DeductiveEntry(Strict):
    """The facts that a new fact (or, with `not`, a denied fact) implies and denies."""

    when: Expression = Field(
        description="one atom that is added; or `not` and an atom that is denied"
    )
    types: VariableTypes = Field(default_factory=dict)
    where: Expression | None = Field(None, description="constraints over statics: an ASP body")
    implies: Expression | None = Field(
        None, description="what is also added: atom, body; atom, body"
    )
    denies: Expression | None = Field(
        None, description="what is denied, for every matching atom: atom, body; atom, body"
    )


class PhraseEntry(Strict):
    """A sentence pattern, and the goal or workflow stage that it means."""

    say: str = Field(description="words, {Variable:type}, (either|or), [optional]")
    goal: Expression | None = Field(None, description="the goal, if the order does not matter")
    stage: Expression | None = Field(
        None, description="a stage of a workflow, or several; `&` between what is reached together"
    )
    subject: str | None = Field(
        None,
        description="the slot whose object the act is about; without it, the first slot in the "
        "pattern",
    )


class CommandsEntry(Strict):
    """The words and phrases of commands in words."""

    words: dict[str, list[str]] = Field(
        default_factory=dict,
        description="the words that people use for the objects of a type, or for one object",
    )
    phrases: list[PhraseEntry] = Field(
        default_factory=list, description="sentence patterns and their meaning"
    )


_ROLES: JsonDict = {
    role: {
        "type": "string",
        "description": f"what this domain calls {convention.written()}: {convention.meaning}",
    }
    for role, convention in CONVENTION_BY_NAME.items()
}


ToolName = Literal["sequencer", "library", "planner", "scheduler", "diagnosis"]


class UseEntry(BaseModel):
    """How a device is used: which one, if it is not called as the use is, and what its
    parameters are.
    """

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)

    device: str | None = Field(
        None, description="the device; left out, the one with the name of the use"
    )


class Sections(Strict):
    """What a domain and a device both may say."""

    use: dict[str, UseEntry | None] = Field(
        default_factory=dict,
        description="devices, each under its name in this cell, with their parameters",
    )
    include: list[str] = Field(
        default_factory=list, description="ASP files beside this one: facts and rules"
    )
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(time="s"), description="the units of numbers"
    )
    types: dict[str, str | list[str]] = Field(
        default_factory=dict,
        description="name: parent; or a closed list of constants; `term` for a type built by "
        "functions",
    )
    functions: dict[str, str] = Field(
        default_factory=dict,
        description="typed compound terms: `meas(measurement): place`; never recursive",
    )
    objects: dict[str, Names] = Field(
        default_factory=dict, description="type: objects that every problem of this domain has"
    )
    statics: dict[str, StaticEntry | None] = Field(
        default_factory=dict,
        description="predicates that never change: facts of `.lp` files and problems",
    )
    derived: dict[str, StaticEntry | None] = Field(
        default_factory=dict, description="predicates that rules in `.lp` files define"
    )
    fluents: dict[str, FluentEntry | None] = Field(
        default_factory=dict, description="predicates that operators change"
    )
    events: dict[str, FluentEntry | None] = Field(
        default_factory=dict,
        description="facts that form a history: they are added once per workflow stage and never "
        "denied",
    )
    quantities: dict[str, str] = Field(
        default_factory=dict,
        description="whole numbers that operators change, with their least and greatest value: "
        "volume(bottle): 0..5000",
    )
    defaults: list[Expression] = Field(
        default_factory=list,
        description="facts that are true at the start, added in this order, unless an earlier fact "
        "denies them",
    )
    operators: dict[str, OperatorEntry | None] = Field(
        default_factory=dict, description="the possible steps: name(Variable, ...)"
    )
    deductive_operators: list[DeductiveEntry] = Field(
        default_factory=list,
        description="what a new fact implies and denies, instead of delete lists",
    )
    conventions: dict[str, str] = Field(
        default_factory=dict,
        description="names that the engine knows: what this domain calls them, where it is another "
        "name",
        json_schema_extra={"properties": _ROLES, "additionalProperties": False},
    )
    tools: list[ToolName] = Field(
        default_factory=lambda: list(get_args(ToolName)),
        description="what a run plans with: of those that give the same, the first that serves; "
        "all "
        "of "
        "them if left out",
    )
    motion: MotionEntry | None = Field(
        None, description="how an arm moves between places: what durations call travel(From, To)"
    )
    timeouts: TimeoutsEntry | None = Field(
        None, description="after how long without a reply commands are given up"
    )
    windows: list[str | WindowEntry] = Field(default_factory=list, description=WINDOWS_ABOUT)
    calendars: list[CalendarEntry] = Field(default_factory=list, description=CALENDARS_ABOUT)
    commands: CommandsEntry = Field(
        default_factory=lambda: CommandsEntry(), description="words and phrases that people use"
    )


class DomainFile(Sections):
    """A `domain.yaml`: one kind of cell."""

    domain: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the domain's name")
    without: list[str] = Field(
        default_factory=list, description="operators of the devices that this domain leaves out"
    )
