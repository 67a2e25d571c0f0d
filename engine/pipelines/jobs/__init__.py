"""Jobs: units of work carried out by processes or a cluster; what is finished is done once.

A unit is known by its name and by a digest of all that its result depends on. With a ledger in a
store, whoever carries a unit out notes its result there. So workers, the scheduler of a cluster,
the database or the command itself may be killed at any moment: the next call takes up the work with
what is not noted. What a unit changes in the store is written with its note (`Drafted`), or leaves
the same if it is written twice.
"""

from cellwright.engine.pipelines.jobs.executors import crew_of
from cellwright.engine.pipelines.jobs.work_units import (
    DraftedResult,
    ResultLedger,
    WorkCrew,
    WorkKind,
    WorkUnit,
    carried_out,
    show_nothing,
)

__all__ = [
    "DraftedResult",
    "ResultLedger",
    "WorkCrew",
    "WorkKind",
    "WorkUnit",
    "carried_out",
    "crew_of",
    "show_nothing",
]
