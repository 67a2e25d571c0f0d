"""The executive: a transition table over programs, without I/O and without a clock.

`Program` is a plan as the executive sees it, `Standing` how far it is, and `advance` leads from an event to the next standing
and to what is to be done. Who calls it waits for replies, writes the journal and reads the clock.
"""

from cellwright.engine.stages.execution.events import (
    Began,
    Completed,
    Continued,
    Dispatch,
    Done,
    Effect,
    Event,
    Failed,
    Failure,
    Halt,
    Handle,
    Interrupted,
    Passed,
    Paused,
    Quiesce,
    Replied,
    Stopped,
    Threatened,
    Withdrawn,
)
from cellwright.engine.stages.execution.machine import TIMEOUT, advance, next_time, waits
from cellwright.engine.stages.execution.program import Activity, Dwell, Program
from cellwright.engine.stages.execution.standing import Running, Standing, standing_of, unrested_after

__all__ = [
    "TIMEOUT",
    "Activity",
    "Began",
    "Completed",
    "Continued",
    "Dispatch",
    "Done",
    "Dwell",
    "Effect",
    "Event",
    "Failed",
    "Failure",
    "Halt",
    "Handle",
    "Interrupted",
    "Passed",
    "Paused",
    "Program",
    "Quiesce",
    "Replied",
    "Running",
    "Standing",
    "Stopped",
    "Threatened",
    "Withdrawn",
    "advance",
    "next_time",
    "standing_of",
    "unrested_after",
    "waits",
]
