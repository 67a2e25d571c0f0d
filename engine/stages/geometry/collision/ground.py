"""What motions are planned on: any checker, with lines checked whole and proofs for paths."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.geometry.edges import Edges
from cellwright.engine.kernels.geometry.lanes import Narrow
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.kernels.geometry.mechanism import Mechanism
from cellwright.engine.kernels.geometry.proof import Proof
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Contact, Floats, Joints, Piece, Scene, Truths
from cellwright.engine.ports import CollisionChecker, MotionGround
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.covering import covered
from cellwright.engine.stages.geometry.collision.difference import differing
from cellwright.engine.stages.geometry.shapes.packing import bounded, grouped

ON_AXIS_M = 1e-10  # a point that is nearer to an axis lies on it


class Ground:
    """A checker, with what planners of motions ask beside. Raises `ValueError` for a free scene, which has no joints."""

    def __init__(self, checker: CollisionChecker) -> None:
        if checker.scene.free:
            raise ValueError("a free scene has no joints that a motion could be planned for")
        self.checker = checker
        self._kept: dict[float, Narrow] = {}
        joints = checker.scene.joints
        self._mechanism = Mechanism(
            joints.parent,
            np.ascontiguousarray(joints.T_parent_origin),
            np.ascontiguousarray(joints.axis),
            joints.prismatic,
            travelled(joints),
        )

    @property
    def scene(self) -> Scene:
        """What is checked."""
        return self.checker.scene

    def collides(self, where: Floats) -> Truths:
        """As the checker says."""
        return self.checker.collides(where)

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """As the checker says."""
        return self.checker.clearance(where, beyond_m)

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """As the checker says."""
        return self.checker.contacts(where, within_m)

    def lines(self, step: float, margin_m: float = 0.0) -> Edges:
        """Lines checked by compiled kernels, where the checker has them, else by the checker, from Python."""
        scene = self._packed(margin_m)
        if isinstance(self.checker, BuiltinChecker):
            return Edges(scene, step, margin_m)

        def free(first: Floats, second: Floats) -> bool:
            away = norm(second - first)
            share = np.linspace(0.0, 1.0, max(1, math.ceil(away / step)) + 1)[1:, None]
            where = first + share * (second - first)
            if margin_m:
                return bool((self.clearance(where, margin_m + 1e-9) > margin_m).all())
            return not self.collides(where).any()

        return Edges(scene, step, margin_m, free)

    def proof(self, margin_m: float, finest_m: float) -> Proof:
        """A proof by the built-in kernels, whatever the checker is."""
        return Proof(self._packed(margin_m), self._reach, margin_m, finest_m)

    def covered(self, wrist: Sequence[int], start: Floats, goal: Floats) -> "Ground":
        """The ground where one box stands for all that the joints `wrist` carry between two configurations (k,)."""
        return Ground(BuiltinChecker(covered(self.scene, wrist, start, goal)))

    def changing(self, moving: Collection[int]) -> tuple[frozenset[int], ...]:
        """For each pair of the scene, which of the moving joints change how far apart it is.

        None are told of a pair that is moved from both sides. A joint does not count if one piece is round about its axis.
        """
        scene = self.scene
        movers: list[frozenset[int]] = [frozenset()]
        for joint, parent in enumerate(scene.joints.parent):
            movers.append(movers[parent] | ({joint} & frozenset(moving)))
        round_about = [_round_about(scene, piece) for piece in scene.pieces]
        found = []
        for i, j in scene.pairs.reshape(-1, 2).tolist():
            one, other = (movers[scene.pieces[n].carrier] for n in (i, j))
            nested = one <= other or other <= one
            found.append((one ^ other) - round_about[i] - round_about[j] if nested else frozenset())
        return tuple(found)

    def only(self, rows: Sequence[int]) -> "Ground":
        """The ground of some pairs of the scene, given by their numbers."""
        scene = self.scene
        pairs = scene.pairs.reshape(-1, 2)[list(rows)]
        kept = np.unique(pairs)
        left = np.searchsorted(kept, pairs).astype(np.int64)
        pieces = tuple(scene.pieces[n] for n in kept)
        return Ground(BuiltinChecker(replace(scene, pieces=pieces, pairs=np.ascontiguousarray(left))))

    def changed_since(self, before: MotionGround) -> "Ground | None":
        """The ground of the pairs that only this or another one has; None if their joints differ."""
        left = differing(before.scene, self.scene)
        return None if left is None else Ground(BuiltinChecker(left))

    def travel(self, first: Floats, second: Floats) -> float:
        """A bound on the way (m) of every point that moves on the straight line between two configurations (k,)."""
        return float(self.travels((second - first)[None])[0])

    def travels(self, ways: Floats) -> Floats:
        """The same bound (n,) for many motions of the joints (n, k)."""
        found: Floats = matmul(np.abs(ways), self._reach).max(axis=1, initial=0.0)
        return found

    def _packed(self, margin_m: float) -> Narrow:
        """The scene as kernels read it, packed once for each margin."""
        if margin_m not in self._kept:
            self._kept[margin_m] = Narrow(self._mechanism, *self._pack(margin_m))
        return self._kept[margin_m]

    def _pack(self, margin_m: float) -> tuple[Pieces, Pairs]:
        if isinstance(self.checker, BuiltinChecker):
            return self.checker.packed(margin_m)
        pieces, bound_of = bounded(self.scene)
        return pieces, grouped(self.scene.pairs, bound_of)

    @cached_property
    def _reach(self) -> Floats:
        return reaches(self.scene.joints, self._packed(0.0).pieces)


def reaches(joints: Joints, pieces: Pieces) -> Floats:
    """How far each piece gets from the axis of each joint at most, in any configuration (k, n).

    It is 0 where the joint does not move the piece, and 1 for a joint that slides.
    """
    steps = np.linalg.norm(joints.T_parent_origin[:, :3, 3], axis=1)
    travel = np.where(joints.prismatic, travelled(joints), 0.0)
    ball = np.linalg.norm(pieces.bounds[:, :3], axis=1) + pieces.bounds[:, 3]
    found = np.zeros((joints.count, pieces.count))
    for carrier in sorted(set(pieces.carrier.tolist())):
        on, far, joint = pieces.carrier == carrier, 0.0, carrier - 1
        while joint >= 0:
            found[joint, on] = 1.0 if joints.prismatic[joint] else far + ball[on]
            far += float(steps[joint] + travel[joint])
            joint = int(joints.parent[joint]) - 1
    return found


def travelled(joints: Joints) -> Floats:
    """How far from 0 each joint gets at most within its limits (k,), rad or m."""
    found: Floats = np.maximum(np.abs(joints.lower), np.abs(joints.upper))
    return found


def _round_about(scene: Scene, piece: Piece) -> frozenset[int]:
    """The joints, at its own carrier and at those behind it, about whose axes a piece is round: they do not move it if they turn."""
    joints, found = scene.joints, set()
    points = matmul(piece.vertices, piece.T_carrier_piece[:3, :3].T) + piece.T_carrier_piece[:3, 3]
    for joint in range(joints.count):
        if joints.prismatic[joint] or piece.carrier not in (joint + 1, joints.parent[joint]):
            continue
        T = np.eye(4) if piece.carrier == joint + 1 else joints.T_parent_origin[joint]
        axis = matmul(T[:3, :3], joints.axis[joint])
        off = np.cross(points - T[:3, 3], axis)
        if float(np.abs(off).max()) < ON_AXIS_M:
            found.add(joint)
    return frozenset(found)
