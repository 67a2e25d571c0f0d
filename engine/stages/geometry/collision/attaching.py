"""Bodies taken in hand and put down, and pairs that may touch for once, in a scene that is packed already.

Only the body itself is packed anew, so that a planner may ask for this between two motions.
"""

from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.geometry.layout import Pieces
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Longs, Piece, Scene, Truths
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.shapes.packing import bound, joined, pack

Names = frozenset[frozenset[str]]
NOTHING: Names = frozenset()


def attached(
    checker: BuiltinChecker, body: str, carrier: int, T_new_old: Floats, allowed: Names = NOTHING
) -> BuiltinChecker:
    """The checker of the scene in which a body moves with another carrier from now on; on carrier 0 it is put down.

    `T_new_old` (4, 4) is the pose of the body's carrier up to now in the new one. The body is checked against all that is on
    other carriers, except for the `allowed` pairs of names. Raises `ValueError` for an unknown body or carrier.
    """
    scene = checker.scene
    mine = _of(scene, {body})
    if not mine.any() or not 0 <= carrier < scene.carriers:
        raise ValueError(f"the scene has no body '{body}', or no carrier {carrier}")
    pieces = tuple(
        replace(piece, carrier=carrier, T_carrier_piece=matmul(T_new_old, piece.T_carrier_piece))
        if its
        else piece
        for piece, its in zip(scene.pieces, mine, strict=True)
    )
    others = {name for pair in allowed if body in pair for name in pair} - {body}
    changed = replace(scene, pieces=pieces, pairs=_pairs(scene, pieces, mine, _of(scene, others)))
    return BuiltinChecker(changed, _packed(checker, pieces, np.nonzero(mine)[0]))


def allowing(checker: BuiltinChecker, allowed: Names) -> BuiltinChecker:
    """The checker of the same scene in which the `allowed` pairs of names may touch, too."""
    scene, pairs = checker.scene, checker.scene.pairs.reshape(-1, 2)
    kept = np.ones(len(pairs), dtype=bool)
    for names in allowed:
        first, last = min(names), max(names)
        one, other = _of(scene, {first})[pairs], _of(scene, {last})[pairs]
        kept &= ~((one[:, 0] & other[:, 1]) | (one[:, 1] & other[:, 0]))
    return BuiltinChecker(replace(scene, pairs=np.ascontiguousarray(pairs[kept])), checker.bounded)


def _of(scene: Scene, bodies: set[str]) -> Truths:
    """Which pieces (n,) belong to some bodies."""
    return np.array([piece.body in bodies for piece in scene.pieces], dtype=bool)


def _pairs(scene: Scene, pieces: tuple[Piece, ...], mine: Truths, may: Truths) -> Longs:
    """The pairs without the body's, and then the body's with all that is on other carriers, except for what `may` touch it."""
    old = scene.pairs.reshape(-1, 2)
    kept = old[~mine[old].any(axis=1)]
    carrier = np.array([piece.carrier for piece in pieces])
    numbers = np.nonzero(mine)[0]
    with_it = ~mine & ~may & (carrier != carrier[numbers[0]])
    own = np.stack(np.meshgrid(numbers, np.nonzero(with_it)[0], indexing="ij"), axis=-1).reshape(-1, 2)
    found: Longs = np.concatenate([kept, np.sort(own, axis=1)]).astype(np.int64)
    return found


def _packed(checker: BuiltinChecker, pieces: tuple[Piece, ...], numbers: Longs) -> tuple[Pieces, Longs]:
    """The packed pieces with those of the body renewed, and bounds of their own around them at the end."""
    old, bound_of = checker.bounded
    own = [pieces[n] for n in numbers]
    fresh = pack(own)
    vertices, carrier, bounds = old.vertices.copy(), old.carrier.copy(), old.bounds.copy()
    for n, (first, rows) in zip(numbers, fresh.stretch, strict=True):
        start = old.stretch[n, 0]
        vertices[start : start + rows] = fresh.vertices[first : first + rows]
    carrier[numbers], bounds[numbers] = fresh.carrier, fresh.bounds
    renewed, bound_of = Pieces(vertices, old.stretch, old.radius, carrier, bounds), bound_of.copy()
    bound_of[numbers] = numbers[0] if len(numbers) == 1 else renewed.count
    return (renewed if len(numbers) == 1 else joined(renewed, pack([bound(own)]))), bound_of
