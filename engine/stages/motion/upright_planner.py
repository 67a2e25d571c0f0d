"""Paths on which what is in hand stays upright: it may turn about the vertical and tilt a little.

Trees grow as in RRT-Connect, but each step is brought back to where nothing is tilted, by inverse
kinematics (a projection, as in Berenson and others 2009). Between two such configurations the tilt
is at most half of what the joints turn in all, so steps are as short as the tilt that is allowed.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.geometry.angles import angles_of
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Joints
from cellwright.engine.model.motion_values import PathQuery
from cellwright.engine.ports import MotionScene, MovingHand
from cellwright.engine.stages.motion.lattice_planner import FailedPath

UP_AXIS = np.array([0.0, 0.0, 1.0])
STEP_SHARE = 0.9  # of the longest step that the tilt allows
ASTRAY_RAD = 0.5  # rad: a step that ends so far from where it was meant to is given up
MAX_UPRIGHT_SAMPLES, MAX_UPRIGHT_NODES, MAX_UPRIGHT_CUTS = 300, 6000, 60
MIN_CUT_STEPS = 2.0  # the least share of a way that a short cut must span, in steps
NO_UPRIGHT_WAY = "the arm finds no way on which what is in hand stays upright"
TILTED_GOAL = (
    "what is in hand is tilted by {:.1f} degrees at the goal, more than the {:.1f} that are allowed"
)


@dataclass(frozen=True, slots=True, eq=False)
class UprightLevel:
    """What stays upright: the direction `up` (3,) in the hand's frame, to within `tilt_rad`."""

    hand: MovingHand
    up: Floats
    tilt_rad: float

    @classmethod
    def at(cls, hand: MovingHand, q: Floats, tilt_rad: float) -> "UprightLevel":
        """What is upright at a configuration (k,) stays so."""
        return cls(hand, matmul(hand.poses(q[None])[0, :3, :3].T, UP_AXIS), tilt_rad)

    def tilts(self, q: Floats) -> Floats:
        """How far it is tilted in configurations (n, k), in rad (n,)."""
        height = np.clip(matmul(self.hand.poses(q)[:, :3, :3], self.up)[:, 2], -1.0, 1.0)
        return angles_of(np.sqrt((1.0 - height) * (1.0 + height)), height)

    def holds(self, path: Floats, joints: Joints) -> Truths:
        """Whether it stays upright everywhere on each line of a path (m, k): (m - 1,), true
        only where that is certain.
        """
        tilts = self.tilts(path)
        turned = np.abs(np.diff(path, axis=0))[:, ~joints.prismatic].sum(axis=1)
        return np.asarray((tilts[1:] + tilts[:-1] + turned) / 2 <= self.tilt_rad + 1e-9)

    def back(self, q: Floats, astray: float = ASTRAY_RAD) -> Floats | None:
        """The configuration (k,) near one where nothing is tilted, with the hand in the same
        place.
        """
        T = self.hand.poses(q[None])[0]
        leaning = matmul(T[:3, :3], self.up)
        T[:3, :3] = matmul(_upright_rotation(leaning), T[:3, :3])
        solutions = self.hand.reaching(T[None], q)[0]
        if not len(solutions) or np.abs(solutions[0] - q).max() > astray:
            return None
        nearest: Floats = solutions[0]
        return nearest


def _upright_rotation(leaning: Floats) -> Floats:
    """The least rotation (3, 3) that brings a unit vector (3,) upright."""
    cross, cosine = np.cross(leaning, UP_AXIS), float(leaning[2])
    x, y, z = cross
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    aligned: Floats = (
        np.eye(3) + skew + matmul(skew, skew) / (1.0 + cosine)
        if cosine > -0.999999
        else np.diag([1.0, -1.0, -1.0])
    )
    return aligned


class _UprightTrees:
    """Two trees of upright configurations."""

    def __init__(
        self, ground: MotionScene, lines: Edges, query: PathQuery, level: UprightLevel
    ) -> None:
        self.lines, self.level, self.joints = lines, level, ground.scene.joints
        self.step, self.budget = STEP_SHARE * 2.0 * query.upright_rad, query.budget
        self.nodes = [[query.start], list(query.goals)]
        self.parents = [[-1], [-1] * len(query.goals)]

    def towards(self, q: Floats, target: Floats) -> list[Floats]:
        """Upright configurations after `q` (k,) in steps towards another, as far as that is
        free; the last may be the target.
        """
        path: list[Floats] = []
        while self.lines.looked < self.budget and len(path) < MAX_UPRIGHT_NODES:
            remaining = target - q
            turned = float(np.abs(remaining)[~self.joints.prismatic].sum())
            target_q = (
                target
                if turned <= self.step
                else self.level.back(q + remaining * (0.7 * self.step / turned))
            )
            if (
                target_q is None
                or not self._ok(q, target_q)
                or _distance_to(target_q, target) >= _distance_to(q, target) - 1e-6
            ):
                return path
            path.append(target_q)
            if target_q is target:
                return path
            q = target_q
        return path

    def _ok(self, first: Floats, second: Floats) -> bool:
        if not self.level.holds(np.array([first, second]), self.joints)[0]:
            return False
        inside = (second >= self.joints.lower - 1e-9) & (second <= self.joints.upper + 1e-9)
        out = np.zeros(1, dtype=np.uint8)
        free_edges(
            self.lines, np.ascontiguousarray(first[None]), np.ascontiguousarray(second[None]), out
        )
        return bool(out[0]) and bool(inside.all())

    def grow(self, side: int, target: Floats) -> int:
        """Grow a tree towards a configuration, and say which node is its last."""
        near = int(np.argmin(np.linalg.norm(np.array(self.nodes[side]) - target, axis=1)))
        for q in self.towards(self.nodes[side][near], target):
            self.nodes[side].append(q)
            self.parents[side].append(near)
            near = len(self.nodes[side]) - 1
        return near

    def branch(self, side: int, node: int) -> list[Floats]:
        """The configurations from a node to the root of its tree."""
        branches = []
        while node >= 0:
            branches.append(self.nodes[side][node])
            node = self.parents[side][node]
        return branches


def upright_plan(
    ground: MotionScene, lines: Edges, query: PathQuery, low: Floats, high: Floats, hand: MovingHand
) -> tuple[Floats | FailedPath, int]:
    """The configurations (m, k) of an upright path, and the number of its goal; else why there
    is none.
    """
    level = UprightLevel.at(hand, query.start, query.upright_rad)
    tilts = level.tilts(query.goals)
    level_goals = np.nonzero(tilts <= query.upright_rad)[0]
    if not len(level_goals):
        n = int(np.argmin(tilts))
        why = TILTED_GOAL.format(float(np.degrees(tilts[n])), float(np.degrees(query.upright_rad)))
        return FailedPath(why, np.array([query.start, query.goals[n]])), n
    growing = _UprightTrees(ground, lines, query, level)
    growing.nodes[1] = [query.goals[n] for n in level_goals]
    growing.parents[1] = [-1] * len(level_goals)
    path = _path_when_met(growing, query, low, high)
    if path is None:
        return FailedPath(
            NO_UPRIGHT_WAY, np.array([query.start, query.goals[level_goals[0]]])
        ), int(level_goals[0])
    path = _short_cuts(growing, path, query)
    goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1)))
    return path, goal


def _path_when_met(
    growing: _UprightTrees, query: PathQuery, low: Floats, high: Floats
) -> Floats | None:
    """The path (m, k) once both trees have met; None if they do not."""
    rng, side = np.random.default_rng(query.seed), 0
    level_goals = range(len(growing.nodes[1]))
    for n in range(MAX_UPRIGHT_SAMPLES + len(level_goals)):
        if (
            growing.lines.looked >= query.budget
            or len(growing.nodes[0]) + len(growing.nodes[1]) > MAX_UPRIGHT_NODES
        ):
            return None
        goals = growing.nodes[1]
        drawn = (
            growing.level.back(rng.uniform(low, high), np.inf) if n >= len(level_goals) else None
        )
        sample = goals[n] if n < len(level_goals) else drawn
        if sample is None:
            continue
        reached = growing.grow(side, sample)
        tip = growing.nodes[side][reached]
        met = growing.grow(1 - side, tip)
        if np.array_equal(growing.nodes[1 - side][met], tip):
            ends = (reached, met) if side == 0 else (met, reached)
            first, second = growing.branch(0, ends[0]), growing.branch(1, ends[1])
            return np.array([*first[::-1], *second[1:]])
        side = 1 - side
    return None


def _short_cuts(growing: _UprightTrees, path: Floats, query: PathQuery) -> Floats:
    """The path with short cuts that are upright, too."""
    rng = np.random.default_rng(query.seed)
    for _ in range(min(MAX_UPRIGHT_CUTS, query.bridges)):
        if len(path) < 4:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        now = float(np.linalg.norm(np.diff(path[i : j + 1], axis=0), axis=1).sum())
        if j - i < MIN_CUT_STEPS or norm(path[j] - path[i]) > 0.95 * now:
            continue
        cut = growing.towards(path[i], path[j])
        if (cut and cut[-1] is path[j]) or (cut and np.array_equal(cut[-1], path[j])):
            new = np.array([path[i], *cut])
            if np.linalg.norm(np.diff(new, axis=0), axis=1).sum() < now:
                path = np.concatenate([path[:i], new, path[j + 1 :]])
    return path


def _distance_to(q: Floats, target: Floats) -> float:
    return norm(q - target)
