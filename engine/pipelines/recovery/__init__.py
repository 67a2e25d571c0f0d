"""Recovery: the cause of an exception, its repair, and the plan revised for what is left.

`Dynamics` says what a step does in a state, and `FaultyCell` what it does while causes of an
exception are there.
"""

from cellwright.engine.pipelines.recovery.symbolic_world import SymbolicWorld
from cellwright.engine.pipelines.recovery.world_model import (
    Dynamics,
    FaultyCell,
    KeptHistory,
    StepAchievement,
    WorldState,
)

__all__ = [
    "Dynamics",
    "FaultyCell",
    "KeptHistory",
    "StepAchievement",
    "SymbolicWorld",
    "WorldState",
]
