"""A site: what stays as it is while parts are moved, and the task of moving one of them."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.solid import Solid
from cellwright.engine.pipelines.placing.holding import Holds, holds_of
from cellwright.engine.pipelines.placing.looking import Looked, table_pose
from cellwright.engine.pipelines.placing.obstacles import Unknown
from cellwright.engine.pipelines.placing.task import UNKNOWN, USUAL, Manner, Task
from cellwright.engine.stages.geometry.shapes.solids import solid_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Body, BodyKind, Placement
from cellwright.kb.model.scene import Scene


@dataclass(frozen=True, eq=False)
class Site:
    """The scene, the world without its clutter, what was seen, and where parts were found: T_world_part by name."""

    scene: Scene
    world: World
    looked: Looked
    found: Mapping[str, Floats]
    manner: Manner = USUAL
    _holds: dict[str, Holds] = field(default_factory=dict)

    @classmethod
    def of(
        cls, scene: Scene, world: World, looked: Looked, found: Mapping[str, Floats], manner: Manner = USUAL
    ) -> "Site":
        """The site of a scene: its clutter is not known, and parts are where they were found."""
        known = without(world, scene.clutter)
        for name, T in found.items():
            known = known.put(name, "world", T)
        return cls(scene, known, looked, found, manner)

    @cached_property
    def solids(self) -> dict[str, Solid]:
        """The surfaces of all bodies that have one, also of clutter."""
        return {name: solid_of(body) for name, body in self.scene.cell.bodies.items() if body.shapes}

    @cached_property
    def unknown(self) -> Unknown:
        """What is seen and nobody has modelled."""
        back = inverse(self.looked.T_world_camera)
        return Unknown(self.looked, tuple((self.solids[name], back @ T) for name, T in self.found.items()))

    @cached_property
    def columns(self) -> Body:
        """What is seen and nobody has modelled, as a body in the frame of the table."""
        shapes = self.unknown.columns(table_pose(self.scene, self.world))
        return Body(UNKNOWN, BodyKind.FIXTURE, Placement(), shapes)

    def holds(self, part: str) -> Holds:
        """The holds of a part."""
        if part not in self._holds:
            self._holds[part] = holds_of(self.scene, self.solids[part])
        return self._holds[part]

    def task(
        self,
        part: str,
        ends: tuple[Floats, Floats],
        others: Mapping[str, Floats] | None = None,
        absent: Collection[str] = (),
    ) -> Task:
        """To move a part from one pose in the world to another, with other bodies at poses, and without those that are absent.

        Clutter that has a pose is known from then on.
        """
        world, others = without(self.world, absent), others or {}
        met = {name: self.scene.cell.bodies[name] for name in others if name not in world.cell.bodies}
        cell = replace(world.cell, bodies={**world.cell.bodies, **met})
        world = replace(world, cell=cell).put(part, "world", ends[0])
        for name, T in others.items():
            world = world.put(name, "world", T)
        table = table_pose(self.scene, self.world)
        cell = replace(world.cell, bodies={**world.cell.bodies, UNKNOWN: self.columns})
        crowded = replace(world, cell=cell).put(UNKNOWN, "world", table)
        return Task(
            self.scene,
            world,
            crowded,
            part,
            *ends,
            self.holds(part),
            self.solids,
            self.unknown,
            table,
            self.manner,
        )


def without(world: World, names: Collection[str]) -> World:
    """The world without some bodies."""
    if not names:
        return world
    bodies = {name: body for name, body in world.cell.bodies.items() if name not in names}
    placed = {name: fixed for name, fixed in world.placed.items() if name.partition(".")[0] not in names}
    return replace(world, cell=replace(world.cell, bodies=bodies), placed=placed)
