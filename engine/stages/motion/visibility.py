"""ITA's planner of two levels (Becker & Garrett 1988): the hand first, as a point, then the links.

The first level finds lines of sight for the hand. The second has the arm follow them, with configurations by inverse
kinematics, and checks all links on the way. Where something would touch, it proposes sub-goals beside the place, and joins
them in the same manner.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Bytes
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.motion import Query
from cellwright.engine.ports import Hand, MotionGround
from cellwright.engine.stages.motion.reduced import Failed
from cellwright.engine.stages.motion.sight import Sights, lines_of_sight

ROOM_M = 0.1, 0.03  # what boxes grow by, for the hand: wide first, then narrow
BACK_M = 0.6  # how far the hand backs off along its own axis to get out of grown boxes
DEEP = 4  # sub-goals of sub-goals
ASIDE_M = 0.1, 0.25, 0.5  # how far beside the way sub-goals lie
TRIED = 6  # configurations of each place of the hand, and sub-goals of each gap, that are tried
GOALS = 4  # goals that are tried, the nearest first
NO_SIGHT = "the hand, taken for a point, finds no way among the boxes around what stands in the cell"
NO_LINKS = "the links cannot follow the hand: no sub-goal leads past what is in the way"
DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)],
    dtype=float,
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Following:
    """What the second level asks, and the most configurations it may look at."""

    ground: MotionGround
    lines: Edges
    hand: Hand
    query: Query
    low: Floats
    high: Floats

    def free(self, first: Floats, second: Floats) -> bool:
        """Whether the straight line between configurations (k,) is free, its ends included."""
        out: Bytes = np.zeros(1, dtype=np.uint8)
        free_edges(self.lines, np.ascontiguousarray(first[None]), np.ascontiguousarray(second[None]), out)
        return bool(out[0])

    def spent(self) -> bool:
        """Whether the budget is used up."""
        return bool(self.lines.looked >= self.query.budget)


def visibility(
    ground: MotionGround, lines: Edges, query: Query, low: Floats, high: Floats, hand: Hand
) -> tuple[Floats | Failed, int]:
    """The configurations (m, k) of a path, and the number of its goal; else what is missing for the nearest goal."""
    asks = _Following(ground, lines, hand, query, low, high)
    order = np.argsort(np.linalg.norm(query.goals - query.start, axis=1), kind="stable")
    first = None
    for goal in order[:GOALS]:
        for room_m in ROOM_M:
            found = _towards(asks, query.goals[goal], room_m + query.margin_m)
            if not isinstance(found, Failed):
                return found, int(goal)
            first = first or (found, int(goal))
    assert first is not None
    return first


def _towards(asks: _Following, goal: Floats, room_m: float) -> Floats | Failed:
    """The path to one goal, with boxes that leave some room for the hand."""
    start = asks.query.start
    if asks.free(start, goal):
        return np.array([start, goal])
    T = asks.hand.poses(np.array([start, goal]))
    poses, halves = asks.hand.boxes()
    sights = Sights(poses, halves + room_m)
    ends = [_backed_off(sights, each) for each in T]

    def reached(points: Floats) -> Truths:
        """Which points (n, 3) the hand reaches, turned as at the start or as at the goal."""
        found = np.zeros(len(points), dtype=bool)
        for each in T:
            poses = np.repeat(each[None], len(points), axis=0)
            poses[:, :3, 3] = points
            found |= np.array([len(q) > 0 for q in asks.hand.reaching(poses, start)], dtype=bool)
        return found

    seen = lines_of_sight(sights, ends[0], ends[1], reached)
    if seen is None:
        return Failed(NO_SIGHT, np.array([start, goal]))
    return _followed(asks, _places(T, seen), goal)


def _backed_off(sights: Sights, T: Floats) -> Floats:
    """The place (3,) of a hand at a pose (4, 4), or the nearest one behind it along its axis that is in no box."""
    for back in np.linspace(0.0, BACK_M, 25):
        point: Floats = T[:3, 3] - back * T[:3, 2]
        if not sights.inside(point).any():
            return point
    found: Floats = T[:3, 3]
    return found


def _places(T: Floats, seen: Floats) -> Floats:
    """Poses (m, 4, 4) of the hand at the nodes (m, 3) of its way; it turns evenly from the first pose to the last."""
    from scipy.spatial.transform import Rotation, Slerp

    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(seen, axis=0), axis=1)))
    share = along / max(along[-1], 1e-12)
    poses = np.repeat(np.eye(4)[None], len(seen), axis=0)
    poses[:, :3, :3] = Slerp([0.0, 1.0], Rotation.from_matrix(T[:, :3, :3]))(share).as_matrix()
    poses[:, :3, 3] = seen
    return poses


def _followed(asks: _Following, poses: Floats, goal: Floats) -> Floats | Failed:
    """Configurations along the hand's way, joined one after another; those nearest to the last one are tried first."""
    path, missing = [asks.query.start], asks.query.start
    choices = [*asks.hand.reaching(poses, asks.query.start), goal[None]]
    for there in choices:
        there = there[~asks.ground.collides(there)] if len(there) else there
        near = there[np.argsort(np.abs(there - path[-1]).max(axis=1), kind="stable")][:TRIED]
        for q in near:
            joined = _joined(asks, path[-1], q, DEEP if there is choices[-1] or len(near) == 1 else 1)
            if joined is not None:
                path += joined
                break
            missing = q
    if np.array_equal(path[-1], goal):
        return np.array(path)
    rest = _joined(asks, path[-1], goal, DEEP)
    return np.array([*path, *rest]) if rest else Failed(NO_LINKS, np.array([path[-1], missing]))


def _joined(asks: _Following, first: Floats, second: Floats, deep: int) -> list[Floats] | None:
    """Configurations after `first` (k,) up to `second` (k,), with sub-goals where the straight line touches something."""
    if asks.free(first, second):
        return [second]
    if deep == 0 or asks.spent():
        return None
    for between in _sub_goals(asks, first, second)[:TRIED]:
        one = _joined(asks, first, between, deep - 1 if deep < 2 else 0)
        if one is None:
            continue
        other = _joined(asks, between, second, deep - 1)
        if other is not None:
            return [*one, *other]
    return None


def _sub_goals(asks: _Following, first: Floats, second: Floats) -> Floats:
    """Free configurations (n, k) with the hand beside the middle of a gap, those with the shortest way over them first."""
    middle = (first + second) / 2
    T = asks.hand.poses(middle[None])[0]
    poses = np.repeat(T[None], 1 + len(ASIDE_M) * len(DIRECTIONS), axis=0)
    poses[1:, :3, 3] += np.concatenate([aside * DIRECTIONS for aside in ASIDE_M])
    found = np.concatenate(asks.hand.reaching(poses, middle))
    found = found[((found >= asks.low) & (found <= asks.high)).all(axis=1)]
    if not len(found):
        return found
    found = found[~asks.ground.collides(found)]
    ways = np.linalg.norm(found - first, axis=1) + np.linalg.norm(second - found, axis=1)
    ordered: Floats = found[np.argsort(ways, kind="stable")]
    return ordered
