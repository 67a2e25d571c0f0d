"""The shape of a problem file."""

from pydantic import Field

from kb.schema.shapes import Expression, Facts, Names, Strict, Truth


class WorkflowEntry(Strict):
    """Ordered stages for each binding of `for`."""

    name: str | None = Field(None, description="what `after` calls this entry; its number when left out")
    for_: dict[str, Names] = Field(
        default_factory=dict, alias="for", description="variable: objects; one chain per combination"
    )
    subject: str | None = Field(None, description="the object whose history this is, when there is no `for`")
    stages: Expression = Field(description="events and fluents in their order: heated(P, 15 min), stored(P)")
    after: list[str] = Field(default_factory=list, description="names of workflow entries that come first")


class ProblemFile(Strict):
    """A file in `problems/`: one task in a cell."""

    problem: str = Field(min_length=1, description="the problem's name")
    domain: str = Field(description="the domain around this file, a bundled one, or a path")
    objects: dict[str, Names] = Field(default_factory=dict, description="type: objects beside the domain's")
    statics: Facts = Field(default_factory=list, description="static facts of this problem")
    initial: Facts = Field(
        default_factory=list, description="fluents true at the start; deduction and defaults complete them"
    )
    complete: Truth = Field(False, description="`initial` is the whole state: no defaults, no deduction")
    goals: list[Expression] = Field(
        default_factory=list, description="what must hold at the end; `_` means some"
    )
    workflow: list[WorkflowEntry] = Field(default_factory=list, description="what must be reached in order")
    command: str | None = Field(None, description="a command in words, instead of goals and workflow")
