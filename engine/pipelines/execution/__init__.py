"""Execution: a plan carried out through a driver, watched, noted in a journal, and carried on after exceptions.

The core is `engine.stages.execution`, a table without a clock. Here are the loop that waits, the exception handler, and what a
person can do at a pause.
"""

from engine.model.execution import Finish
from engine.pipelines.execution.begin import Wanted, begin, listed, named, resume
from engine.pipelines.execution.orders import Given, Orders, Timed
from engine.pipelines.execution.running import Execution
from engine.pipelines.execution.scope import Scope

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
