"""Convex pieces as the arrays that the compiled kernels work on."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from engine.kernels.geometry.layout import (
    BALL_ITSELF,
    BLOCK_ITSELF,
    KIND,
    NEITHER,
    Pairs,
    Pieces,
)
from engine.model.geometry import Floats, Longs, Piece, Scene, Truths
from engine.stages.geometry import transforms

CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))  # corners of a block of size 1


def pack(pieces: Sequence[Piece]) -> Pieces:
    """The arrays of pieces, in the order given."""
    placed = [transforms.apply(piece.T_carrier_piece, piece.vertices) for piece in pieces]
    counts = np.array([len(vertices) for vertices in placed], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    return Pieces(
        np.ascontiguousarray(np.concatenate([np.zeros((0, 3)), *placed])),
        np.stack([starts, counts], axis=1).astype(np.int64).reshape(-1, 2),
        np.array([piece.radius_m for piece in pieces], dtype=float),
        np.array([piece.carrier for piece in pieces], dtype=np.int64),
        np.array([_bounds(piece) for piece in pieces]).reshape(-1, KIND + 1),
    )


def joined(first: Pieces, second: Pieces) -> Pieces:
    """The arrays of two sequences of pieces, one after the other."""
    return Pieces(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.stretch, second.stretch + np.array([len(first.vertices), 0])]),
        np.concatenate([first.radius, second.radius]),
        np.concatenate([first.carrier, second.carrier]),
        np.concatenate([first.bounds, second.bounds]),
    )


def bounded(scene: Scene) -> tuple[Pieces, Longs]:
    """The pieces of a scene, with bounds added around pieces that move together, and for each piece the
    number of its bounds.

    Standing pieces have bounds for each body, moving pieces for each carrier.
    """
    pieces = list(scene.pieces)
    members: dict[tuple[str, int], list[int]] = {}
    for number, piece in enumerate(pieces):
        members.setdefault((piece.body if piece.carrier == 0 else "", piece.carrier), []).append(number)
    bound_of = np.zeros(len(pieces), dtype=np.int64)
    for numbers in members.values():
        bound_of[numbers] = numbers[0] if len(numbers) == 1 else len(pieces)
        if len(numbers) > 1:
            pieces.append(bound([pieces[number] for number in numbers]))
    return pack(pieces), bound_of


def grouped(pairs: Longs, bound_of: Longs, kept: Truths | None = None) -> Pairs:
    """The pairs (m, 2) that are `kept` (all of them if not given), in the order of their bounds, then of
    their first pieces.
    """
    numbers = np.arange(len(pairs)) if kept is None else np.nonzero(kept)[0]
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)[numbers]
    sides = bound_of[pairs]
    order = np.lexsort((pairs[:, 1], pairs[:, 0], sides[:, 1], sides[:, 0]))
    groups, firsts = np.unique(sides[order], axis=0, return_index=True)
    ends = np.append(firsts[1:], len(pairs)) if len(firsts) else firsts
    rows = np.column_stack([groups, firsts, ends]).astype(np.int64).reshape(-1, 4)
    runs = np.column_stack([sides[order], pairs[order, 0]])
    changes = np.nonzero((np.diff(runs, axis=0) != 0).any(axis=1))[0] + 1
    after = np.append(changes, len(pairs))[np.searchsorted(changes, np.arange(len(pairs)), side="right")]
    return Pairs(np.ascontiguousarray(pairs[order]), rows, after.astype(np.int64), numbers[order])


def bound(pieces: Sequence[Piece]) -> Piece:
    """A block around pieces on one carrier, along the axes of the first piece."""
    axes = pieces[0].T_carrier_piece[:3, :3]
    extents = np.array([extent(piece, axes) for piece in pieces])
    low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
    return block_between(pieces[0], axes, low, high)


def extent(piece: Piece, axes: Floats) -> tuple[Floats, Floats]:
    """The least and the greatest coordinates (3,) of a piece along axes (3, 3: columns)."""
    along = transforms.apply(piece.T_carrier_piece, piece.vertices) @ axes
    return along.min(axis=0) - piece.radius_m, along.max(axis=0) + piece.radius_m


def block_between(like: Piece, axes: Floats, low: Floats, high: Floats) -> Piece:
    """The block between two corners (3,), whose coordinates are along axes (3, 3: columns), with the body and
    the carrier of a piece.
    """
    T = transforms.transform(axes, axes @ ((low + high) / 2))
    return Piece(like.body, like.carrier, T, CORNERS * (high - low), 0.0, box=True)


def _bounds(piece: Piece) -> Floats:
    """The ball around a piece, and the block around its vertices along the axes of its own frame."""
    low, high = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    middle = (low + high) / 2
    reach = float(np.linalg.norm(piece.vertices - middle, axis=1).max()) + piece.radius_m
    centre = transforms.apply(piece.T_carrier_piece, middle[None])[0]
    axes = piece.T_carrier_piece[:3, :3].T
    kind = BALL_ITSELF if len(piece.vertices) == 1 else NEITHER
    kind = BLOCK_ITSELF if piece.box and not piece.radius_m else kind
    return np.concatenate([centre, [reach], axes.ravel(), (high - low) / 2, [piece.radius_m, kind]])
