"""An assembly as a whole: the task planner orders the moves, geometry proves or refutes each, and what it refutes is learned.

The domain has the operators `place`, `place_by_regrasps` and `set_aside`. A plan is followed move by move. The first move that
geometry refutes gives an obstacle; it is added to the problem as facts, and the next plan avoids it. Each obstacle excludes at
least the plan that it comes from, and there are finitely many, so this ends.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from engine.model.assembly import Assembled, Contradiction
from engine.model.geometry import Floats
from engine.model.outcome import Found
from engine.model.vision import NotLocated
from engine.pipelines.placing.answers import Carry, NotPlaced
from engine.pipelines.placing.goals import goal_of
from engine.pipelines.placing.looking import Looked, look
from engine.pipelines.placing.placing import contradicted, likeliest, unseen
from engine.pipelines.placing.site import Site
from engine.pipelines.placing.yard import Move, Obstacle, Spot, Way, Yard
from engine.pipelines.planning import planned
from engine.stages.geometry.world.model import World
from kb.model.cell import BodyKind
from kb.model.domain import Domain
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.model.scene import Scene
from kb.terms import Atom, Function

MOST = 200  # plans that are tried


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """The moves of an assembly in their order, each with its carries; what was learned on the way, and the problem with it."""

    goal: Assembled
    looked: Looked
    site: Site
    moves: tuple[tuple[Move, tuple[Carry, ...]], ...]
    obstacles: tuple[Obstacle, ...]
    problem: Problem
    plan: Plan


@dataclass(frozen=True, slots=True, eq=False)
class NotBuilt:
    """Why there is no order: with these obstacles the task planner proves that there is no plan, or gives up."""

    why: NotPlaced
    obstacles: tuple[Obstacle, ...] = ()


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
    return _ordered(yard, domain, goal, looked), looked


def parts_of(scene: Scene, base: str) -> tuple[str, ...]:
    """The parts that relations name, but the base."""
    named = {name for each in scene.relations for name in (each.first[0], each.second[0])}
    bodies = scene.cell.bodies
    return tuple(sorted(n for n in named if n != base and n in bodies and bodies[n].kind is BodyKind.PART))


def _ordered(yard: Yard, domain: Domain, goal: Assembled, looked: Looked) -> AssemblyMade:
    """Plans, each with what was learned from those before it, until one is proved."""
    obstacles: list[Obstacle] = []
    known: dict[tuple[object, ...], tuple[Carry, ...] | Obstacle] = {}
    for _ in range(MOST):
        problem = problem_with(domain, sorted(yard.goals), obstacles)
        outcome, _task = planned(problem)
        if not isinstance(outcome, Found):
            last = obstacles[-1].reason if obstacles else outcome.reason
            hint = "look at the obstacles: relate the parts otherwise, or move what stands in the way"
            return NotBuilt(
                NotPlaced("order", f"no order of the moves is possible: {last}", hint), tuple(obstacles)
            )
        made = list(_followed(yard, outcome.plan, known))
        if made and isinstance(made[-1], Obstacle):
            obstacles.append(made[-1])
            continue
        moves = tuple(each for each in made if not isinstance(each, Obstacle))
        return Built(goal, looked, yard.site, moves, tuple(obstacles), problem, outcome.plan)
    reason = f"{MOST} plans were refuted by geometry"
    return NotBuilt(NotPlaced("order", reason, "relate the parts otherwise"), tuple(obstacles))


def _followed(
    yard: Yard, plan: Plan, known: dict[tuple[object, ...], tuple[Carry, ...] | Obstacle]
) -> Iterator[tuple[Move, tuple[Carry, ...]] | Obstacle]:
    """The moves of a plan with their carries; the last one may be what forbids a move."""
    spots: Mapping[str, Spot] = dict.fromkeys(yard.goals, Spot.FOUND)
    near = yard.site.world.configuration
    for step in plan.steps:
        move = move_of(step.operator)
        key = (move, frozenset(spots.items()), near.tobytes())
        if key not in known:
            known[key] = yard.moved(move, spots, near)
        answer = known[key]
        if isinstance(answer, Obstacle):
            yield answer
            return
        yield move, answer
        spots, near = {**spots, move.part: move.end}, answer[-1].legs[-1].path[-1]


def move_of(step: Function) -> Move:
    """The move that a step of the domain stands for."""
    part = str(step.arguments[0])
    match step.name:
        case "set_aside":
            return Move(part, Way.DIRECT, Spot.FOUND, Spot.ASIDE)
        case "place_by_regrasps":
            return Move(part, Way.REGRASPED, Spot(str(step.arguments[1])), Spot.GOAL)
        case _:
            return Move(part, Way.DIRECT, Spot(str(step.arguments[1])), Spot.GOAL)


def problem_with(domain: Domain, parts: Sequence[str], obstacles: Sequence[Obstacle]) -> Problem:
    """To bring all parts to their goals, in spite of the obstacles that are known."""
    from kb.loader import with_goals

    names = {f"obstacle_{n}": each for n, each in enumerate(obstacles, 1)}
    objects = {**dict.fromkeys(parts, "part"), **dict.fromkeys(names, "obstacle")}
    statics = [fact for name, each in names.items() for fact in _facts(name, each)]
    problem = Problem("assembly", domain, objects, tuple(statics))
    return with_goals(domain, ", ".join(f"at({part}, goal)" for part in parts), problem)


def _facts(name: str, obstacle: Obstacle) -> Iterator[Atom]:
    move = obstacle.move
    yield _atom("hinders", name, move.part, move.way, move.start, move.end)
    for part, spot in obstacle.during:
        yield _atom("during", name, part, spot)
    for part in obstacle.until:
        yield _atom("until", name, part, Spot.GOAL)


def _atom(name: str, *arguments: str) -> Atom:
    return Function(name, tuple(Function(str(each), ()) for each in arguments))
