"""Pose fields: one pose for each visit, chosen so that visits near each other have similar poses.

A field begins with one pose of one visit and spreads along a shortest spanning tree of the positions. Each
visit takes the pose that is nearest to its parent's pose. In a field, only the order is still open.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.stages.sequencing.symmetric import Matrix

MOST = 256  # at most this many poses of the first visit are tried


def fields(table: Floats, offset: Ints, lines: Longs) -> list[Ints]:
    """A field for each pose of the first visit of the tree.

    The field whose poses change least along the tree comes first. `table` (m, k) has all poses as joint
    times; the poses of visit v begin at row offset[v]. `lines` (n, n) are distances. A field has one row
    number for each visit (n,).
    """
    tree = _tree(lines)
    found = []
    for row in range(offset[tree[0][0]], min(offset[tree[0][0] + 1], offset[tree[0][0]] + MOST)):
        rows, change = np.zeros(len(lines), np.int32), 0.0
        rows[tree[0][0]] = row
        for visit, parent in tree[1:]:
            steps = np.abs(table[offset[visit] : offset[visit + 1]] - table[rows[parent]]).max(axis=1)
            nearest = int(np.argmin(steps))
            rows[visit], change = offset[visit] + nearest, change + float(steps[nearest])
        found.append((change, row, rows))
    return [rows for _, _, rows in sorted(found, key=lambda each: each[:2])]


def _tree(lines: Longs) -> list[tuple[int, int]]:
    """The visits of a shortest spanning tree with their parents; parents come first, the root is the last
    visit.
    """
    n = len(lines)
    near, parent = np.full(n, np.iinfo(np.int64).max), np.zeros(n, np.intp)
    outside, at, tree = np.ones(n, bool), n - 1, []
    for _ in range(n):
        tree.append((at, int(parent[at])))
        outside[at] = False
        closer = outside & (lines[at] < near)
        near[closer], parent[closer] = lines[at][closer], at
        if outside.any():
            at = int(np.flatnonzero(outside)[np.argmin(near[outside])])
    return tree


def times(table: Floats, rows: Ints) -> Matrix:
    """The times (n, n) between the poses of a field, in whole microseconds."""
    q = table[rows]
    found: Matrix = np.rint(1e6 * np.abs(q[:, None] - q[None]).max(axis=2)).astype(np.int32)
    return found
