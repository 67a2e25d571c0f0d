"""The order of the moves of an assembly: the task planner orders them, geometry proves or refutes each, and what it refutes is learned.

The domain has the operators `place`, `place_by_regrasps` and `set_aside`. A plan is followed move by move. The first move that
geometry refutes gives an obstacle; it is added to the problem as facts, and the next plan avoids it. Each obstacle excludes at
least the plan that it comes from, and there are finitely many, so this ends.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.placing.answers import Carry, NotPlaced
from cellwright.engine.pipelines.placing.yard import Move, Obstacle, Spot, Way, Yard
from cellwright.engine.pipelines.planning import planned
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.plan import Plan, in_sequence
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function

MOST = 200  # plans that are tried
MOVES = ("place", "place_by_regrasps", "set_aside")
EYE = "eye"  # the camera of a scene
Key: TypeAlias = tuple[object, ...]


@dataclass(frozen=True, slots=True, eq=False)
class NotBuilt:
    """Why there is no order: with these obstacles the task planner proves that there is no plan, or gives up."""

    why: NotPlaced
    obstacles: tuple[Obstacle, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Ordered:
    """The moves of a plan in their order, each with its carries; what was learned, and the problem that knows it.

    The steps of the plan come in this order, too: only in it are they proved.
    """

    moves: tuple[tuple[Move, tuple[Carry, ...]], ...]
    obstacles: tuple[Obstacle, ...]
    problem: Problem
    plan: Plan


def ordered(yard: Yard, domain: Domain, spots: Mapping[str, Spot], near: Floats) -> Ordered | NotBuilt:
    """Plans from parts at spots, and the arm at (k,), each with what was learned from those before it, until one is proved.

    A part without a spot is lost: nothing is asked of it, and nothing can wait for it.
    """
    obstacles: list[Obstacle] = []
    known: dict[Key, tuple[Carry, ...] | Obstacle] = {}
    for _ in range(MOST):
        problem = problem_with(domain, sorted(yard.goals), obstacles, spots)
        outcome, _task = planned(problem)
        if not isinstance(outcome, Found):
            last = obstacles[-1].reason if obstacles else outcome.reason
            hint = "look at the obstacles: relate the parts otherwise, or move what stands in the way"
            return NotBuilt(
                NotPlaced("order", f"no order of the moves is possible: {last}", hint), tuple(obstacles)
            )
        made = list(_followed(yard, outcome.plan, known, spots, near))
        if made and isinstance(made[-1], Obstacle):
            obstacles.append(made[-1])
            continue
        moves = tuple(each for each in made if not isinstance(each, Obstacle))
        return Ordered(moves, tuple(obstacles), problem, in_sequence(outcome.plan))
    reason = f"{MOST} plans were refuted by geometry"
    return NotBuilt(NotPlaced("order", reason, "relate the parts otherwise"), tuple(obstacles))


def _followed(
    yard: Yard,
    plan: Plan,
    known: dict[Key, tuple[Carry, ...] | Obstacle],
    spots: Mapping[str, Spot],
    near: Floats,
) -> Iterator[tuple[Move, tuple[Carry, ...]] | Obstacle]:
    """The moves of a plan with their carries; the last one may be what forbids a move."""
    for step in plan.steps:
        if step.operator.name not in MOVES:
            continue
        move = move_of(step.operator)
        key = key_of(move, spots, near)
        if key not in known:
            known[key] = yard.moved(move, spots, near)
        answer = known[key]
        if isinstance(answer, Obstacle):
            yield answer
            return
        yield move, answer
        spots, near = {**spots, move.part: move.end}, answer[-1].legs[-1].path[-1]


def key_of(move: Move, spots: Mapping[str, Spot], near: Floats) -> Key:
    """The key under which the carries of a move are remembered: the parts at their spots, and where the arm is (k,)."""
    return move, frozenset(spots.items()), near.tobytes()


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


def problem_with(
    domain: Domain,
    parts: Sequence[str],
    obstacles: Sequence[Obstacle],
    spots: Mapping[str, Spot],
) -> Problem:
    """To bring all parts from their spots to their goals, in spite of the obstacles that are known.

    A part without a spot is lost, and need not be brought anywhere.
    """
    from cellwright.kb.loader import with_goals

    names = {f"obstacle_{n}": each for n, each in enumerate(obstacles, 1)}
    objects = {**dict.fromkeys(parts, "part"), **dict.fromkeys(names, "obstacle")}
    statics = [fact for name, each in names.items() for fact in _facts(name, each)]
    problem = Problem("assembly", domain, objects, tuple(statics))
    wanted = ", ".join(f"at({part}, goal)" for part in parts if part in spots)
    seen = [_atom(each, EYE) for each in ("ranged", "standing", "mapped")]
    problem = problem.replace((*(_atom("at", part, spot) for part, spot in sorted(spots.items())), *seen))
    return with_goals(domain, wanted, problem)


def _facts(name: str, obstacle: Obstacle) -> Iterator[Atom]:
    move = obstacle.move
    yield _atom("hinders", name, move.part, move.way, move.start, move.end)
    for part, spot in obstacle.during:
        yield _atom("during", name, part, spot)
    for part in obstacle.until:
        yield _atom("until", name, part, Spot.GOAL)


def _atom(name: str, *arguments: str) -> Atom:
    return Function(name, tuple(Function(str(each), ()) for each in arguments))
