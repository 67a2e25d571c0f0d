"""The planning scene: any checker, with lines checked whole, proofs, changes and swept boxes.

A pair is the same if both pieces have the same shape, at the same place of the same carrier,
whatever their names are. So a body that was put elsewhere, taken into a hand, or given leave to
touch makes new pairs, and all others stay what they were.
"""

import math
from collections.abc import Collection, Hashable, Sequence
from dataclasses import fields, replace
from functools import cached_property
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.edges import Edges
from cellwright.engine.kernels.geometry.lanes import Narrow
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.kernels.geometry.mechanism import Mechanism
from cellwright.engine.kernels.geometry.proof import Proof
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece, Joints
from cellwright.engine.ports import CollisionChecker, MotionScene
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.carrier_poses import pose_batch
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.shapes.convex_pieces import group_pairs, pack_with_bounds
from cellwright.engine.stages.geometry.world.collision_scene import world_pieces
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld


def differing_pairs(before: CollisionScene, after: CollisionScene) -> CollisionScene | None:
    """The scene of the pairs that only one of two scenes has; None if their joints differ."""
    if not _same_joints(before, after):
        return None
    pieces: dict[Hashable, int] = {}
    distinct: list[ConvexPiece] = []
    number = [_number_pieces(scene.pieces, pieces, distinct) for scene in (before, after)]
    pairs = [
        np.unique(np.sort(of[scene.pairs.reshape(-1, 2)], axis=1), axis=0)
        for of, scene in zip(number, (before, after), strict=True)
    ]
    every, count = np.unique(np.concatenate(pairs), axis=0, return_counts=True)
    return _of_pairs(after, distinct, every[count == 1])


def _of_pairs(scene: CollisionScene, pieces: list[ConvexPiece], pairs: Longs) -> CollisionScene:
    """The scene of some pairs (m, 2) of pieces, with no piece that is in none of them."""
    used, own = np.unique(pairs, return_inverse=True)
    used_pieces = tuple(pieces[n] for n in used)
    bodies = tuple(dict.fromkeys(piece.body for piece in used_pieces))
    return CollisionScene(
        scene.joints,
        used_pieces,
        np.ascontiguousarray(own.reshape(-1, 2).astype(np.int64)),
        bodies=bodies,
    )


def _number_pieces(
    pieces: tuple[ConvexPiece, ...], numbers: dict[Hashable, int], distinct: list[ConvexPiece]
) -> Longs:
    """The number of each piece (n,): that of the same piece, if it was seen before, else a new
    one.
    """
    piece_numbers = np.zeros(len(pieces), dtype=np.int64)
    for n, piece in enumerate(pieces):
        key = _piece_identity(piece)
        if key not in numbers:
            numbers[key] = len(distinct)
            distinct.append(piece)
        piece_numbers[n] = numbers[key]
    return piece_numbers


def _piece_identity(piece: ConvexPiece) -> Hashable:
    place, shape = piece.T_carrier_piece + 0.0, piece.vertices + 0.0  # -0.0 becomes 0.0
    return piece.carrier, place.tobytes(), shape.tobytes(), piece.radius_m, piece.box


def _same_joints(first: CollisionScene, second: CollisionScene) -> bool:
    """Whether two scenes have the same joints, with the same limits."""
    names = [field.name for field in fields(first.joints)]
    return all(
        np.array_equal(getattr(first.joints, name), getattr(second.joints, name)) for name in names
    )


HAND_COVER = "the box around the hand"
# places between start and goal at which the box is measured; it grows by what moves in between
COVER_SAMPLES = 33
UNIT_BOX_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


def cover_hand(
    scene: CollisionScene, wrist: Sequence[int], start: Floats, goal: Floats
) -> CollisionScene:
    """The scene with a box for all that the joints `wrist` carry.

    The box stands on what the first of these joints stands on, and covers their values between two
    configurations (k,). It is checked against all bodies that anything in it was checked against.
    What is in it is not checked against one another.
    """
    below = int(scene.joints.parent[wrist[0]])
    inside = np.array(
        [_hangs_on(scene.joints, piece.carrier, wrist) for piece in scene.pieces], dtype=bool
    )
    low, high = _box_extent(scene, inside, below, wrist, start, goal)
    at = transforms.translation(*((low + high) / 2))
    box = ConvexPiece(HAND_COVER, below, at, UNIT_BOX_CORNERS * (high - low), 0.0, box=True)
    remaining = np.nonzero(~inside)[0]
    pieces = (*(scene.pieces[n] for n in remaining), box)
    pairs = _pairs_with_box(scene, inside, below)
    return replace(
        scene, pieces=pieces, pairs=pairs, bodies=tuple(dict.fromkeys(p.body for p in pieces))
    )


def _hangs_on(joints: Joints, carrier: int, wrist: Sequence[int]) -> bool:
    while carrier > 0:
        if carrier - 1 in wrist:
            return True
        carrier = int(joints.parent[carrier - 1])
    return False


def _box_extent(
    scene: CollisionScene,
    inside: Truths,
    below: int,
    wrist: Sequence[int],
    start: Floats,
    goal: Floats,
) -> tuple[Floats, Floats]:
    """The least and the greatest corner (3,) of what is inside, in the frame of carrier `below`."""
    share = np.linspace(0.0, 1.0, COVER_SAMPLES)[:, None]
    where = np.repeat(start[None], COVER_SAMPLES, axis=0)
    where[:, list(wrist)] += share * (goal - start)[list(wrist)]
    carriers = carrier_poses(scene.joints, where)
    inward = transforms.inverse(carriers[:, below])
    turned = np.abs(goal - start)[list(wrist)] / (COVER_SAMPLES - 1) / 2
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for piece in (scene.pieces[n] for n in np.nonzero(inside)[0]):
        points = transforms.apply(
            matmul(inward, carriers[:, piece.carrier], piece.T_carrier_piece), piece.vertices
        )
        room = piece.radius_m + _max_stray(
            scene.joints, carriers, inward, points, wrist, turned, piece.radius_m
        )
        low = np.minimum(low, points.min(axis=(0, 1)) - room)
        high = np.maximum(high, points.max(axis=(0, 1)) + room)
    return low, high


def _max_stray(
    joints: Joints,
    carriers: Floats,
    inward: Floats,
    points: Floats,
    wrist: Sequence[int],
    turned: Floats,
    radius_m: float,
) -> float:
    """How far a piece can be from the nearest of the samples: half a step of each joint, times
    the distance from its origin.
    """
    total = 0.0
    for joint, half in zip(wrist, turned, strict=True):
        if joints.prismatic[joint]:
            total += float(half)
            continue
        origin = (matmul(inward, carriers[:, joint + 1]))[:, None, :3, 3]
        away = np.linalg.norm(points - origin, axis=-1).max() + radius_m
        total += float(half) * float(away)
    return total * (1.0 + float(turned.sum()))


def _pairs_with_box(scene: CollisionScene, inside: Truths, below: int) -> Longs:
    """The pairs of the pieces that are kept, and those of the box, which has the last number."""
    number = np.cumsum(~inside) - 1
    pairs = scene.pairs.reshape(-1, 2)
    within = inside[pairs]
    remaining = number[pairs[~within.any(axis=1)]]
    mixed = pairs[within.sum(axis=1) == 1]
    partners = np.unique(mixed[~inside[mixed]])
    partners = partners[[scene.pieces[n].carrier != below for n in partners]]
    last = int((~inside).sum())
    with_box = np.stack([number[partners], np.full(len(partners), last)], axis=1)
    renewed: Longs = np.concatenate([remaining, with_box]).astype(np.int64).reshape(-1, 2)
    return renewed


ON_AXIS_M = 1e-10  # a point that is nearer to an axis lies on it


class PlanningScene:
    """A checker, with what planners of motions ask beside.

    Raises `ValueError` for a free scene, which has no joints.
    """

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
            joint_travels(joints),
        )

    @property
    def scene(self) -> CollisionScene:
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
        """Lines checked by compiled kernels, where the checker has them, else by the checker,
        from Python.
        """
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

    def covered(self, wrist: Sequence[int], start: Floats, goal: Floats) -> "PlanningScene":
        """The ground where one box stands for all that the joints `wrist` carry between two
        configurations (k,).
        """
        return PlanningScene(BuiltinChecker(cover_hand(self.scene, wrist, start, goal)))

    def changing(self, moving: Collection[int]) -> tuple[frozenset[int], ...]:
        """For each pair of the scene, which of the moving joints change how far apart it is.

        None are told of a pair that is moved from both sides. A joint does not count if one piece
        is round about its axis.
        """
        scene = self.scene
        movers: list[frozenset[int]] = [frozenset()]
        for joint, parent in enumerate(scene.joints.parent):
            movers.append(movers[parent] | ({joint} & frozenset(moving)))
        round_about = [_joints_without_effect(scene, piece) for piece in scene.pieces]
        movers_of_pairs = []
        for i, j in scene.pairs.reshape(-1, 2).tolist():
            first_movers, second_movers = (movers[scene.pieces[n].carrier] for n in (i, j))
            nested = first_movers <= second_movers or second_movers <= first_movers
            movers_of_pairs.append(
                (first_movers ^ second_movers) - round_about[i] - round_about[j]
                if nested
                else frozenset()
            )
        return tuple(movers_of_pairs)

    def only(self, rows: Sequence[int]) -> "PlanningScene":
        """The ground of some pairs of the scene, given by their numbers."""
        scene = self.scene
        pairs = scene.pairs.reshape(-1, 2)[list(rows)]
        used = np.unique(pairs)
        renumbered = np.searchsorted(used, pairs).astype(np.int64)
        pieces = tuple(scene.pieces[n] for n in used)
        return PlanningScene(
            BuiltinChecker(replace(scene, pieces=pieces, pairs=np.ascontiguousarray(renumbered)))
        )

    def changed_since(self, before: MotionScene) -> "PlanningScene | None":
        """The ground of the pairs that only this or another one has; None if their joints
        differ.
        """
        difference = differing_pairs(before.scene, self.scene)
        return None if difference is None else PlanningScene(BuiltinChecker(difference))

    def travel(self, first: Floats, second: Floats) -> float:
        """A bound on the way (m) of every point that moves on the straight line between two
        configurations (k,).
        """
        return float(self.travels((second - first)[None])[0])

    def travels(self, ways: Floats) -> Floats:
        """The same bound (n,) for many motions of the joints (n, k)."""
        distances: Floats = matmul(np.abs(ways), self._reach).max(axis=1, initial=0.0)
        return distances

    def _packed(self, margin_m: float) -> Narrow:
        """The scene as kernels read it, packed once for each margin."""
        if margin_m not in self._kept:
            self._kept[margin_m] = Narrow(self._mechanism, *self._pack(margin_m))
        return self._kept[margin_m]

    def _pack(self, margin_m: float) -> tuple[Pieces, Pairs]:
        if isinstance(self.checker, BuiltinChecker):
            return self.checker.packed(margin_m)
        pieces, bound_of = pack_with_bounds(self.scene)
        return pieces, group_pairs(self.scene.pairs, bound_of)

    @cached_property
    def _reach(self) -> Floats:
        return joint_reaches(self.scene.joints, self._packed(0.0).pieces)


def joint_reaches(joints: Joints, pieces: Pieces) -> Floats:
    """How far each piece gets from the axis of each joint at most, in any configuration (k, n).

    It is 0 where the joint does not move the piece, and 1 for a joint that slides.
    """
    steps = np.linalg.norm(joints.T_parent_origin[:, :3, 3], axis=1)
    travel = np.where(joints.prismatic, joint_travels(joints), 0.0)
    ball = np.linalg.norm(pieces.bounds[:, :3], axis=1) + pieces.bounds[:, 3]
    farthest = np.zeros((joints.count, pieces.count))
    for carrier in sorted(set(pieces.carrier.tolist())):
        on, far, joint = pieces.carrier == carrier, 0.0, carrier - 1
        while joint >= 0:
            farthest[joint, on] = 1.0 if joints.prismatic[joint] else far + ball[on]
            far += float(steps[joint] + travel[joint])
            joint = int(joints.parent[joint]) - 1
    return farthest


def joint_travels(joints: Joints) -> Floats:
    """How far from 0 each joint gets at most within its limits (k,), rad or m."""
    farthest: Floats = np.maximum(np.abs(joints.lower), np.abs(joints.upper))
    return farthest


def _joints_without_effect(scene: CollisionScene, piece: ConvexPiece) -> frozenset[int]:
    """The joints, at its own carrier and at those behind it, about whose axes a piece is round:
    they do not move it if they turn.
    """
    joints, ineffective = scene.joints, set()
    points = matmul(piece.vertices, piece.T_carrier_piece[:3, :3].T) + piece.T_carrier_piece[:3, 3]
    for joint in range(joints.count):
        if joints.prismatic[joint] or piece.carrier not in (joint + 1, joints.parent[joint]):
            continue
        T = np.eye(4) if piece.carrier == joint + 1 else joints.T_parent_origin[joint]
        axis = matmul(T[:3, :3], joints.axis[joint])
        off = np.cross(points - T[:3, 3], axis)
        if float(np.abs(off).max()) < ON_AXIS_M:
            ineffective.add(joint)
    return frozenset(ineffective)


STRETCH_M = 0.05  # of a path: so far, at most, anything moves between two looks


class SweptBoxes:
    """Some bodies of a world, and the boxes that they sweep."""

    def __init__(self, world: GeometricWorld, bodies: Collection[str]) -> None:
        own_bodies = set(bodies)
        own = tuple(piece for piece in world_pieces(world) if piece.body in own_bodies)
        names = tuple(dict.fromkeys(piece.body for piece in own))
        self._ground = PlanningScene(
            BuiltinChecker(
                CollisionScene(world.joints, own, np.zeros((0, 2), dtype=np.int64), False, names)
            )
        )
        middles = [(piece.vertices.min(axis=0) + piece.vertices.max(axis=0)) / 2 for piece in own]
        self._radius = np.array(
            [
                float(np.linalg.norm(piece.vertices - at, axis=1).max()) + piece.radius_m
                for piece, at in zip(own, middles, strict=True)
            ]
        )
        self._centre = np.array(
            [
                matmul(piece.T_carrier_piece[:3, :3], at) + piece.T_carrier_piece[:3, 3]
                for piece, at in zip(own, middles, strict=True)
            ]
        ).reshape(len(own), 3)
        self._carrier = np.array([piece.carrier for piece in own], dtype=np.int64)

    def boxes(self, path: Floats) -> Floats:
        """For each carrier the box (n, 6: least x, y, z, then greatest) around its bodies on a
        path (m, all joints).
        """
        where, half = self._looks(path)
        poses = pose_batch(self._ground.scene, where)
        boxes = []
        for carrier in np.unique(self._carrier):
            on = self._carrier == carrier
            R, t = poses[:, carrier, :, :3], poses[:, carrier, :, 3]
            centres = matmul(self._centre[on], R.transpose(0, 2, 1)) + t[:, None]
            around = self._radius[on][None, :, None] + half[:, None, None]
            boxes.append(
                np.concatenate(
                    [(centres - around).min(axis=(0, 1)), (centres + around).max(axis=(0, 1))]
                )
            )
        return np.array(boxes).reshape(-1, 6)

    def _looks(self, path: Floats) -> tuple[Floats, Floats]:
        """Configurations (n, all joints), and how far (m) anything moves on the stretch around
        each of them (n,).
        """
        if len(path) == 1:
            return path, np.zeros(1)
        ways, where, half = np.diff(path, axis=0), [], []
        far = self._ground.travels(ways)
        for start, direction, metres in zip(path, ways, far, strict=False):
            count = max(1, int(np.ceil(metres / STRETCH_M)))
            where.append(start + (np.arange(count)[:, None] + 0.5) / count * direction)
            half += [metres / count / 2] * count
        return np.concatenate(where), np.array(half)


def common_boxes(first: Floats, second: Floats) -> Floats:
    """The boxes (m, 6) that boxes (n, 6) and others (k, 6) have in common; none if they keep
    apart.
    """
    low = np.maximum(first[:, None, :3], second[None, :, :3]).reshape(-1, 3)
    high = np.minimum(first[:, None, 3:], second[None, :, 3:]).reshape(-1, 3)
    both: Floats = np.concatenate([low, high], axis=1)
    return both[(low <= high).all(axis=1)]
