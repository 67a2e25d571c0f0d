"""Events that happen to the executive, and the actions that it wants done."""

from dataclasses import dataclass

from cellwright.engine.stages.execution.activity_program import Dwell


@dataclass(frozen=True, slots=True)
class Began:
    """The program may begin."""


@dataclass(frozen=True, slots=True)
class TimePassed:
    """Time has passed."""


@dataclass(frozen=True, slots=True)
class Replied:
    """A command got its normal reply."""

    number: int


@dataclass(frozen=True, slots=True)
class CommandFailed:
    """A command got another reply than a normal one; `reply` is its text."""

    number: int
    reply: str


@dataclass(frozen=True, slots=True)
class Withdrawn:
    """Commands were taken back before they began."""

    numbers: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Interrupted:
    """The run shall pause at the end of the current goal."""


@dataclass(frozen=True, slots=True)
class Continued:
    """The run shall go on."""


@dataclass(frozen=True, slots=True)
class StopCommanded:
    """The run shall stop at once."""


Event = (
    Began
    | TimePassed
    | Replied
    | CommandFailed
    | Withdrawn
    | Interrupted
    | Continued
    | StopCommanded
)


@dataclass(frozen=True, slots=True)
class Dispatch:
    """Send a command: for an activity, or a WAIT (`activity` None), or the CONTINUE for the
    WAIT `about`.
    """

    number: int
    activity: int | None = None
    stream: str = ""
    about: int | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """An activity has ended as it should."""

    activity: int
    number: int
    started_ms: int


@dataclass(frozen=True, slots=True)
class Failure:
    """An activity has failed: with a reply, or without one in time (`timeout`)."""

    activity: int
    number: int
    reply: str
    started_ms: int


@dataclass(frozen=True, slots=True)
class Quiesce:
    """Nothing more may begin; what is under way comes to its end."""


@dataclass(frozen=True, slots=True)
class Handle:
    """Everything is quiet: find out why these activities failed."""

    failures: tuple[Failure, ...]


@dataclass(frozen=True, slots=True)
class Threatened:
    """Something will wait `late_ms` longer than it may, as things stand; or it does already
    (`over`).
    """

    dwell: Dwell
    late_ms: int
    over: bool = False


@dataclass(frozen=True, slots=True)
class Halt:
    """Every motion stops at once."""


@dataclass(frozen=True, slots=True)
class Paused:
    """Nothing moves any more that needs a hand; processes may go on."""


@dataclass(frozen=True, slots=True)
class Completed:
    """Every activity has ended."""


Effect = Dispatch | Done | Quiesce | Handle | Threatened | Halt | Paused | Completed
