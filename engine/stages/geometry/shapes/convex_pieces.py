"""Convex pieces as arrays for compiled kernels, or as primitives of other libraries."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry.layout import (
    AXES,
    BALL,
    BALL_ITSELF,
    BLOCK_ITSELF,
    HALF,
    KIND,
    NEITHER,
    RADIUS,
    Pairs,
    Pieces,
)
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece
from cellwright.engine.stages.geometry import transforms


def nearest_of_bodies(contacts: Iterable[Contact]) -> tuple[Contact, ...]:
    """The nearest contact for each two bodies, in order of distance, then name."""
    best: dict[frozenset[str], Contact] = {}
    for contact in contacts:
        key = frozenset((contact.first, contact.second))
        if key not in best or contact.distance_m < best[key].distance_m:
            best[key] = contact
    return tuple(
        sorted(
            best.values(),
            key=lambda contact_entry: (
                contact_entry.distance_m,
                contact_entry.first,
                contact_entry.second,
            ),
        )
    )


BLOCK_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))  # corners of a block of size 1


def pack_pieces(pieces: Sequence[ConvexPiece]) -> Pieces:
    """The arrays of pieces, in the order given."""
    counts = np.array([len(piece.vertices) for piece in pieces], dtype=np.int64)
    starts = np.cumsum(counts) - counts
    vertices, bounds = np.empty((int(counts.sum()), 3)), np.empty((len(pieces), KIND + 1))
    for count in sorted(set(counts.tolist())):
        numbers = np.nonzero(counts == count)[0]
        alike = [pieces[int(n)] for n in numbers]
        T = np.array([piece.T_carrier_piece for piece in alike])
        corners = np.array([piece.vertices for piece in alike])
        vertices[starts[numbers, None] + np.arange(count)] = transforms.apply(T, corners)
        bounds[numbers] = _piece_bounds(alike, T, corners)
    return Pieces(
        vertices,
        np.stack([starts, counts], axis=1),
        np.array([piece.radius_m for piece in pieces], dtype=float),
        np.array([piece.carrier for piece in pieces], dtype=np.int64),
        bounds,
    )


def join_packed(first: Pieces, second: Pieces) -> Pieces:
    """The arrays of two sequences of pieces, one after the other."""
    return Pieces(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.stretch, second.stretch + np.array([len(first.vertices), 0])]),
        np.concatenate([first.radius, second.radius]),
        np.concatenate([first.carrier, second.carrier]),
        np.concatenate([first.bounds, second.bounds]),
    )


def select_pieces(pieces: Pieces, numbers: Longs) -> Pieces:
    """The arrays of some of the pieces, in the order of `numbers` (m,)."""
    stretch = pieces.stretch[numbers]
    counts = stretch[:, 1]
    starts = np.cumsum(counts) - counts
    rows = np.repeat(stretch[:, 0] - starts, counts) + np.arange(int(counts.sum()))
    return Pieces(
        pieces.vertices[rows],
        np.stack([starts, counts], axis=1),
        pieces.radius[numbers],
        pieces.carrier[numbers],
        pieces.bounds[numbers],
    )


def pack_with_bounds(scene: CollisionScene) -> tuple[Pieces, Longs]:
    """The pieces of a scene, with bounds added around pieces that move together, and for each piece
    the number of its bounds.

    Standing pieces have bounds for each body, moving pieces for each carrier.
    """
    pieces = list(scene.pieces)
    members: dict[tuple[str, int], list[int]] = {}
    for number, piece in enumerate(pieces):
        members.setdefault((piece.body if piece.carrier == 0 else "", piece.carrier), []).append(
            number
        )
    bound_of = np.zeros(len(pieces), dtype=np.int64)
    for numbers in members.values():
        bound_of[numbers] = numbers[0] if len(numbers) == 1 else len(pieces)
        if len(numbers) > 1:
            pieces.append(bounding_block([pieces[number] for number in numbers]))
    return pack_pieces(pieces), bound_of


def group_pairs(pairs: Longs, bound_of: Longs, kept: Truths | None = None) -> Pairs:
    """The pairs (m, 2) that are `kept` (all of them if not given), in the order of their bounds,
    then of their first pieces.
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
    after = np.append(changes, len(pairs))[
        np.searchsorted(changes, np.arange(len(pairs)), side="right")
    ]
    return Pairs(np.ascontiguousarray(pairs[order]), rows, after.astype(np.int64), numbers[order])


def bounding_block(pieces: Sequence[ConvexPiece]) -> ConvexPiece:
    """A block around pieces on one carrier, along the axes of the first piece."""
    axes = pieces[0].T_carrier_piece[:3, :3]
    alike: dict[int, list[ConvexPiece]] = {}
    for piece in pieces:
        alike.setdefault(len(piece.vertices), []).append(piece)
    extents = [_extent_along(alike_pieces, axes) for alike_pieces in alike.values()]
    low = np.min([least for least, _ in extents], axis=0)
    high = np.max([greatest for _, greatest in extents], axis=0)
    return block_between(pieces[0], axes, low, high)


def _extent_along(pieces: Sequence[ConvexPiece], axes: Floats) -> tuple[Floats, Floats]:
    """The least and the greatest coordinates (3,) of pieces with as many vertices each, along
    axes (3, 3: columns).
    """
    T = np.array([piece.T_carrier_piece for piece in pieces])
    along = matmul(transforms.apply(T, np.array([piece.vertices for piece in pieces])), axes)
    radius = np.array([piece.radius_m for piece in pieces])[:, None]
    return (along.min(axis=1) - radius).min(axis=0), (along.max(axis=1) + radius).max(axis=0)


def block_between(like: ConvexPiece, axes: Floats, low: Floats, high: Floats) -> ConvexPiece:
    """The block between two corners (3,), whose coordinates are along axes (3, 3: columns), with
    the body and the carrier of a piece.
    """
    T = transforms.transform(axes, matmul(axes, (low + high) / 2))
    return ConvexPiece(like.body, like.carrier, T, BLOCK_CORNERS * (high - low), 0.0, box=True)


def _piece_bounds(pieces: Sequence[ConvexPiece], T: Floats, corners: Floats) -> Floats:
    """Bounds (n, 18) of pieces with T_carrier_piece (n, 4, 4) and as many corners each (n, m, 3):
    the ball around a piece, and the block around its vertices along the axes of its own frame.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = (low + high) / 2
    radius = np.array([piece.radius_m for piece in pieces], dtype=float)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) + radius
    blocks = np.array([piece.box for piece in pieces], dtype=bool) & (radius == 0.0)
    kind = BALL_ITSELF if corners.shape[1] == 1 else np.where(blocks, BLOCK_ITSELF, NEITHER)
    bounds = np.empty((len(pieces), KIND + 1))
    bounds[:, :BALL] = transforms.apply(T, middle[:, None])[:, 0]
    bounds[:, AXES:HALF] = np.swapaxes(T[:, :3, :3], 1, 2).reshape(-1, 9)
    bounds[:, HALF:RADIUS] = (high - low) / 2
    bounds[:, BALL], bounds[:, RADIUS], bounds[:, KIND] = reach, radius, kind
    return bounds


def primitive_frame(piece: ConvexPiece) -> Floats:
    """T_carrier_primitive (4, 4). For a block or polytope it is the piece's own frame."""
    T = piece.T_carrier_piece.copy()
    if len(piece.vertices) > 2:
        return T
    T[:3, 3] += matmul(T[:3, :3], piece.vertices.mean(axis=0))
    if len(piece.vertices) == 2:
        T[:3, :3] = matmul(T[:3, :3], _rotation_onto(piece.vertices[1] - piece.vertices[0]))
    return T


def _rotation_onto(along: Floats) -> Floats:
    """A rotation (3, 3) that turns the z axis into a direction."""
    z = along / norm(along)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def length_of(piece: ConvexPiece) -> float:
    """The distance between the centres of a capsule's two ends."""
    return norm(piece.vertices[1] - piece.vertices[0])


def refuse_rounded(piece: ConvexPiece, library: str) -> None:
    """Raises `ValueError` for a polytope with a radius, because other libraries do not have
    this shape.
    """
    if len(piece.vertices) > 2 and piece.radius_m:
        raise ValueError(f"{library} has no rounded polytopes: {piece.body}")
