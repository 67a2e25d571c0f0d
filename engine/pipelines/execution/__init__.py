"""Execution of a plan through a driver: watched, kept in a journal, carried on after exceptions.

The core is `cellwright.engine.stages.execution`, a table without a clock. Here are the loop that
waits, the exception handler, and what a person can do at a pause.
"""

from cellwright.engine.model.run_protocol import Finish
from cellwright.engine.pipelines.execution.operator_orders import (
    GivenOrder,
    OrderSource,
    TimedOrders,
)
from cellwright.engine.pipelines.execution.run_control import RunExecution
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_start import (
    RunRequest,
    begin_run,
    list_run,
    name_run,
    resume_run,
)

__all__ = [
    "Finish",
    "GivenOrder",
    "OrderSource",
    "RunExecution",
    "RunRequest",
    "RunScope",
    "TimedOrders",
    "begin_run",
    "list_run",
    "name_run",
    "resume_run",
]
