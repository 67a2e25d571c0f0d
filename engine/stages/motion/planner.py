"""The default planner: a straight line, else two trees that meet, then short cuts, then a proof.

Nothing is drawn at random, and nothing reads a clock: the same query has the same answer on every run.
"""

from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.motion.connect import Trees, connect
from cellwright.engine.kernels.motion.shorten import Route, shorten
from cellwright.engine.model.geometry import Floats, Joints
from cellwright.engine.model.motion import Answer, Blocked, Moved, Query, Refused, Strategy
from cellwright.engine.ports import Hand, MotionGround
from cellwright.engine.stages.motion.proving import until_proved
from cellwright.engine.stages.motion.reasons import blocked, failed, refusals
from cellwright.engine.stages.motion.severing import severed

REACH = 1.0  # rad or m: the longest branch of a tree; of those tried on the UR5 problems, the one with the least work
NODES = 20_000  # of each tree
EARLY = 300_000  # configurations looked at before it is asked whether there is a path at all
GOLDEN = (5**0.5 - 1) / 2
UNSEEN = "the path touches something that the strategy did not look at, such as two parts of the hand"


def plan(ground: MotionGround, query: Query, hand: Hand | None = None) -> Answer:
    """A path from the start to one of the goals; else why there is none.

    Goals that are not allowed are left out, as long as one is. Raises `ValueError` for arrays of another shape, and for a
    strategy that needs a hand where none is given.
    """
    found = tried(ground, replace(query, budget=min(query.budget, EARLY)), hand)
    if isinstance(found, Blocked):
        start, goals = _checked(ground.scene.joints, query)
        _, allowed = refusals(ground, start, goals, query.margin_m)
        asked = replace(query, start=start, goals=np.ascontiguousarray(goals[list(allowed)]))
        found = replace(found, severed=severed(ground, asked))
    return tried(ground, query, hand) if query.budget > EARLY and _is_open(found, query) else found


def _is_open(answer: Answer, query: Query) -> bool:
    """Whether more work than was allowed first could have another answer."""
    match answer:
        case Moved():
            return query.proved and not answer.proved
        case Blocked():
            return answer.severed is None and answer.looked >= EARLY
    return False


def tried(ground: MotionGround, query: Query, hand: Hand | None = None) -> Answer:
    """The same; where no path is found, it is not looked for a proof that there is none."""
    start, goals = _checked(ground.scene.joints, query)
    reasons, allowed = refusals(ground, start, goals, query.margin_m)
    if not allowed:
        return Refused(reasons)
    asked = replace(query, start=start, goals=np.ascontiguousarray(goals[list(allowed)]))

    def searched(ground: MotionGround, query: Query) -> Moved | Blocked:
        return search(ground, query, hand)

    found = until_proved(ground, asked, searched) if query.proved else searched(ground, asked)
    return replace(found, goal=allowed[found.goal]) if isinstance(found, Moved) else found


def _checked(joints: Joints, query: Query) -> tuple[Floats, Floats]:
    start = np.array(query.start, dtype=float)
    goals = np.array(query.goals, dtype=float)
    if start.shape != (joints.count,) or goals.ndim != 2 or goals.shape[1] != joints.count or not len(goals):
        shape = f"({joints.count},) and (n, {joints.count})"
        raise ValueError(f"start and goals must be {shape}, not {start.shape} and {goals.shape}")
    if not (np.isfinite(start).all() and np.isfinite(goals).all()):
        raise ValueError("start and goals must be of finite numbers")
    return start, goals


def search(ground: MotionGround, query: Query, hand: Hand | None = None) -> Moved | Blocked:
    """A short path that is free wherever it was looked at, for ends that are allowed."""
    low, high = bounds(ground.scene.joints, query)
    lines = ground.lines(query.step, query.margin_m)
    if query.strategy is not Strategy.CONNECT or query.upright_rad > 0.0:
        return _by_strategy(ground, lines, query, (low, high), hand)
    trees = Trees(query.start[None], query.goals, low, high, shifted(query.seed, len(low)), REACH, NODES)
    if not connect(trees, lines, query.budget):
        return blocked(ground, trees, lines.looked, query)
    return _shortened(trees.path(), lines, query)


def _by_strategy(
    ground: MotionGround, lines: Edges, query: Query, limits: tuple[Floats, Floats], hand: Hand | None
) -> Moved | Blocked:
    """What another planner than the default one finds; its path is checked whole before it counts."""
    from cellwright.engine.stages.motion.reduced import Failed, reduced
    from cellwright.engine.stages.motion.upright import upright
    from cellwright.engine.stages.motion.visibility import visibility

    if query.strategy is Strategy.REDUCED:
        found, _ = reduced(ground, lines, query, *limits)
    elif hand is None:
        raise ValueError("the strategy 'visibility' and upright paths need a hand")
    elif query.upright_rad > 0.0:
        found, _ = upright(ground, lines, query, *limits, hand)
    else:
        found, _ = visibility(ground, lines, query, *limits, hand)
    if not isinstance(found, Failed):
        rows = np.ascontiguousarray(found)
        free = np.zeros(len(rows) - 1, dtype=np.uint8)
        free_edges(lines, np.ascontiguousarray(rows[:-1]), np.ascontiguousarray(rows[1:]), free)
        if free.all():
            return _shortened(rows, lines, query)
        worst = int(np.argmin(free))
        found = Failed(UNSEEN, rows[worst : worst + 2])
    return failed(ground, found.ends, found.why, lines.looked, query)


def _shortened(path: Floats, lines: Edges, query: Query) -> Moved:
    """A free path (m, k), with as many short cuts as the query allows."""
    several = len(query.goals) > 1
    goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1))) if several else 0
    if len(path) > 2 and query.bridges and not query.upright_rad:
        route = Route(path, query.bridges)
        shorten(route, lines, query.bridges, query.budget)
        path = route.path()
    return Moved(path, goal, lines.looked, False, cleared_m=query.margin_m)


def bounds(joints: Joints, query: Query) -> tuple[Floats, Floats]:
    """Finite limits (k,) and (k,) to draw samples from: a joint without limits goes half a turn, or a metre, beyond the ends."""
    if not query.moving and np.isfinite(joints.upper - joints.lower).all():
        return joints.lower, joints.upper
    ends = np.vstack([query.start[None], query.goals])
    beyond = np.where(joints.prismatic, 1.0, np.pi)
    low = np.where(np.isfinite(joints.lower), joints.lower, ends.min(axis=0) - beyond)
    high = np.where(np.isfinite(joints.upper), joints.upper, ends.max(axis=0) + beyond)
    still = np.ones(joints.count, dtype=bool)
    still[list(query.moving or range(joints.count))] = False
    return np.where(still, query.start, low), np.where(still, query.start, high)


def shifted(seed: int, count: int) -> Floats:
    """How far a seed shifts the samples in each dimension (count,), from 0 to 1."""
    return np.array([(seed * GOLDEN**n) % 1.0 for n in range(1, count + 1)], dtype=float)
