"""Collision by a region tree for cells with many standing pieces, likeliest pairs first.

Neither changes an answer; both are found once for a scene.
"""

import math
from dataclasses import replace
from functools import cached_property
from itertools import groupby

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.hierarchy import Hierarchy
from cellwright.engine.kernels.geometry.layout import AXES, BALL, HALF, RADIUS, Pairs, Pieces
from cellwright.engine.model.geometry import CollisionScene, Contact, Joints
from cellwright.engine.stages.geometry.collision.carrier_poses import (
    batch_of_one,
    checked_poses,
    pose_batch,
    split_batch,
)
from cellwright.engine.stages.geometry.core_threads import run_in_stretches
from cellwright.engine.stages.geometry.region_tree import RegionTree, hierarchy_over, nested_boxes
from cellwright.engine.stages.geometry.shapes.convex_pieces import (
    group_pairs,
    nearest_of_bodies,
    pack_pieces,
    pack_with_bounds,
    select_pieces,
)

POSE_SAMPLES = 512
MAX_PAIRS_TRIED = 16  # pairs that are tried before a walk down a tree
MIN_SETTLED_SHARE = 0.03  # of the poses that are left


def touchable_pairs(scene: CollisionScene, pieces: Pieces, within_m: float = 0.0) -> Truths:
    """Which pairs (m,) come within a distance of each other in some configuration, as far as
    their reach tells.
    """
    if scene.free or not len(scene.pairs):
        return np.ones(len(scene.pairs), dtype=bool)
    anchors, reach = _carrier_reaches(scene.joints)
    carrier, bounds = pieces.carrier, pieces.bounds
    around = anchors[carrier]
    far = reach[carrier] + np.linalg.norm(bounds[:, :3], axis=1) + bounds[:, BALL]
    i, j = scene.pairs.T
    first_moves, both = carrier[i] != 0, (carrier[i] != 0) & (carrier[j] != 0)
    moving, second_carrier = np.where(first_moves, i, j), np.where(first_moves, j, i)
    gap = _block_gap(bounds[second_carrier], around[moving]) - far[moving]
    apart = np.linalg.norm(around[i] - around[j], axis=1) - far[i] - far[j]
    kept: Truths = np.where(both, apart, gap) <= within_m
    return kept


def reachable_pieces(scene: CollisionScene, moving: Pieces, standing: Pieces) -> Truths:
    """Which of the standing pieces (m,) come within the reach of some moving piece."""
    if scene.free:
        return np.ones(standing.count, dtype=bool)
    anchors, reach = _carrier_reaches(scene.joints)
    far = (
        reach[moving.carrier]
        + np.linalg.norm(moving.bounds[:, :3], axis=1)
        + moving.bounds[:, BALL]
    )
    within_reach = np.zeros(standing.count, dtype=bool)
    for carrier in sorted(set(moving.carrier.tolist())):
        around = np.broadcast_to(anchors[carrier], (standing.count, 3))
        within_reach |= _block_gap(standing.bounds, around) <= far[moving.carrier == carrier].max()
    return within_reach


def _carrier_reaches(joints: Joints) -> tuple[Floats, Floats]:
    """For each carrier (k + 1,) the point about which the first of its joints turns, and how
    far its origin gets from it.
    """
    anchors, reach = np.zeros((joints.count + 1, 3)), np.zeros(joints.count + 1)
    for index, parent in enumerate(joints.parent):
        travel = (
            max(abs(joints.lower[index]), abs(joints.upper[index]))
            if joints.prismatic[index]
            else 0.0
        )
        step = joints.T_parent_origin[index, :3, 3]
        anchors[index + 1] = anchors[parent] if parent else step
        reach[index + 1] = reach[parent] + travel + (float(np.linalg.norm(step)) if parent else 0.0)
    return anchors, reach


def _block_gap(bounds: Floats, points: Floats) -> Floats:
    """How far points (n, 3) are from the blocks of bounds (n, 18) in the world, less the
    pieces' radii.
    """
    axes = bounds[:, AXES:HALF].reshape(-1, 3, 3)
    along = np.abs(np.einsum("nij,nj->ni", axes, points - bounds[:, :3]))
    gap: Floats = (
        np.linalg.norm((along - bounds[:, HALF:RADIUS]).clip(min=0.0), axis=1) - bounds[:, RADIUS]
    )
    return gap


def sample_configurations(joints: Joints) -> Floats:
    """Configurations (n, k) within the limits, of unlimited joints within a half-turn or a
    metre.
    """
    span = np.where(joints.prismatic, 1.0, math.pi)
    low = np.where(np.isfinite(joints.lower), joints.lower, -span)
    high = np.where(np.isfinite(joints.upper), joints.upper, span)
    configurations: Floats = np.random.default_rng(0).uniform(
        low, high, (POSE_SAMPLES, joints.count)
    )
    return configurations


def sort_by_likelihood(poses: Floats, pieces: Pieces, pairs: Pairs) -> Pairs:
    """The pairs with the groups first that touch most often in carrier poses (n, k + 1, 3, 4)."""
    from cellwright.engine.kernels.geometry.checks import count_hits

    hits = np.zeros(len(pairs.groups), dtype=np.int64)
    count_hits(poses, pieces, pairs, hits)
    groups = np.ascontiguousarray(pairs.groups[np.argsort(-hits, kind="stable")])
    return Pairs(pairs.pairs, groups, pairs.after, pairs.order)


def decisive_pairs(hits: Longs) -> Longs:
    """Few pairs (k, 2) of which one touches in as many poses as possible, the best first; at most
    `MOST_TRIED`.

    `hits` (m, 3) are a pose and two numbers of a pair each. A pair is worth a try in every pose if
    it settles a share `WORTH` of the poses that those before it leave open; poses in which nothing
    touches never count as settled.
    """
    pairs, pair_number = np.unique(hits[:, 1:], axis=0, return_inverse=True)
    pair_number, pose, decisive = pair_number.reshape(-1), hits[:, 0], list[int]()
    unsettled = POSE_SAMPLES
    while len(decisive) < MAX_PAIRS_TRIED and len(pose):
        gains = np.bincount(pair_number, minlength=len(pairs))
        best = int(gains.argmax())
        if gains[best] < MIN_SETTLED_SHARE * unsettled:
            break
        decisive.append(best)
        unsettled -= int(gains[best])
        open_poses = ~np.isin(pose, pose[pair_number == best])
        pose, pair_number = pose[open_poses], pair_number[open_poses]
    chosen: Longs = pairs[decisive].astype(np.int64).reshape(-1, 2)
    return chosen


NO_HITS_YET = np.full((4, 2), -1, dtype=np.int64)  # places for what has just touched
# standing pieces within reach: pairs of so few are compared in less time than a walk takes
FEW_STANDING = 40
AT_FIRST = 100_000  # hits that there is room for without a second look


def tree_of_scene(scene: CollisionScene) -> RegionTree:
    """What stands in a scene: a region for each body, with boxes inside it when it is made of
    many pieces.
    """
    standing = sorted(
        (piece for piece in scene.pieces if piece.carrier == 0), key=lambda piece: piece.body
    )
    bodies = groupby(standing, key=lambda piece: piece.body)
    regions = [region for body, pieces in bodies for region in nested_boxes(body, list(pieces))]
    return RegionTree.of([]).attached(regions, nested=True)


class RegionChecker:
    """A scene's arms, or its body that flies free, against a region tree."""

    def __init__(self, scene: CollisionScene) -> None:
        self._scene = scene
        self.tree = tree_of_scene(scene)
        self._asking = [piece for piece in scene.pieces if piece.carrier != 0]
        self._pieces = pack_pieces(self._asking)
        self._pairs = self._moving_pairs()
        self._skip = self._skipped()
        self._near = self._reachable()

    def _reachable(self) -> tuple[Pieces, Hierarchy, Truths]:
        """The standing pieces that something can touch, the boxes over them, and which each
        asking piece may touch.
        """
        use = np.zeros(self.tree.pieces.count, dtype=bool)
        use[list(self.tree.index.numbers.values())] = True
        use &= reachable_pieces(self._scene, self._pieces, self.tree.pieces) & ~self._skip.all(
            axis=0
        )
        numbers = np.nonzero(use)[0]
        self._near_numbers = frozenset(numbers.tolist())
        near = select_pieces(self.tree.pieces, numbers)
        return near, hierarchy_over(near), np.ascontiguousarray(self._skip[:, numbers])

    @cached_property
    def _likely(self) -> Longs:
        """What is tried first in a large batch; before one it is worth finding out what touches
        most often.
        """
        from cellwright.engine.kernels.geometry.sampling import all_hits

        standing, hierarchy, skip = self._near
        poses = pose_batch(self._scene, sample_configurations(self._scene.joints))
        asked = poses, self._pieces, standing, hierarchy, self._pairs, skip
        likely_hits = np.empty((AT_FIRST, 3), np.int64)
        count = all_hits(*asked, likely_hits)
        if count > AT_FIRST:
            likely_hits = np.empty((count, 3), np.int64)
            all_hits(*asked, likely_hits)
        return np.concatenate([decisive_pairs(likely_hits[:count]), NO_HITS_YET])

    @cached_property
    def _pairwise(self) -> tuple[Pieces, Pairs] | None:
        """The pieces and the pairs that can touch, the likeliest first; None if more than a few
        standing pieces are in reach.
        """
        standing, numbers = self._near[0], self._near_numbers
        if standing.count > FEW_STANDING or self._scene.free:
            return None
        near = {
            self.tree.regions[name].piece.body
            for name, n in self.tree.index.numbers.items()
            if n in numbers
        }
        in_question = np.array(
            [piece.carrier != 0 or piece.body in near for piece in self._scene.pieces], dtype=bool
        )
        pairs = self._scene.pairs.reshape(-1, 2)
        pairs = (np.cumsum(in_question) - 1)[pairs[in_question[pairs].all(axis=1)]]
        pieces = tuple(
            piece for piece, use in zip(self._scene.pieces, in_question, strict=True) if use
        )
        scene = replace(self._scene, pieces=pieces, pairs=pairs)
        packed, bound_of = pack_with_bounds(scene)
        touching = group_pairs(pairs, bound_of, touchable_pairs(scene, packed))
        return packed, sort_by_likelihood(
            pose_batch(scene, sample_configurations(scene.joints)), packed, touching
        )

    @property
    def scene(self) -> CollisionScene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        from cellwright.engine.kernels.geometry.regions import first_hits

        where, endless = split_batch(self._scene, where)
        if len(where) > POSE_SAMPLES and self._pairwise is not None:
            return endless | self._by_pairs(where, *self._pairwise)
        standing, hierarchy, skip = self._near
        hits = np.zeros(len(where), dtype=bool)
        likely = NO_HITS_YET if self._scene.free or len(where) <= POSE_SAMPLES else self._likely

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), hits[first:after]
            first_hits(poses, self._pieces, standing, hierarchy, self._pairs, skip, likely, out)

        run_in_stretches(len(where), look)
        hits |= endless
        return hits

    def _by_pairs(self, where: Floats, pieces: Pieces, pairs: Pairs) -> Truths:
        """`collides` for a checked batch, by comparing pairs."""
        from cellwright.engine.kernels.geometry.checks import first_contacts

        first = np.empty(len(where), dtype=np.int64)

        def look(begin: int, end: int) -> None:
            first_contacts(
                checked_poses(self._scene, where[begin:end]), pieces, pairs, first[begin:end]
            )

        run_in_stretches(len(where), look)
        touching: Truths = first >= 0
        return touching

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        from cellwright.engine.kernels.geometry.regions import nearest_hits

        where, endless = split_batch(self._scene, where)
        pieces, hierarchy = self.tree.pieces, self.tree.hierarchy
        clearances, beyond = np.empty(len(where)), float(beyond_m)

        def look(first: int, after: int) -> None:
            poses, out = pose_batch(self._scene, where[first:after]), clearances[first:after]
            nearest_hits(
                poses, self._pieces, pieces, hierarchy, self._pairs, self._skip, beyond, out
            )

        run_in_stretches(len(where), look)
        clearances[endless] = -np.inf
        return clearances

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        poses = pose_batch(self._scene, batch_of_one(self._scene, where))
        contacts, checked = self._among_moving(poses, within_m), self._checked
        for piece in self._asking:
            T = np.vstack([poses[0, piece.carrier], [0.0, 0.0, 0.0, 1.0]])
            near = self.tree.contacts([piece], T, within_m)
            contacts += [
                contact for contact in near if frozenset((contact.first, contact.second)) in checked
            ]
        return nearest_of_bodies(contacts)

    def _among_moving(self, poses: Floats, within_m: float) -> list[Contact]:
        from cellwright.engine.kernels.geometry.checks import near_pairs

        distance, witness = np.empty(len(self._pairs)), np.empty((len(self._pairs), 9))
        near_pairs(poses, self._pieces, self._pairs, float(within_m), distance, witness)
        contacts = []
        for m in np.nonzero(distance <= within_m)[0]:
            first, second = (self._asking[number].body for number in self._pairs[m])
            parts = (part.copy() for part in np.split(witness[m], 3))
            contacts.append(Contact(first, second, float(distance[m]), *parts))
        return contacts

    def _moving_pairs(self) -> Longs:
        """The scene's pairs that move both, as the asking pieces are numbered."""
        moves = np.array([piece.carrier != 0 for piece in self._scene.pieces], dtype=bool)
        number, pairs = np.cumsum(moves) - 1, self._scene.pairs.reshape(-1, 2)
        moving: Longs = number[pairs[moves[pairs].all(axis=1)]]
        return moving.astype(np.int64)

    @cached_property
    def _checked(self) -> frozenset[frozenset[str]]:
        """The pairs of bodies that must not touch."""
        pieces = self._scene.pieces
        names, number = np.unique(
            np.array([piece.body for piece in pieces], dtype=object), return_inverse=True
        )
        pairs = np.unique(np.sort(number[self._scene.pairs.reshape(-1, 2)], axis=1), axis=0)
        return frozenset(frozenset((names[i], names[j])) for i, j in pairs.tolist())

    def _skipped(self) -> Truths:
        """Which standing pieces each asking piece may touch (asking, standing)."""
        column = {
            body: n
            for n, body in enumerate(dict.fromkeys(piece.body for piece in self._scene.pieces))
        }
        body = np.array([column[piece.body] for piece in self._scene.pieces], dtype=np.int64)
        asking, rows = np.unique(
            [column[piece.body] for piece in self._asking], return_inverse=True
        )
        row = np.full(len(column), -1)
        row[asking.astype(np.int64)] = np.arange(len(asking))
        # last: bodies that the scene does not have
        may = np.ones((len(asking), len(column) + 1), dtype=bool)
        i, j = body[self._scene.pairs.reshape(-1, 2)].T
        for first, second in ((i, j), (j, i)):
            may[row[first[row[first] >= 0]], second[row[first] >= 0]] = False
        at = np.full(self.tree.pieces.count, len(column), dtype=np.int64)
        for name, number in self.tree.index.numbers.items():
            at[number] = column.get(self.tree.regions[name].piece.body, len(column))
        return np.ascontiguousarray(may[rows][:, at])
