"""Paths on which what is in hand stays upright, as an open vessel must: it may turn about the vertical, and tilt a little.

Trees grow as in RRT-Connect, but each step is brought back to where nothing is tilted, by inverse kinematics (a projection, as
in Berenson and others 2009). Between two such configurations the tilt is at most half of what the joints turn in all, so steps
are as short as the tilt that is allowed.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.geometry.angles import angles_of
from cellwright.engine.kernels.geometry.edges import Edges, free_edges
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Joints, Truths
from cellwright.engine.model.motion import Query
from cellwright.engine.ports import Hand, MotionGround
from cellwright.engine.stages.motion.reduced import Failed

UP = np.array([0.0, 0.0, 1.0])
PIECE = 0.9  # of the longest step that the tilt allows
ASTRAY = 0.5  # rad: a step that ends so far from where it was meant to is given up
SAMPLES, NODES, CUTS = 300, 6000, 60
SPACE = 2.0  # the least share of a way that a short cut must span, in steps
NO_WAY = "the arm finds no way on which what is in hand stays upright"
TILTED = "what is in hand is tilted by {:.1f} degrees at the goal, more than the {:.1f} that are allowed"


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """What stays upright: the direction `up` (3,) in the hand's frame, to within `tilt_rad`."""

    hand: Hand
    up: Floats
    tilt_rad: float

    @classmethod
    def at(cls, hand: Hand, q: Floats, tilt_rad: float) -> "Level":
        """What is upright at a configuration (k,) stays so."""
        return cls(hand, matmul(hand.poses(q[None])[0, :3, :3].T, UP), tilt_rad)

    def tilts(self, q: Floats) -> Floats:
        """How far it is tilted in configurations (n, k), in rad (n,)."""
        height = np.clip(matmul(self.hand.poses(q)[:, :3, :3], self.up)[:, 2], -1.0, 1.0)
        return angles_of(np.sqrt((1.0 - height) * (1.0 + height)), height)

    def holds(self, path: Floats, joints: Joints) -> Truths:
        """Whether it stays upright everywhere on each line of a path (m, k): (m - 1,), true only where that is certain."""
        tilts = self.tilts(path)
        turned = np.abs(np.diff(path, axis=0))[:, ~joints.prismatic].sum(axis=1)
        return np.asarray((tilts[1:] + tilts[:-1] + turned) / 2 <= self.tilt_rad + 1e-9)

    def back(self, q: Floats, astray: float = ASTRAY) -> Floats | None:
        """The configuration (k,) near one where nothing is tilted, with the hand in the same place."""
        T = self.hand.poses(q[None])[0]
        leaning = matmul(T[:3, :3], self.up)
        T[:3, :3] = matmul(_aligning(leaning), T[:3, :3])
        found = self.hand.reaching(T[None], q)[0]
        if not len(found) or np.abs(found[0] - q).max() > astray:
            return None
        nearest: Floats = found[0]
        return nearest


def _aligning(leaning: Floats) -> Floats:
    """The least rotation (3, 3) that brings a unit vector (3,) upright."""
    cross, cosine = np.cross(leaning, UP), float(leaning[2])
    x, y, z = cross
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    found: Floats = (
        np.eye(3) + skew + matmul(skew, skew) / (1.0 + cosine)
        if cosine > -0.999999
        else np.diag([1.0, -1.0, -1.0])
    )
    return found


class _Growing:
    """Two trees of upright configurations."""

    def __init__(self, ground: MotionGround, lines: Edges, query: Query, level: Level) -> None:
        self.lines, self.level, self.joints = lines, level, ground.scene.joints
        self.step, self.budget = PIECE * 2.0 * query.upright_rad, query.budget
        self.nodes = [[query.start], list(query.goals)]
        self.parents = [[-1], [-1] * len(query.goals)]

    def towards(self, q: Floats, target: Floats) -> list[Floats]:
        """Upright configurations after `q` (k,) in steps towards another, as far as that is free; the last may be the target."""
        way: list[Floats] = []
        while self.lines.looked < self.budget and len(way) < NODES:
            left = target - q
            turned = float(np.abs(left)[~self.joints.prismatic].sum())
            there = target if turned <= self.step else self.level.back(q + left * (0.7 * self.step / turned))
            if there is None or not self._ok(q, there) or _away(there, target) >= _away(q, target) - 1e-6:
                return way
            way.append(there)
            if there is target:
                return way
            q = there
        return way

    def _ok(self, first: Floats, second: Floats) -> bool:
        if not self.level.holds(np.array([first, second]), self.joints)[0]:
            return False
        inside = (second >= self.joints.lower - 1e-9) & (second <= self.joints.upper + 1e-9)
        out = np.zeros(1, dtype=np.uint8)
        free_edges(self.lines, np.ascontiguousarray(first[None]), np.ascontiguousarray(second[None]), out)
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
        found = []
        while node >= 0:
            found.append(self.nodes[side][node])
            node = self.parents[side][node]
        return found


def upright(
    ground: MotionGround, lines: Edges, query: Query, low: Floats, high: Floats, hand: Hand
) -> tuple[Floats | Failed, int]:
    """The configurations (m, k) of an upright path, and the number of its goal; else why there is none."""
    level = Level.at(hand, query.start, query.upright_rad)
    tilts = level.tilts(query.goals)
    level_goals = np.nonzero(tilts <= query.upright_rad)[0]
    if not len(level_goals):
        n = int(np.argmin(tilts))
        why = TILTED.format(float(np.degrees(tilts[n])), float(np.degrees(query.upright_rad)))
        return Failed(why, np.array([query.start, query.goals[n]])), n
    growing = _Growing(ground, lines, query, level)
    growing.nodes[1] = [query.goals[n] for n in level_goals]
    growing.parents[1] = [-1] * len(level_goals)
    path = _met(growing, query, low, high)
    if path is None:
        return Failed(NO_WAY, np.array([query.start, query.goals[level_goals[0]]])), int(level_goals[0])
    path = _cut(growing, path, query)
    goal = int(np.argmin(np.abs(query.goals - path[-1]).max(axis=1)))
    return path, goal


def _met(growing: _Growing, query: Query, low: Floats, high: Floats) -> Floats | None:
    """The path (m, k) once both trees have met; None if they do not."""
    rng, side = np.random.default_rng(query.seed), 0
    level_goals = range(len(growing.nodes[1]))
    for n in range(SAMPLES + len(level_goals)):
        if growing.lines.looked >= query.budget or len(growing.nodes[0]) + len(growing.nodes[1]) > NODES:
            return None
        goals = growing.nodes[1]
        drawn = growing.level.back(rng.uniform(low, high), np.inf) if n >= len(level_goals) else None
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


def _cut(growing: _Growing, path: Floats, query: Query) -> Floats:
    """The path with short cuts that are upright, too."""
    rng = np.random.default_rng(query.seed)
    for _ in range(min(CUTS, query.bridges)):
        if len(path) < 4:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        now = float(np.linalg.norm(np.diff(path[i : j + 1], axis=0), axis=1).sum())
        if j - i < SPACE or norm(path[j] - path[i]) > 0.95 * now:
            continue
        way = growing.towards(path[i], path[j])
        if (way and way[-1] is path[j]) or (way and np.array_equal(way[-1], path[j])):
            new = np.array([path[i], *way])
            if np.linalg.norm(np.diff(new, axis=0), axis=1).sum() < now:
                path = np.concatenate([path[:i], new, path[j + 1 :]])
    return path


def _away(q: Floats, target: Floats) -> float:
    return norm(q - target)
