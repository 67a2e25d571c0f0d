"""How convex pieces, pairs of them and region trees are laid out in arrays."""

from typing import NamedTuple

from engine.kernels.arrays import Floats, Longs, Truths

# Columns of `bounds`: where the bounds of a piece are, and how large.
CENTRE, BALL, AXES, HALF, RADIUS, KIND = 0, 3, 4, 13, 16, 17
BALL_ITSELF, BLOCK_ITSELF, NEITHER = 0.0, 1.0, 2.0  # kinds: what the bounds are not larger than


class Pieces(NamedTuple):
    """n pieces, v vertices. A named tuple, because kernels take those."""

    vertices: Floats  # (v, 3) in their carriers
    stretch: Longs  # (n, 2) first row and number of rows
    radius: Floats  # (n,)
    carrier: Longs  # (n,)
    bounds: Floats  # (n, 18) middle, radius of the ball, axes and half sizes of the block around the vertices, radius, kind


class Pairs(NamedTuple):
    """m pairs of pieces in g groups; two bounds that are apart spare a look at a whole group."""

    pairs: Longs  # (m, 2)
    groups: Longs  # (g, 4) numbers of the bounds of both sides; the first pair, and the one after the last
    after: Longs  # (m,) of each pair, the next one of its group with another first piece
    order: Longs  # (m,) the number that each pair has in the scene


class Tree(NamedTuple):
    """How n regions hang together, for the kernels."""

    first: Longs  # (n + 1,) where the children of each begin in `children`
    children: Longs  # (m,)
    roots: Longs  # (r,)
    solid: Truths  # (n,)
    grow: Floats  # (n,) how far what lies below may reach out of it
