# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False
"""Convex pieces, and the pairs of them to be checked, as arrays for the collision kernels.

Each class checks once what kernels rely on. It keeps every array twice: by its name for NumPy, and
with an underscore for the kernels, which read it there without touching an object.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, refuse_beyond, refuse_unless

if not cython.compiled:  # `layout.pxd` has these numbers, too
    # Columns of `bounds`: where the bounds of a piece are, and how large.
    CENTRE, BALL, AXES, HALF, RADIUS, KIND = 0, 3, 4, 13, 16, 17
    # Kinds: what the bounds are not larger than.
    BALL_ITSELF, BLOCK_ITSELF, NEITHER = 0, 1, 2


class Pieces:
    """n pieces, v vertices. Raises `ValueError` for arrays that do not fit together."""

    def __init__(
        self, vertices: Floats, stretch: Longs, radius: Floats, carrier: Longs, bounds: Floats
    ) -> None:
        """Takes vertices (v, 3) in their carriers; of each piece its `stretch` (n, 2) of them:
        first row and number of rows; its radius (n,) and carrier (n,); and bounds (n, 18): the
        middle, the radius of the ball, axes and half sizes of the block around the vertices, the
        radius, the kind.
        """
        count = len(radius)
        refuse_unless("vertices", vertices, np.float64, (len(vertices), 3))
        refuse_unless("stretches of vertices", stretch, np.int64, (count, 2))
        refuse_unless("radii", radius, np.float64, (count,))
        refuse_unless("carriers", carrier, np.int64, (count,))
        refuse_unless("bounds", bounds, np.float64, (count, KIND + 1))
        self.vertices, self.stretch, self.radius = vertices, stretch, radius
        self.carrier, self.bounds = carrier, bounds
        self._vertices, self._stretch, self._radius = vertices, stretch, radius
        self._carrier, self._bounds = carrier, bounds
        self.count, self.carriers, self.most = count, 0, 0  # `most`: vertices of one piece
        if not _within(self):
            raise ValueError("stretches must be rows that vertices have, and carriers 0 or more")


def _within(p: Pieces) -> bool:
    """Whether all rows and carriers can be there; notes the greatest."""
    for i in range(p.count):
        first, rows, carrier = p._stretch[i, 0], p._stretch[i, 1], p._carrier[i]
        if carrier < 0 or first < 0 or rows < 1 or rows > p._vertices.shape[0] - first:
            return False
        p.carriers, p.most = max(p.carriers, carrier + 1), max(p.most, rows)
    return True


class Pairs:
    """m pairs of pieces in g groups; two bounds that are apart spare a look at a whole group."""

    def __init__(self, pairs: Longs, groups: Longs, after: Longs, order: Longs) -> None:
        """Takes pairs (m, 2); groups (g, 4): numbers of the bounds of both sides, the first pair,
        and the one after the last; of each pair (m,) the next one of its group with another first
        piece, and the number it has in the scene.

        Raises `ValueError` for arrays that do not fit together.
        """
        refuse_unless("pairs", pairs, np.int64, (len(pairs), 2))
        refuse_unless("groups", groups, np.int64, (len(groups), 4))
        refuse_unless("next pairs", after, np.int64, (len(pairs),))
        refuse_unless("numbers of pairs", order, np.int64, (len(pairs),))
        refuse_beyond("ends of groups", groups[:, 2:], len(pairs) + 1)
        refuse_beyond("next pairs", after, len(pairs) + 1)
        if (after <= np.arange(len(pairs))).any():
            raise ValueError("the next pair of a group must come later")
        sides = np.concatenate([pairs.ravel(), groups[:, :2].ravel()])
        self.numbers = int(sides.max()) + 1 if len(sides) else 0  # pieces there must be
        refuse_beyond("pieces of pairs", sides, self.numbers)
        self.pairs, self.groups, self.after, self.order = pairs, groups, after, order
        self._pairs, self._groups, self._after, self._order = pairs, groups, after, order
