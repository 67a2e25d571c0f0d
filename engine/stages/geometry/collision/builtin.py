"""The built-in geometry backend: collision checks by compiled kernels over packed arrays."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.checks import first_contacts, near_pairs, nearest_pairs
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece
from cellwright.engine.ports import CollisionChecker
from cellwright.engine.stages.geometry.collision.carrier_poses import (
    as_batch,
    batch_of_one,
    checked_poses,
    is_finite,
    pose_batch,
    split_batch,
)
from cellwright.engine.stages.geometry.collision.region_checker import (
    POSE_SAMPLES,
    RegionChecker,
    sample_configurations,
    sort_by_likelihood,
    touchable_pairs,
)
from cellwright.engine.stages.geometry.core_threads import run_in_stretches
from cellwright.engine.stages.geometry.shapes.convex_pieces import (
    bounding_block,
    group_pairs,
    join_packed,
    nearest_of_bodies,
    pack_pieces,
    pack_with_bounds,
)

# standing pieces: beyond it, walking down a tree beats comparing every pair
MAX_STANDING_PAIRWISE = 100


class BuiltinChecker:
    """A scene packed for the kernels."""

    def __init__(self, scene: CollisionScene, packed: tuple[Pieces, Longs] | None = None) -> None:
        """`packed` is what `bounded` gives; made from the scene when not given."""
        self._scene = scene
        self.bounded = self._pieces, bound_of = packed or pack_with_bounds(scene)
        self._pairs = group_pairs(scene.pairs, bound_of)
        self._touchable = group_pairs(scene.pairs, bound_of, touchable_pairs(scene, self._pieces))

    @cached_property
    def _likeliest(self) -> Pairs:
        """The pairs that can touch; before a large batch it is worth finding out which ones do
        so most often.
        """
        if self._scene.free:
            return self._touchable
        poses = pose_batch(self._scene, sample_configurations(self._scene.joints))
        return sort_by_likelihood(poses, self._pieces, self._touchable)

    def packed(self, within_m: float = 0.0) -> tuple[Pieces, Pairs]:
        """The scene as kernels read it: its pieces, and the pairs that can come within a
        distance, the likeliest first.
        """
        if within_m == 0.0:
            return self._pieces, self._likeliest
        may_touch = touchable_pairs(self._scene, self._pieces, within_m)
        return self._pieces, group_pairs(self._scene.pairs, self.bounded[1], may_touch)

    @property
    def scene(self) -> CollisionScene:
        """What is checked."""
        return self._scene

    def collides(self, where: Floats) -> Truths:
        """Whether any pair touches (n,)."""
        where = as_batch(self._scene, where)
        if is_finite(where):
            touching: Truths = self._first(where) >= 0
            return touching
        where, endless = split_batch(self._scene, where)
        return endless | (self._first(where) >= 0)

    def first_contacts(self, where: Floats) -> Longs:
        """A pair that touches for each of the batch, as an index into the scene's pairs (n,); -1
        for none.

        Raises `ValueError` for what is no number.
        """
        where, endless = split_batch(self._scene, where)
        if endless.any():
            raise ValueError("a configuration or pose has an entry that is not a finite number")
        return self._first(where)

    def _first(self, where: Floats) -> Longs:
        """`first_contacts` of a checked batch."""
        first_hits = np.empty(len(where), dtype=np.int64)
        if len(where) <= POSE_SAMPLES:
            first_contacts(
                checked_poses(self._scene, where), self._pieces, self._touchable, first_hits
            )
            return first_hits
        pairs = self._likeliest

        def look(first: int, after: int) -> None:
            poses = checked_poses(self._scene, where[first:after])
            first_contacts(poses, self._pieces, pairs, first_hits[first:after])

        run_in_stretches(len(where), look)
        return first_hits

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance (n,), at most `beyond_m`."""
        where, endless = split_batch(self._scene, where)
        distance, _, _ = self._nearest(where, beyond_m)
        distance[endless] = -np.inf
        return distance

    def nearest(self, where: Floats, beyond_m: float = 1.0) -> tuple[Contact | None, ...]:
        """The nearest (or deepest) two bodies of each (n,); None where nothing is nearer than
        `beyond_m`.

        Raises `ValueError` for what is no number.
        """
        where, endless = split_batch(self._scene, where)
        if endless.any():
            raise ValueError("a configuration or pose has an entry that is not a finite number")
        distance, pair, witness = self._nearest(where, beyond_m)
        contacts: list[Contact | None] = []
        for gap, number, row in zip(distance, pair, witness, strict=True):
            if number < 0:
                contacts.append(None)
                continue
            first, second = (self._scene.pieces[piece].body for piece in self._scene.pairs[number])
            point_first, point_second, normal = (part.copy() for part in np.split(row, 3))
            contacts.append(Contact(first, second, float(gap), point_first, point_second, normal))
        return tuple(contacts)

    def _nearest(self, where: Floats, beyond_m: float) -> tuple[Floats, Longs, Floats]:
        """The least signed distance below `beyond_m` (n,), its pair (n,) or -1, and its points
        and normal (n, 9).
        """
        n = len(where)
        distance, pair, witness = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 9))

        def look(first: int, after: int) -> None:
            poses, rows = pose_batch(self._scene, where[first:after]), slice(first, after)
            out = distance[rows], pair[rows], witness[rows]
            nearest_pairs(poses, self._pieces, self._pairs, float(beyond_m), *out)

        run_in_stretches(n, look)
        return distance, pair, witness

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """Every pair of bodies nearer than `within_m`, nearest first."""
        pairs = self._pairs.pairs
        distance, witness = np.empty(len(pairs)), np.empty((len(pairs), 9))
        poses = pose_batch(self._scene, batch_of_one(self._scene, where))
        near_pairs(poses, self._pieces, pairs, float(within_m), distance, witness)
        near = np.nonzero(distance <= within_m)[0]
        return nearest_of_bodies(
            Contact(
                self._scene.pieces[pairs[m, 0]].body,
                self._scene.pieces[pairs[m, 1]].body,
                float(distance[m]),
                *(part.copy() for part in np.split(witness[m], 3)),
            )
            for m in near
        )


class BuiltinBackend:
    """Compiled kernels; always there."""

    name = "builtin"
    exact_depths = True

    def checker_of_few(self, scene: CollisionScene) -> BuiltinChecker:
        """Pack a scene, without a tree."""
        return BuiltinChecker(scene)

    def checker(self, scene: CollisionScene) -> CollisionChecker:
        """Pack a scene; what stands in it becomes a region tree when it is much."""
        standing = sum(piece.carrier == 0 for piece in scene.pieces)
        if standing <= MAX_STANDING_PAIRWISE:
            return BuiltinChecker(scene)
        return RegionChecker(scene)


Names = frozenset[frozenset[str]]
NO_NAMES: Names = frozenset()


def attach_body(
    checker: BuiltinChecker, body: str, carrier: int, T_new_old: Floats, allowed: Names = NO_NAMES
) -> BuiltinChecker:
    """The checker of the scene in which a body moves with another carrier from now on; on carrier 0
    it is put down.

    `T_new_old` (4, 4) is the pose of the body's carrier up to now in the new one. The body is
    checked against all that is on other carriers, except for the `allowed` pairs of names. Raises
    `ValueError` for an unknown body or carrier.
    """
    scene = checker.scene
    mine = _pieces_of_bodies(scene, {body})
    if not mine.any() or not 0 <= carrier < scene.carriers:
        raise ValueError(f"the scene has no body '{body}', or no carrier {carrier}")
    pieces = tuple(
        replace(piece, carrier=carrier, T_carrier_piece=matmul(T_new_old, piece.T_carrier_piece))
        if its
        else piece
        for piece, its in zip(scene.pieces, mine, strict=True)
    )
    touching = {name for pair in allowed if body in pair for name in pair} - {body}
    changed = replace(
        scene,
        pieces=pieces,
        pairs=_renewed_pairs(scene, pieces, mine, _pieces_of_bodies(scene, touching)),
    )
    return BuiltinChecker(changed, _repack_pieces(checker, pieces, np.nonzero(mine)[0]))


def allow_contacts(checker: BuiltinChecker, allowed: Names) -> BuiltinChecker:
    """The checker of the same scene in which the `allowed` pairs of names may touch, too."""
    scene, pairs = checker.scene, checker.scene.pairs.reshape(-1, 2)
    is_kept = np.ones(len(pairs), dtype=bool)
    for names in allowed:
        first, last = min(names), max(names)
        of_first, of_last = (
            _pieces_of_bodies(scene, {first})[pairs],
            _pieces_of_bodies(scene, {last})[pairs],
        )
        is_kept &= ~((of_first[:, 0] & of_last[:, 1]) | (of_first[:, 1] & of_last[:, 0]))
    return BuiltinChecker(
        replace(scene, pairs=np.ascontiguousarray(pairs[is_kept])), checker.bounded
    )


def _pieces_of_bodies(scene: CollisionScene, bodies: set[str]) -> Truths:
    """Which pieces (n,) belong to some bodies."""
    return np.array([piece.body in bodies for piece in scene.pieces], dtype=bool)


def _renewed_pairs(
    scene: CollisionScene, pieces: tuple[ConvexPiece, ...], mine: Truths, may: Truths
) -> Longs:
    """The pairs without the body's, and then the body's with all that is on other carriers,
    except for what `may` touch it.
    """
    old = scene.pairs.reshape(-1, 2)
    remaining = old[~mine[old].any(axis=1)]
    carrier = np.array([piece.carrier for piece in pieces])
    numbers = np.nonzero(mine)[0]
    with_it = ~mine & ~may & (carrier != carrier[numbers[0]])
    own = np.stack(np.meshgrid(numbers, np.nonzero(with_it)[0], indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    renewed: Longs = np.concatenate([remaining, np.sort(own, axis=1)]).astype(np.int64)
    return renewed


def _repack_pieces(
    checker: BuiltinChecker, pieces: tuple[ConvexPiece, ...], numbers: Longs
) -> tuple[Pieces, Longs]:
    """The packed pieces with those of the body renewed, and bounds of their own around them at
    the end.
    """
    old, bound_of = checker.bounded
    own = [pieces[n] for n in numbers]
    fresh = pack_pieces(own)
    vertices, carrier, bounds = old.vertices.copy(), old.carrier.copy(), old.bounds.copy()
    for n, (first, rows) in zip(numbers, fresh.stretch, strict=True):
        start = old.stretch[n, 0]
        vertices[start : start + rows] = fresh.vertices[first : first + rows]
    carrier[numbers], bounds[numbers] = fresh.carrier, fresh.bounds
    renewed, bound_of = Pieces(vertices, old.stretch, old.radius, carrier, bounds), bound_of.copy()
    bound_of[numbers] = numbers[0] if len(numbers) == 1 else renewed.count
    return (
        renewed if len(numbers) == 1 else join_packed(renewed, pack_pieces([bounding_block(own)]))
    ), bound_of


def nearest_contacts(
    checker: CollisionChecker, where: Floats, beyond_m: float = 1.0
) -> tuple[Contact | None, ...]:
    """For each of a batch (n, ...) the two bodies that are nearest to each other, or overlap
    deepest.

    None where nothing is nearer than `beyond_m`. The built-in checker answers for the whole batch
    at once, others one by one. Raises `ValueError` for what is no number.
    """
    if isinstance(checker, BuiltinChecker):
        return checker.nearest(where, beyond_m)
    contact_lists = (
        checker.contacts(configuration, beyond_m)
        for configuration in np.asarray(where, dtype=float)
    )
    return tuple(
        min(candidates, key=lambda contact: contact.distance_m, default=None)
        for candidates in contact_lists
    )
