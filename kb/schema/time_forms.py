"""The form of what files say about times: windows between events, and calendars."""

from pydantic import Field

from cellwright.kb.schema.form_base import Expression, Names, Strict, Truth, WholeNumber


class WindowEntry(Strict):
    """A window of time for some objects, or with a price."""

    keep: str = Field(
        description="the window: at most 10 min from stopped(P) to read(P); or at least 5 min, or "
        "exactly 60 min, up to 63"
    )
    for_: dict[str, Names] = Field(
        default_factory=dict,
        alias="for",
        description="variable: objects; the window is about these alone",
    )
    price: WholeNumber | None = Field(
        None,
        ge=0,
        description="what each unit of time costs by which the window is broken; without a price "
        "it is never broken",
    )


class CalendarEntry(Strict):
    """When a resource may be held, or steps may be done."""

    of: Expression = Field(description="a resource, such as operator; or steps, such as load(_, _)")
    open: str | None = Field(None, description="when: 8 h to 17 h; or several such, with commas")
    closed: str | None = Field(None, description="when not, in place of `open`")
    every: str | None = Field(
        None, description="after which time all this comes again, such as 24 h; never if left out"
    )
    begins: str | None = Field(
        None, description="what the calendar says when the plan begins: 7:30; 0 if left out"
    )
    starts: Truth = Field(
        False, description="true: steps have to start in these times, and may end later"
    )


WINDOWS_ABOUT = (
    "times between two events that a plan keeps: at most 10 min from stopped(P) to read(P)"
)
CALENDARS_ABOUT = "when resources may be held, and steps done"
