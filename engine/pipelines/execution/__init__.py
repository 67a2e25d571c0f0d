"""Execution: a plan carried out through a driver, watched, noted in a journal, and carried on after exceptions.

The core is `cellwright.engine.stages.execution`, a table without a clock. Here are the loop that waits, the exception handler, and what a
person can do at a pause.
"""

from cellwright.engine.model.execution import Finish
from cellwright.engine.pipelines.execution.begin import Wanted, begin, listed, named, resume
from cellwright.engine.pipelines.execution.orders import Given, Orders, Timed
from cellwright.engine.pipelines.execution.running import Execution
from cellwright.engine.pipelines.execution.scope import Scope

__all__ = [
    "Execution",
    "Finish",
    "Given",
    "Orders",
    "Scope",
    "Timed",
    "Wanted",
    "begin",
    "listed",
    "named",
    "resume",
]
