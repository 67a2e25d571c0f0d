"""The default path planner: a straight line, else two trees that meet, short cuts, and a proof.

Nothing is drawn at random, and nothing reads a clock: the same query has the same answer on every
run.
"""

from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.motion.connect import Trees, connect
from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.geometry import Joints
from cellwright.engine.model.motion_values import (
    Answer,
    Blocked,
    Moved,
    PathQuery,
    RefusedQuery,
    Strategy,
)
from cellwright.engine.ports import MotionScene, MovingHand
from cellwright.engine.stages.motion.no_path import (
    blocked_between_trees,
    blocked_without_trees,
    forbidden_ends,
    prove_severed,
)
from cellwright.engine.stages.motion.path_proofs import plan_until_proved

# rad or m: the longest branch of a tree; of those tried on the UR5 problems, the one with the least
# work
MAX_BRANCH = 1.0
MAX_TREE_NODES = 20_000  # of each tree
EARLY_BUDGET = 300_000  # configurations looked at before it is asked whether there is a path at all
GOLDEN_RATIO = (5**0.5 - 1) / 2
TOUCHES_UNSEEN = (
    "the path touches something that the strategy did not look at, such as two parts of the hand"
)


def plan_path(ground: MotionScene, query: PathQuery, hand: MovingHand | None = None) -> Answer:
    """A path from the start to one of the goals; else why there is none.

    Goals that are not allowed are left out, as long as one is. Raises `ValueError` for arrays of
    another shape, and for a strategy that needs a hand where none is given.
    """
    answer = try_path(ground, replace(query, budget=min(query.budget, EARLY_BUDGET)), hand)
    if isinstance(answer, Blocked):
        start, goals = _checked_ends(ground.scene.joints, query)
        _, allowed = forbidden_ends(ground, start, goals, query.margin_m)
        asked = replace(query, start=start, goals=np.ascontiguousarray(goals[list(allowed)]))
        answer = replace(answer, severed=prove_severed(ground, asked))
    return (
        try_path(ground, query, hand)
        if query.budget > EARLY_BUDGET and _is_open(answer, query)
        else answer
    )


def _is_open(answer: Answer, query: PathQuery) -> bool:
    """Whether more work than was allowed first could have another answer."""
    match answer:
        case Moved():
            return query.proved and not answer.proved
        case Blocked():
            return answer.severed is None and answer.looked >= EARLY_BUDGET
    return False


def try_path(ground: MotionScene, query: PathQuery, hand: MovingHand | None = None) -> Answer:
    """The same; where no path is found, it is not looked for a proof that there is none."""
    start, goals = _checked_ends(ground.scene.joints, query)
    reasons, allowed = forbidden_ends(ground, start, goals, query.margin_m)
    if not allowed:
        return RefusedQuery(reasons)
    asked = replace(query, start=start, goals=np.ascontiguousarray(goals[list(allowed)]))

    def searched(ground: MotionScene, query: PathQuery) -> Moved | Blocked:
        return search_path(ground, query, hand)

    answer = plan_until_proved(ground, asked, searched) if query.proved else searched(ground, asked)
    return replace(answer, goal=allowed[answer.goal]) if isinstance(answer, Moved) else answer


def _checked_ends(joints: Joints, query: PathQuery) -> tuple[Floats, Floats]:
    start = np.array(query.start, dtype=float)
    goals = np.array(query.goals, dtype=float)
    if (
        start.shape != (joints.count,)
        or goals.ndim != 2
        or goals.shape[1] != joints.count
        or not len(goals)
    ):
        shape = f"({joints.count},) and (n, {joints.count})"
        raise ValueError(f"start and goals must be {shape}, not {start.shape} and {goals.shape}")
    if not (np.isfinite(start).all() and np.isfinite(goals).all()):
        raise ValueError("start and goals must be of finite numbers")
    return start, goals


def search_path(
    ground: MotionScene, query: PathQuery, hand: MovingHand | None = None
) -> Moved | Blocked:
    """A short path that is free wherever it was looked at, for ends that are allowed."""
    low, high = sampling_bounds(ground.scene.joints, query)
    lines = ground.lines(query.step, query.margin_m)
    if query.strategy is not Strategy.CONNECT or query.upright_rad > 0.0:
        return _by_strategy(ground, lines, query, (low, high), hand)
    trees = Trees(
        query.start[None],
        query.goals,
        low,
        high,
        seed_shift(query.seed, len(low)),
        MAX_BRANCH,
        MAX_TREE_NODES,
    )
    if not connect(trees, lines, query.budget):
        return blocked_between_trees(ground, trees, lines.looked, query)
    return _shorten_path(trees.path(), lines, query)


def _by_strategy(
    ground: MotionScene,
    lines: Edges,
    query: PathQuery,
    limits: tuple[Floats, Floats],
    hand: MovingHand | None,
) -> Moved | Blocked:
    """What another planner than the default one finds; its path is checked whole before it
    counts.
    """
    from cellwright.engine.stages.motion.lattice_planner import FailedPath, lattice_plan
    from cellwright.engine.stages.motion.upright_planner import upright_plan
    from cellwright.engine.stages.motion.visibility_planner import visibility_plan

    if query.strategy is Strategy.REDUCED:
        path, _ = lattice_plan(ground, lines, query, *limits)
    elif hand is None:
        raise ValueError("the strategy 'visibility' and upright paths need a hand")
    elif query.upright_rad > 0.0:
        path, _ = upright_plan(ground, lines, query, *limits, hand)
    else:
        path, _ = visibility_plan(ground, lines, query, *limits, hand)
    if not isinstance(path, FailedPath):
        rows = np.ascontiguousarray(path)
        free = np.zeros(len(rows) - 1, dtype=np.uint8)
        free_edges(lines, np.ascontiguousarray(rows[:-1]), np.ascontiguousarray(rows[1:]), free)
        if free.all():
            return _shorten_path(rows, lines, query)
        worst = int(np.argmin(free))
        path = FailedPath(TOUCHES_UNSEEN, rows[worst : worst + 2])
    return blocked_without_trees(ground, path.ends, path.why, lines.looked, query)


def _shorten_path(path: Floats, lines: Edges, query: PathQuery) -> Moved:
    """A free path (m, k), with as many short cuts as the query allows."""
    several = len(query.goals) > 1
    goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1))) if several else 0
    if len(path) > 2 and query.bridges and not query.upright_rad:
        route = Route(path, query.bridges)
        shorten(route, lines, query.bridges, query.budget)
        path = route.path()
    return Moved(path, goal, lines.looked, False, cleared_m=query.margin_m)


def sampling_bounds(joints: Joints, query: PathQuery) -> tuple[Floats, Floats]:
    """Finite limits (k,) and (k,) to draw samples from: a joint without limits goes half a
    turn, or a metre, beyond the ends.
    """
    if not query.moving and np.isfinite(joints.upper - joints.lower).all():
        return joints.lower, joints.upper
    ends = np.vstack([query.start[None], query.goals])
    beyond = np.where(joints.prismatic, 1.0, np.pi)
    low = np.where(np.isfinite(joints.lower), joints.lower, ends.min(axis=0) - beyond)
    high = np.where(np.isfinite(joints.upper), joints.upper, ends.max(axis=0) + beyond)
    still = np.ones(joints.count, dtype=bool)
    still[list(query.moving or range(joints.count))] = False
    return np.where(still, query.start, low), np.where(still, query.start, high)


def seed_shift(seed: int, count: int) -> Floats:
    """How far a seed shifts the samples in each dimension (count,), from 0 to 1."""
    return np.array([(seed * GOLDEN_RATIO**n) % 1.0 for n in range(1, count + 1)], dtype=float)
