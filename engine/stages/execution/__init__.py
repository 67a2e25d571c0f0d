"""The executive: a transition table over programs, without I/O and without a clock.

`Program` is a plan as the executive sees it, `Standing` how far it is, and `advance` leads from an
event to the next standing and to what is to be done. Who calls it waits for replies, writes the
journal and reads the clock.
"""

from cellwright.engine.stages.execution.activity_program import Activity, ActivityProgram, Dwell
from cellwright.engine.stages.execution.run_events import (
    Began,
    CommandFailed,
    Completed,
    Continued,
    Dispatch,
    Done,
    Effect,
    Event,
    Failure,
    Halt,
    Handle,
    Interrupted,
    Paused,
    Quiesce,
    Replied,
    StopCommanded,
    Threatened,
    TimePassed,
    Withdrawn,
)
from cellwright.engine.stages.execution.run_state import (
    ExecutiveState,
    Running,
    standing_of,
    unrested_after,
)
from cellwright.engine.stages.execution.transition_table import (
    TIMEOUT_REPLY,
    advance_run,
    next_time,
    only_waits,
)

__all__ = [
    "TIMEOUT_REPLY",
    "Activity",
    "ActivityProgram",
    "Began",
    "CommandFailed",
    "Completed",
    "Continued",
    "Dispatch",
    "Done",
    "Dwell",
    "Effect",
    "Event",
    "ExecutiveState",
    "Failure",
    "Halt",
    "Handle",
    "Interrupted",
    "Paused",
    "Quiesce",
    "Replied",
    "Running",
    "StopCommanded",
    "Threatened",
    "TimePassed",
    "Withdrawn",
    "advance_run",
    "next_time",
    "only_waits",
    "standing_of",
    "unrested_after",
]
