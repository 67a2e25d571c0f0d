"""What has changed between two scenes: the pairs of pieces that only one of them checks.

A pair is the same if both pieces have the same shape, at the same place of the same carrier, whatever their names are. So a
body that was put elsewhere, taken into a hand, or given leave to touch makes new pairs, and all others stay what they were.
"""

from collections.abc import Hashable
from dataclasses import fields

import numpy as np

from cellwright.engine.model.geometry import Longs, Piece, Scene


def differing(before: Scene, after: Scene) -> Scene | None:
    """The scene of the pairs that only one of two scenes has; None if their joints differ."""
    if not _same_joints(before, after):
        return None
    pieces: dict[Hashable, int] = {}
    kept: list[Piece] = []
    number = [_numbered(scene.pieces, pieces, kept) for scene in (before, after)]
    pairs = [
        np.unique(np.sort(of[scene.pairs.reshape(-1, 2)], axis=1), axis=0)
        for of, scene in zip(number, (before, after), strict=True)
    ]
    every, count = np.unique(np.concatenate(pairs), axis=0, return_counts=True)
    return _of_pairs(after, kept, every[count == 1])


def _of_pairs(scene: Scene, pieces: list[Piece], pairs: Longs) -> Scene:
    """The scene of some pairs (m, 2) of pieces, with no piece that is in none of them."""
    used, own = np.unique(pairs, return_inverse=True)
    left = tuple(pieces[n] for n in used)
    bodies = tuple(dict.fromkeys(piece.body for piece in left))
    return Scene(scene.joints, left, np.ascontiguousarray(own.reshape(-1, 2).astype(np.int64)), bodies=bodies)


def _numbered(pieces: tuple[Piece, ...], numbers: dict[Hashable, int], kept: list[Piece]) -> Longs:
    """The number of each piece (n,): that of the same piece, if it was seen before, else a new one."""
    found = np.zeros(len(pieces), dtype=np.int64)
    for n, piece in enumerate(pieces):
        key = _identity(piece)
        if key not in numbers:
            numbers[key] = len(kept)
            kept.append(piece)
        found[n] = numbers[key]
    return found


def _identity(piece: Piece) -> Hashable:
    place, shape = piece.T_carrier_piece + 0.0, piece.vertices + 0.0  # -0.0 becomes 0.0
    return piece.carrier, place.tobytes(), shape.tobytes(), piece.radius_m, piece.box


def _same_joints(one: Scene, other: Scene) -> bool:
    """Whether two scenes have the same joints, with the same limits."""
    names = [each.name for each in fields(one.joints)]
    return all(np.array_equal(getattr(one.joints, name), getattr(other.joints, name)) for name in names)
