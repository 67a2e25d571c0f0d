"""What is to be done with a part, when it is found and its goal is known."""

from dataclasses import dataclass

from engine.model.geometry import Floats
from engine.pipelines.placing.holding import Holds, triangles_of
from engine.stages.geometry.world.model import World
from kb.model.scene import Scene


@dataclass(frozen=True, eq=False)
class Task:
    """A part to be placed: the scene, the world as far as it is known, the part's pose found and its goal, and its holds.

    `crowded` is the world with all that is only seen, as columns.
    """

    scene: Scene
    world: World
    crowded: World
    part: str
    T_start: Floats
    T_goal: Floats
    holds: Holds

    def obstacles(self, T_world_part: Floats) -> Floats:
        """All known bodies but the part, as triangles in its frame when it is at a pose."""
        others = [name for name in self.world.cell.bodies if name != self.part]
        return triangles_of(self.world, others, T_world_part)
