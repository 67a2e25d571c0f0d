"""Order of an assembly: the task planner orders the moves, geometry proves or refutes each.

The domain has the operators `place`, `place_by_regrasps` and `set_aside`. A plan is followed move
by move. The first move that geometry refutes gives an obstacle; it is added to the problem as
facts, and the next plan avoids it. Each obstacle excludes at least the plan that it comes from, and
there are finitely many, so this ends.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.manipulation_values import Assembled, RelationContradiction
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.vision import NotLocated
from cellwright.engine.pipelines.manipulation.assembly_moves import (
    AssemblyYard,
    MoveKind,
    MoveObstacle,
    PartMove,
    PartSpot,
)
from cellwright.engine.pipelines.manipulation.place_answers import Carry, NotPlaced
from cellwright.engine.pipelines.manipulation.place_operation import (
    contradiction_answer,
    goal_of,
    likeliest_pose,
    not_seen_answer,
)
from cellwright.engine.pipelines.manipulation.scene_camera import SceneView, look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb import loader
from cellwright.kb.model.cell_model import BodyKind
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.model.plan_model import Plan, full_order
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function

MAX_ORDER_PLANS = 200  # plans that are tried
MOVE_OPERATORS = ("place", "place_by_regrasps", "set_aside")
CAMERA_NAME = "eye"  # the camera of a scene
Key: TypeAlias = tuple[object, ...]


@dataclass(frozen=True, slots=True, eq=False)
class NotBuilt:
    """Why there is no order: with these obstacles the task planner proves that there is no
    plan, or gives up.
    """

    why: NotPlaced
    obstacles: tuple[MoveObstacle, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class OrderedMoves:
    """The moves of a plan in their order, each with its carries; what was learned, and the problem
    that knows it.

    The steps of the plan come in this order, too: only in it are they proved.
    """

    moves: tuple[tuple[PartMove, tuple[Carry, ...]], ...]
    obstacles: tuple[MoveObstacle, ...]
    problem: Problem
    plan: Plan


def order_moves(
    yard: AssemblyYard, domain: Domain, spots: Mapping[str, PartSpot], near: Floats
) -> OrderedMoves | NotBuilt:
    """Plans from parts at spots, and the arm at (k,), each with what was learned from those before
    it, until one is proved.

    A part without a spot is lost: nothing is asked of it, and nothing can wait for it.
    """
    obstacles: list[MoveObstacle] = []
    tried_moves: dict[Key, tuple[Carry, ...] | MoveObstacle] = {}
    for _ in range(MAX_ORDER_PLANS):
        problem = problem_with(domain, sorted(yard.goals), obstacles, spots)
        outcome, _task = plan_and_ground(problem)
        if not isinstance(outcome, Found):
            last = obstacles[-1].reason if obstacles else outcome.reason
            hint = (
                "look at the obstacles: relate the parts otherwise, or move what stands in the way"
            )
            return NotBuilt(
                NotPlaced("order", f"no order of the moves is possible: {last}", hint),
                tuple(obstacles),
            )
        followed = list(_follow_plan(yard, outcome.plan, tried_moves, spots, near))
        if followed and isinstance(followed[-1], MoveObstacle):
            obstacles.append(followed[-1])
            continue
        moves = tuple(move for move in followed if not isinstance(move, MoveObstacle))
        return OrderedMoves(moves, tuple(obstacles), problem, full_order(outcome.plan))
    reason = f"{MAX_ORDER_PLANS} plans were refuted by geometry"
    return NotBuilt(NotPlaced("order", reason, "relate the parts otherwise"), tuple(obstacles))


def _follow_plan(
    yard: AssemblyYard,
    plan: Plan,
    known: dict[Key, tuple[Carry, ...] | MoveObstacle],
    spots: Mapping[str, PartSpot],
    near: Floats,
) -> Iterator[tuple[PartMove, tuple[Carry, ...]] | MoveObstacle]:
    """The moves of a plan with their carries; the last one may be what forbids a move."""
    for step in plan.steps:
        if step.operator.name not in MOVE_OPERATORS:
            continue
        move = move_of(step.operator)
        key = key_of(move, spots, near)
        if key not in known:
            known[key] = yard.moved(move, spots, near)
        answer = known[key]
        if isinstance(answer, MoveObstacle):
            yield answer
            return
        yield move, answer
        spots, near = {**spots, move.part: move.end}, answer[-1].legs[-1].path[-1]


def key_of(move: PartMove, spots: Mapping[str, PartSpot], near: Floats) -> Key:
    """The key under which the carries of a move are remembered: the parts at their spots, and
    where the arm is (k,).
    """
    return move, frozenset(spots.items()), near.tobytes()


def move_of(step: Function) -> PartMove:
    """The move that a step of the domain stands for."""
    part = str(step.arguments[0])
    match step.name:
        case "set_aside":
            return PartMove(part, MoveKind.DIRECT, PartSpot.FOUND, PartSpot.ASIDE)
        case "place_by_regrasps":
            return PartMove(
                part, MoveKind.REGRASPED, PartSpot(str(step.arguments[1])), PartSpot.GOAL
            )
        case _:
            return PartMove(part, MoveKind.DIRECT, PartSpot(str(step.arguments[1])), PartSpot.GOAL)


def problem_with(
    domain: Domain,
    parts: Sequence[str],
    obstacles: Sequence[MoveObstacle],
    spots: Mapping[str, PartSpot],
) -> Problem:
    """To bring all parts from their spots to their goals, in spite of the obstacles that are known.

    A part without a spot is lost, and need not be brought anywhere.
    """
    names = {f"obstacle_{n}": obstacle for n, obstacle in enumerate(obstacles, 1)}
    objects = {**dict.fromkeys(parts, "part"), **dict.fromkeys(names, "obstacle")}
    statics = [fact for name, obstacle in names.items() for fact in _obstacle_facts(name, obstacle)]
    problem = Problem("assembly", domain, objects, tuple(statics))
    goals = ", ".join(f"at({part}, goal)" for part in parts if part in spots)
    seen = [_ground_atom(name, CAMERA_NAME) for name in ("ranged", "standing", "mapped")]
    problem = problem.replace(
        (*(_ground_atom("at", part, spot) for part, spot in sorted(spots.items())), *seen)
    )
    return loader.with_goals(domain, goals, problem)


def _obstacle_facts(name: str, obstacle: MoveObstacle) -> Iterator[Atom]:
    move = obstacle.move
    yield _ground_atom("hinders", name, move.part, move.way, move.start, move.end)
    for part, spot in obstacle.during:
        yield _ground_atom("during", name, part, spot)
    for part in obstacle.until:
        yield _ground_atom("until", name, part, PartSpot.GOAL)


def _ground_atom(name: str, *arguments: str) -> Atom:
    return Function(name, tuple(Function(str(argument), ()) for argument in arguments))


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """The moves of an assembly in their order, each with its carries; what was learned on the
    way, and the problem with it.
    """

    goal: Assembled
    looked: SceneView
    yard: AssemblyYard
    moves: tuple[tuple[PartMove, tuple[Carry, ...]], ...]
    obstacles: tuple[MoveObstacle, ...]
    problem: Problem
    plan: Plan


AssemblyMade: TypeAlias = Built | NotBuilt


def assemble_scene(
    scene: Scene, domain: Domain, base: str, seed: int = 0, image: Floats | None = None
) -> tuple[AssemblyMade, SceneView | None]:
    """All parts that the scene's relations name are put where they belong.

    Raises `InvalidInput` for names that are not there.
    """
    world, parts = GeometricWorld.of(scene.cell), related_parts(scene, base)
    goal = goal_of(scene, world, parts, base)
    if isinstance(goal, RelationContradiction):
        return NotBuilt(contradiction_answer(goal)), None
    looked = look_for_parts(scene, world, parts, seed, image)
    for part, sighting in looked.sightings.items():
        if isinstance(sighting, NotLocated):
            return NotBuilt(not_seen_answer(part, sighting)), looked
    goals = {part: world.pose("world", base) @ goal.poses[part] for part in parts}
    places = {
        part: likeliest_pose(sighting, looked.T_world_camera, goals[part])
        for part, sighting in looked.sightings.items()
        if not isinstance(sighting, NotLocated)
    }
    yard = AssemblyYard(AssemblySite.of(scene, world, looked, places), goals)
    found_order = order_moves(
        yard, domain, dict.fromkeys(parts, PartSpot.FOUND), yard.site.world.configuration
    )
    return _built_answer(found_order, goal, looked, yard), looked


def _built_answer(
    order: OrderedMoves | NotBuilt, goal: Assembled, looked: SceneView, yard: AssemblyYard
) -> AssemblyMade:
    if isinstance(order, NotBuilt):
        return order
    return Built(goal, looked, yard, order.moves, order.obstacles, order.problem, order.plan)


def related_parts(scene: Scene, base: str) -> tuple[str, ...]:
    """The parts that relations name, but the base."""
    named = {
        name for relation in scene.relations for name in (relation.first[0], relation.second[0])
    }
    bodies = scene.cell.bodies
    return tuple(
        sorted(n for n in named if n != base and n in bodies and bodies[n].kind is BodyKind.PART)
    )
