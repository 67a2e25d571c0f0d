"""What happens in a cell when steps, tests and repairs are carried out, one after another; without a clock and without streams.

`Dynamics` says what a step does in a state, `FaultyCell` what it does while causes of an exception are there, and `TrueWorld`
is one such cell with causes that nobody knows. An executive can stand on it: it answers as a cell would.
"""

from engine.pipelines.simulation.dynamics import Dynamics, WorldState
from engine.pipelines.simulation.faulty import Achievement, FaultyCell, Memory
from engine.pipelines.simulation.true_world import TrueWorld
from engine.pipelines.simulation.world import World

__all__ = ["Achievement", "Dynamics", "FaultyCell", "Memory", "TrueWorld", "World", "WorldState"]
