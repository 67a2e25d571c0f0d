"""Whether blocks and triangles meet.

A triangle may be a line or a point: what is seen of an unknown thing is a line of sight that is blocked.
"""

import numpy as np

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.grasping.kernels.meeting import Blocks, meeting


def meet(T: Floats, middles: Floats, halves: Floats, triangles: Floats) -> Truths:
    """Whether any triangle (m, 3, 3) meets any of the blocks, for each pose (n, 4, 4) of their frame (n,).

    Blocks have middles (b, 3) and half extents (b, 3) along the frame's axes. What only touches does not meet.
    """
    blocks = Blocks(np.ascontiguousarray(middles), np.ascontiguousarray(halves))
    return meeting(blocks, np.ascontiguousarray(T), np.ascontiguousarray(triangles))
