"""Handey's planner: three joints at a time, by A* on a lattice of configurations.

It serves a space of three joints, where a lattice can still be searched to its end. The other
joints keep their values.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Bytes, Floats, Longs, Truths
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.model.motion_values import PathQuery
from cellwright.engine.ports import MotionScene

LATTICE_SPACING = 0.15  # rad or m between neighbours
MAX_EXPANDED_NODES = 4_000  # nodes whose neighbours are looked at
# how much more the distance to the goal counts than the way behind: fewer nodes, paths a little
# longer
GOAL_WEIGHT = 1.5
FREE_SHELLS = 12  # how many spacings away a free configuration is looked for

Node = tuple[int, ...]


class Lattice:
    """Configurations at a spacing around `origin` (k,) in the joints `free`, within limits (k,)."""

    def __init__(self, origin: Floats, free: Sequence[int], low: Floats, high: Floats) -> None:
        self.origin, self.free, self.low, self.high = origin, list(free), low, high
        around = product((-1, 0, 1), repeat=len(self.free))
        self.steps = np.array([step for step in around if any(step)], dtype=np.int64)

    def at(self, nodes: Longs) -> Floats:
        """The configurations (n, k) of nodes (n, free joints)."""
        where = np.repeat(self.origin[None], len(nodes), axis=0)
        where[:, self.free] += LATTICE_SPACING * nodes
        return where

    def within(self, where: Floats) -> Truths:
        """Whether configurations (n, k) are within the limits (n,)."""
        own = where[:, self.free]
        inside = (own >= self.low[self.free]) & (own <= self.high[self.free])
        return np.asarray(inside.all(axis=1))


def nearest_free(ground: MotionScene, lattice: Lattice, margin_m: float) -> Floats | None:
    """The configuration (k,) of the lattice nearest to its origin that is free; None if none is
    near.
    """
    for nodes in _lattice_shells(len(lattice.free)):
        where = lattice.at(nodes)
        where = where[lattice.within(where)]
        free = (
            ground.clearance(where, margin_m + 1e-9) > margin_m
            if margin_m
            else ~ground.collides(where)
        )
        if free.any():
            nearest: Floats = where[int(np.argmax(free))]
            return nearest
    return None


def _lattice_shells(count: int) -> Iterator[Longs]:
    """All nodes in stretches, the nearest to the origin first."""
    axis = np.arange(-FREE_SHELLS, FREE_SHELLS + 1, dtype=np.int64)
    grid = np.stack(np.meshgrid(*[axis] * count, indexing="ij"), axis=-1).reshape(-1, count)
    away = (grid**2).sum(axis=1)
    ordered = grid[np.argsort(away, kind="stable")]
    ordered = ordered[np.sort(away) <= FREE_SHELLS**2]
    return (ordered[n : n + 256] for n in range(0, len(ordered), 256))


def lattice_path(lines: Edges, lattice: Lattice, goal: Floats) -> Floats | None:
    """Configurations (m, k) from the lattice's origin to `goal` (k,) by free lines; None if the
    lattice has no way.

    The goal differs from the origin in the joints that are free alone.
    """
    straight = np.array([lattice.origin, goal])
    if _free_lines(lines, straight[:1], straight[1:])[0]:
        return straight
    root: Node = (0,) * len(lattice.free)
    behind: dict[Node, tuple[float, Node | None]] = {root: (0.0, None)}
    open_: list[tuple[float, int, Node]] = [(0.0, 0, root)]
    done: set[Node] = set()
    while open_ and len(done) < MAX_EXPANDED_NODES:
        node = heapq.heappop(open_)[2]
        if node in done:
            continue
        done.add(node)
        here_q = lattice.at(np.array([node]))
        if (
            float(np.abs(goal - here_q[0])[lattice.free].max()) <= LATTICE_SPACING
            and _free_lines(lines, here_q, straight[1:])[0]
        ):
            return np.vstack([lattice.at(np.array(_trace_nodes(behind, node))), goal[None]])
        for cost, estimate, next_node in _expand_node(
            lines, lattice, node, behind[node][0], goal, done
        ):
            if next_node not in behind or cost < behind[next_node][0] - 1e-12:
                behind[next_node] = (cost, node)
                heapq.heappush(open_, (cost + GOAL_WEIGHT * estimate, len(behind), next_node))
    return None


def _expand_node(
    lines: Edges, lattice: Lattice, node: Node, cost: float, goal: Floats, done: set[Node]
) -> list[tuple[float, float, Node]]:
    """The neighbours that a free line leads to: the cost up to there, the distance to the goal,
    the node.
    """
    nodes = np.array(
        [neighbour for neighbour in np.array(node) + lattice.steps if tuple(neighbour) not in done]
    )
    nodes = nodes.reshape(-1, len(node))
    where = lattice.at(nodes)
    inside = lattice.within(where)
    nodes, where = nodes[inside], where[inside]
    free = _free_lines(lines, np.repeat(lattice.at(np.array([node])), len(nodes), axis=0), where)
    ways = LATTICE_SPACING * np.sqrt(((nodes - np.array(node)) ** 2).sum(axis=1))
    to_goal = np.linalg.norm(goal - where, axis=1)
    rows = zip(ways, to_goal, nodes, free, strict=True)
    return [
        (cost + float(w), float(e), tuple(map(int, neighbour)))
        for w, e, neighbour, ok in rows
        if ok
    ]


def _free_lines(lines: Edges, first: Floats, second: Floats) -> Bytes:
    """Which lines between configurations (n, k) are free (n,), their ends included."""
    free_flags = np.zeros(len(first), dtype=np.uint8)
    free_edges(lines, np.ascontiguousarray(first), np.ascontiguousarray(second), free_flags)
    return free_flags


def _trace_nodes(behind: dict[Node, tuple[float, Node | None]], node: Node) -> list[Node]:
    """The nodes from the root to a node."""
    nodes: list[Node] = []
    at: Node | None = node
    while at is not None:
        nodes.append(at)
        at = behind[at][1]
    return nodes[::-1]


WRIST_JOINTS = 3  # joints that are planned for by a box
LATTICE_GOALS = 4  # goals that are tried, the nearest first
NO_ROOM = "the box around the hand is nowhere free near the {}"
NO_WAY_FOR_BOX = "the first three joints find no way for the box around the hand"
NO_EXIT = (
    "with its last three joints still, the arm finds no way between the {} and the place where "
    "the box is free"
)


@dataclass(frozen=True, slots=True, eq=False)
class FailedPath:
    """Why the three paths do not come together, and the configurations (2, k) between which one
    is missing.
    """

    why: str
    ends: Floats


def lattice_plan(
    ground: MotionScene, lines: Edges, query: PathQuery, low: Floats, high: Floats
) -> tuple[Floats | FailedPath, int]:
    """The configurations (m, k) of the three paths, and the number of the goal; else what is
    missing for the nearest goal.

    Raises `ValueError` for an arm of more than six joints, or of less than four.
    """
    joints = list(query.moving or range(ground.scene.joints.count))
    if not WRIST_JOINTS < len(joints) <= 2 * WRIST_JOINTS:
        raise ValueError(
            f"the reduced planner is for arms of four to six joints, not {len(joints)}"
        )
    first = None
    for goal in np.argsort(np.linalg.norm(query.goals - query.start, axis=1), kind="stable")[
        :LATTICE_GOALS
    ]:
        joined = _join_three_paths(
            ground,
            lines,
            query,
            query.goals[goal],
            (joints[:-WRIST_JOINTS], joints[-WRIST_JOINTS:]),
            (low, high),
        )
        if not isinstance(joined, FailedPath):
            return joined, int(goal)
        first = first or (joined, int(goal))
    assert first is not None
    return first


def _join_three_paths(
    ground: MotionScene,
    lines: Edges,
    query: PathQuery,
    goal: Floats,
    joints: tuple[list[int], list[int]],
    limits: tuple[Floats, Floats],
) -> Floats | FailedPath:
    """The three paths to one goal, one after the other."""
    start, (arm, wrist) = query.start, joints
    box = ground.covered(wrist, start, goal)
    leaving = nearest_free(box, Lattice(start, arm, *limits), query.margin_m)
    entering = nearest_free(box, Lattice(goal, arm, *limits), query.margin_m)
    if leaving is None or entering is None:
        return FailedPath(
            NO_ROOM.format("start" if leaving is None else "goal"), np.array([start, goal])
        )
    still = entering.copy()
    still[wrist] = leaving[wrist]
    middle = lattice_path(
        box.lines(query.step, query.margin_m), Lattice(leaving, arm, *limits), still
    )
    if middle is None:
        return FailedPath(NO_WAY_FOR_BOX, np.array([leaving, still]))
    out = lattice_path(lines, Lattice(start, arm, *limits), leaving)
    back = lattice_path(lines, Lattice(goal, arm, *limits), entering)
    if out is None or back is None:
        name, ends = ("start", (start, leaving)) if out is None else ("goal", (entering, goal))
        return FailedPath(NO_EXIT.format(name), np.array(ends))
    return np.concatenate([out[:-1], _turn_wrist(middle, wrist, entering), back[::-1][1:]])


def _turn_wrist(middle: Floats, wrist: list[int], last: Floats) -> Floats:
    """The path (m, k) on which the last joints turn evenly to the values of `last` (k,) on the
    way.
    """
    if len(middle) < 2 or not np.abs(np.diff(middle, axis=0)).any():
        return np.array([middle[0], last])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1)))
    turned = middle.copy()
    turned[:, wrist] += (along / along[-1])[:, None] * (last - middle[0])[wrist]
    return turned
