"""Convex pieces as the arrays that the compiled kernels work on."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.geometry import transforms
from engine.model.geometry import Floats, Ints, Piece, Truths


class Pieces(NamedTuple):
    """n pieces, v vertices. A named tuple, because kernels take those."""

    vertices: Floats  # (v, 3) in their carriers
    stretch: Ints  # (n, 2) first row and number of rows
    radius: Floats  # (n,)
    carrier: Ints  # (n,)
    ball: Floats  # (n, 4) centre in the carrier, radius
    block: Floats  # (n, 15) axes as rows, middle in the carrier, half sizes; around the vertices alone
    is_block: Truths  # (n,) whether the block is the piece itself


class Tree(NamedTuple):
    """How n regions hang together, for the kernels."""

    first: Ints  # (n + 1,) where the children of each begin in `children`
    children: Ints  # (m,)
    roots: Ints  # (r,)
    solid: Truths  # (n,)
    grow: Floats  # (n,) how far what lies below may reach out of it


def pack(pieces: Sequence[Piece]) -> Pieces:
    """The arrays of pieces, in their order."""
    placed = [transforms.apply(piece.T_carrier_piece, piece.vertices) for piece in pieces]
    counts = np.array([len(vertices) for vertices in placed], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    bounds = [_bounds(piece) for piece in pieces]
    return Pieces(
        np.ascontiguousarray(np.concatenate([np.zeros((0, 3)), *placed])),
        np.stack([starts, counts], axis=1).astype(np.int64).reshape(-1, 2),
        np.array([piece.radius_m for piece in pieces], dtype=float),
        np.array([piece.carrier for piece in pieces], dtype=np.int64),
        np.array([ball for ball, _ in bounds]).reshape(-1, 4),
        np.array([block for _, block in bounds]).reshape(-1, 15),
        np.array([piece.box and not piece.radius_m for piece in pieces], dtype=bool),
    )


def joined(first: Pieces, second: Pieces) -> Pieces:
    """The arrays of two sequences of pieces, one after the other."""
    return Pieces(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.stretch, second.stretch + np.array([len(first.vertices), 0])]),
        np.concatenate([first.radius, second.radius]),
        np.concatenate([first.carrier, second.carrier]),
        np.concatenate([first.ball, second.ball]),
        np.concatenate([first.block, second.block]),
        np.concatenate([first.is_block, second.is_block]),
    )


def _bounds(piece: Piece) -> tuple[Floats, Floats]:
    """The ball around a piece, and the block around its vertices along the axes of its own frame."""
    low, high = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    middle = (low + high) / 2
    reach = float(np.linalg.norm(piece.vertices - middle, axis=1).max()) + piece.radius_m
    centre = transforms.apply(piece.T_carrier_piece, middle[None])[0]
    axes = piece.T_carrier_piece[:3, :3].T
    return np.append(centre, reach), np.concatenate([axes.ravel(), centre, (high - low) / 2])
