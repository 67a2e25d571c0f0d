"""The form of a problem file: objects, facts, goals and workflow."""

from pydantic import Field

from cellwright.kb.schema.form_base import Expression, Facts, Names, Strict, Truth, WholeNumber
from cellwright.kb.schema.time_forms import (
    CALENDARS_ABOUT,
    WINDOWS_ABOUT,
    CalendarEntry,
    WindowEntry,
)


class WorkflowEntry(Strict):
    """Ordered stages for each binding of `for`."""

    name: str | None = Field(
        None, description="the name of this entry for `after`; its number if left out"
    )
    for_: dict[str, Names] = Field(
        default_factory=dict,
        alias="for",
        description="variable: objects; one chain per combination",
    )
    subject: str | None = Field(
        None, description="the object that this history belongs to, if there is no `for`"
    )
    stages: Expression = Field(
        description="events and fluents in their order: heated(P, 15 min), stored(P)"
    )
    after: list[str] = Field(
        default_factory=list, description="names of workflow entries that must be finished first"
    )


class ProblemFile(Strict):
    """A file in `problems/`: one task in a cell."""

    problem: str = Field(min_length=1, description="the problem's name")
    domain: str = Field(
        description="the domain beside this file or in the folder above, a bundled domain, or a "
        "path"
    )
    objects: dict[str, Names] = Field(
        default_factory=dict, description="type: objects in addition to those of the domain"
    )
    statics: Facts = Field(default_factory=list, description="static facts of this problem")
    durations: dict[Expression, WholeNumber] = Field(
        default_factory=dict,
        description="how long a step lasts, such as pick(bolt, table): 7, in place of what its "
        "operator "
        "says",
    )
    initial: Facts = Field(
        default_factory=list,
        description="fluents that are true at the start; deduction and defaults add more",
    )
    complete: Truth = Field(
        False, description="`initial` is the whole state, without defaults and deduction"
    )
    goals: list[Expression] = Field(
        default_factory=list, description="what must hold at the end; `_` means some value"
    )
    workflow: list[WorkflowEntry] = Field(
        default_factory=list, description="stages that must be reached in order"
    )
    windows: list[str | WindowEntry] = Field(default_factory=list, description=WINDOWS_ABOUT)
    calendars: list[CalendarEntry] = Field(default_factory=list, description=CALENDARS_ABOUT)
    command: str | None = Field(
        None, description="a command in words, instead of goals and workflow"
    )
