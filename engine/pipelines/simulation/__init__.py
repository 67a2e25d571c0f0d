"""What happens in a cell when steps, tests and repairs are carried out, one after another; without a clock and without streams.

`Dynamics` says what a step does in a state, and `FaultyCell` what it does while causes of an exception are there.
"""

from cellwright.engine.pipelines.simulation.dynamics import Dynamics, WorldState
from cellwright.engine.pipelines.simulation.faulty import Achievement, FaultyCell, Memory
from cellwright.engine.pipelines.simulation.world import SymbolicWorld

__all__ = ["Achievement", "Dynamics", "FaultyCell", "Memory", "SymbolicWorld", "WorldState"]
