# cython: language_level=3, annotation_typing=False
"""How convex pieces, pairs of them and region trees are laid out in arrays.

Each class checks once what kernels rely on. It keeps every array twice: by its name for NumPy, and with an underscore for
the kernels, which read it there without touching an object.
"""

import cython
import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths, refuse_beyond, refuse_unless

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
        """Takes vertices (v, 3) in their carriers; of each piece its `stretch` (n, 2) of them: first row and number of
        rows; its radius (n,) and carrier (n,); and bounds (n, 18): the middle, the radius of the ball, axes and half
        sizes of the block around the vertices, the radius, the kind.
        """
        count = len(radius)
        refuse_unless("vertices", vertices, np.float64, (None, 3))
        refuse_unless("stretches of vertices", stretch, np.int64, (count, 2))
        refuse_unless("radii", radius, np.float64, (count,))
        refuse_unless("carriers", carrier, np.int64, (count,))
        refuse_unless("bounds", bounds, np.float64, (count, KIND + 1))
        refuse_beyond("first rows of vertices", stretch[:, 0], len(vertices))
        refuse_beyond("last rows of vertices", stretch.sum(axis=1) - 1, len(vertices))
        refuse_beyond("numbers of vertices less one", stretch[:, 1] - 1, len(vertices))
        self.count = count
        self.carriers = int(carrier.max()) + 1 if count else 0
        self.most = int(stretch[:, 1].max()) if count else 0  # vertices of one piece
        refuse_beyond("carriers", carrier, self.carriers)
        self.vertices, self.stretch, self.radius = vertices, stretch, radius
        self.carrier, self.bounds = carrier, bounds
        self._vertices, self._stretch, self._radius = vertices, stretch, radius
        self._carrier, self._bounds = carrier, bounds


class Pairs:
    """m pairs of pieces in g groups; two bounds that are apart spare a look at a whole group."""

    def __init__(self, pairs: Longs, groups: Longs, after: Longs, order: Longs) -> None:
        """Takes pairs (m, 2); groups (g, 4): numbers of the bounds of both sides, the first pair, and the one after the
        last; of each pair (m,) the next one of its group with another first piece, and the number it has in the scene.

        Raises `ValueError` for arrays that do not fit together.
        """
        refuse_unless("pairs", pairs, np.int64, (None, 2))
        refuse_unless("groups", groups, np.int64, (None, 4))
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


class Tree:
    """How n regions hang together."""

    def __init__(self, first: Longs, children: Longs, roots: Longs, solid: Truths, grow: Floats) -> None:
        """Takes `first` (n + 1,): where the children of each begin in `children` (m,); the roots (r,); which are solid
        (n,); and how far what lies below each may reach out of it (n,).

        Raises `ValueError` for arrays that do not fit together.
        """
        self.count = len(solid)
        refuse_unless("first children", first, np.int64, (self.count + 1,))
        refuse_unless("children", children, np.int64, (None,))
        refuse_unless("roots", roots, np.int64, (None,))
        refuse_unless("solid regions", solid, np.bool_, (self.count,))
        refuse_unless("growths", grow, np.float64, (self.count,))
        refuse_beyond("first children", first, len(children) + 1)
        refuse_beyond("children", children, self.count)
        refuse_beyond("roots", roots, self.count)
        if (np.diff(first) < 0).any() or len(roots) > self.count:
            raise ValueError("first children must be in order, and no more roots than regions")
        self.first, self.children, self.roots = first, children, roots
        self.solid, self.grow = solid, grow
        self._first, self._children, self._roots = first, children, roots
        self._solid, self._grow = solid.view(np.uint8), grow
