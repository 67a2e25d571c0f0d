"""What is to be done with a part, when it is found and its goal is known."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Strategy
from cellwright.engine.model.solid import Solid
from cellwright.engine.pipelines.placing.holding import Holds
from cellwright.engine.pipelines.placing.obstacles import Unknown
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import Scene

UNKNOWN = "unknown_things"  # the body that stands for all that is only seen


class Coming(StrEnum):
    """How the hand comes to a grasp.

    `straight` is along its own axis. `complete` does so where it can, and else looks at all ways on a grid in the grasp plane.
    By `potential` it is drawn by the grasp and pushed off by what stands around, as Handey's was, and may be stuck.
    """

    STRAIGHT = "straight"
    COMPLETE = "complete"
    POTENTIAL = "potential"


@dataclass(frozen=True, slots=True)
class Manner:
    """How the hand comes to a part, and how motions between are looked for."""

    coming: Coming = Coming.STRAIGHT
    strategy: Strategy = Strategy.CONNECT


USUAL = Manner()


@dataclass(frozen=True, eq=False)
class Task:
    """A part to be placed: the scene, the world as far as it is known, the part's pose found and its goal, and its holds.

    `crowded` is the world with all that is only seen, as columns. `solids` are the surfaces of bodies, `unknown` is what the
    image shows beside them, `manner` how the hand is to come and go.
    """

    scene: Scene
    world: World
    crowded: World
    part: str
    T_start: Floats
    T_goal: Floats
    holds: Holds
    solids: Mapping[str, Solid]
    unknown: Unknown
    T_world_table: Floats
    manner: Manner = USUAL

    def obstacles(self, T_world_part: Floats) -> Floats:
        """All that is around a part when it is at a pose, as triangles (m, 3, 3) in its frame: bodies, and what is only seen."""
        back = inverse(T_world_part)
        found = [
            apply(back @ self.world.pose("world", name), self.solids[name].vertices).reshape(-1, 3, 3)
            for name in self.world.cell.bodies
            if name != self.part and name in self.solids
        ]
        return np.concatenate([*found, self.unknown.lines(T_world_part)])
