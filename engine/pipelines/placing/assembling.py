"""An assembly as a whole: parts are found in an image, and moves that put them at their goals are ordered and proved."""

from dataclasses import dataclass
from typing import TypeAlias

from cellwright.engine.model.assembly import Assembled, Contradiction
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import NotLocated
from cellwright.engine.pipelines.placing.answers import Carry
from cellwright.engine.pipelines.placing.goals import goal_of
from cellwright.engine.pipelines.placing.looking import Looked, look
from cellwright.engine.pipelines.placing.ordering import NotBuilt, Ordered, ordered
from cellwright.engine.pipelines.placing.placing import contradicted, likeliest, unseen
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.yard import Move, Obstacle, Spot, Yard
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import BodyKind
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """The moves of an assembly in their order, each with its carries; what was learned on the way, and the problem with it."""

    goal: Assembled
    looked: Looked
    yard: Yard
    moves: tuple[tuple[Move, tuple[Carry, ...]], ...]
    obstacles: tuple[Obstacle, ...]
    problem: Problem
    plan: Plan


AssemblyMade: TypeAlias = Built | NotBuilt


def assemble(
    scene: Scene, domain: Domain, base: str, seed: int = 0, image: Floats | None = None
) -> tuple[AssemblyMade, Looked | None]:
    """All parts that the scene's relations name are put where they belong. Raises `InvalidInput` for names that are not there."""
    world, parts = World.of(scene.cell), parts_of(scene, base)
    goal = goal_of(scene, world, parts, base)
    if isinstance(goal, Contradiction):
        return NotBuilt(contradicted(goal)), None
    looked = look(scene, world, parts, seed, image)
    for part, sighting in looked.sightings.items():
        if isinstance(sighting, NotLocated):
            return NotBuilt(unseen(part, sighting)), looked
    goals = {part: world.pose("world", base) @ goal.poses[part] for part in parts}
    found = {
        part: likeliest(sighting, looked.T_world_camera, goals[part])
        for part, sighting in looked.sightings.items()
        if not isinstance(sighting, NotLocated)
    }
    yard = Yard(Site.of(scene, world, looked, found), goals)
    found_order = ordered(yard, domain, dict.fromkeys(parts, Spot.FOUND), yard.site.world.configuration)
    return _built(found_order, goal, looked, yard), looked


def _built(found: Ordered | NotBuilt, goal: Assembled, looked: Looked, yard: Yard) -> AssemblyMade:
    if isinstance(found, NotBuilt):
        return found
    return Built(goal, looked, yard, found.moves, found.obstacles, found.problem, found.plan)


def parts_of(scene: Scene, base: str) -> tuple[str, ...]:
    """The parts that relations name, but the base."""
    named = {name for each in scene.relations for name in (each.first[0], each.second[0])}
    bodies = scene.cell.bodies
    return tuple(sorted(n for n in named if n != base and n in bodies and bodies[n].kind is BodyKind.PART))
