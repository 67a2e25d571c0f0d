# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Joints as kernels read them, and forward kinematics: where all carriers (links and moved bodies)
are.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths, refuse_unless
from cellwright.engine.kernels.geometry import forward


class Mechanism:
    """k joints: the parent carriers (k,), the origins there (k, 4, 4), the unit axes (k, 3), which
    of them slide (k,).

    `travel` (k,) says how far from 0 what slides gets (m); 10 m if nothing is said. Raises
    `ValueError` for arrays that do not fit together.
    """

    def __init__(
        self,
        parent: Longs,
        origin: Floats,
        axis: Floats,
        slides: Truths,
        travel: Floats | None = None,
    ) -> None:
        self.count = len(parent)
        refuse_unless("parents", parent, np.int64, (self.count,))
        refuse_unless("origins", origin, np.float64, (self.count, 4, 4))
        refuse_unless("axes", axis, np.float64, (self.count, 3))
        refuse_unless("what slides", slides, np.bool_, (self.count,))
        if (parent < 0).any() or (parent > np.arange(self.count)).any():
            raise ValueError("a joint hangs on a carrier that does not come before it")
        self.parents, self.origins, self.axes, self.sliding = parent, origin, axis, slides
        self.parent, self.origin, self.axis, self.slides = (
            parent,
            origin,
            axis,
            slides.view(np.uint8),
        )
        self.travels = np.full(self.count, 10.0) if travel is None else travel
        refuse_unless("travels", self.travels, np.float64, (self.count,))
        self.travel = self.travels


def place_carriers(m: Mechanism, at: Floats, n: int, poses: Floats) -> None:
    """Put all carriers where they are in configuration `at` (k,), in row `n` of poses (n, k +
    1, 3, 4).
    """
    forward.stand(poses, n)
    for j in range(m.count):
        forward.place_joint(m.origin, m.axis, m.slides[j], m.parent[j], j, at[j], n, poses)


def place_batch(m: Mechanism, q: Floats, out: Floats) -> None:
    """Put all carriers (n, k + 1, 3, 4) where they are in configurations q (n, k): rad or m.

    Raises `ValueError` for arrays that do not fit.
    """
    if q.shape != (len(out), m.count) or out.shape[1:] != (m.count + 1, 3, 4):
        raise ValueError(f"{m.count} joints need values (n, {m.count}), not {q.shape}")
    values, poses = q, out
    with cython.nogil:
        for n in range(poses.shape[0]):
            forward.stand(poses, n)
            for j in range(m.count):
                forward.place_joint(
                    m.origin, m.axis, m.slides[j], m.parent[j], j, values[n, j], n, poses
                )
