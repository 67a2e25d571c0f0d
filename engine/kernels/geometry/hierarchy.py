# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""A binary tree of boxes along the axes over numbered pieces.

A node is a row: its box, and its two children. A leaf has the number of a piece instead. Children
come before their parent. Rows are never changed. A piece that is inserted or removed makes new rows
for the nodes above it alone, and so a new tree that shares all other rows with the old one; both
stay right.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, refuse_unless

if not cython.compiled:  # `hierarchy.pxd` has this number, too
    LEAF = -1  # in the place of a leaf's first child; the second is the number of its piece


class Hierarchy:
    """The tree below the node `root` (-1: nothing is in it)."""

    def __init__(self, boxes: Floats, children: Longs, root: int) -> None:
        """Takes boxes (m, 6), low corners then high ones, and children (m, 2).

        Raises `ValueError` for arrays that do not fit together.
        """
        refuse_unless("boxes", boxes, np.float64, (len(boxes), 6))
        refuse_unless("children", children, np.int64, (len(boxes), 2))
        self.boxes, self.children, self.root = boxes, children, root
        self._boxes, self._children = boxes, children
        self._level = np.zeros(len(boxes), np.int64)
        self.depth, self.numbers = 0, 0
        if not -1 <= root < len(boxes) or not _sound(self):
            raise ValueError(
                "children must be pieces, or nodes before their parent, and the root a node"
            )


def _sound(h: Hierarchy) -> bool:
    """Whether all children are there; notes how deep the tree is, and how many pieces there
    must be.
    """
    for k in range(h._children.shape[0]):
        one, other = h._children[k, 0], h._children[k, 1]
        if one == LEAF:
            if other < 0:
                return False
            h.numbers = max(h.numbers, other + 1)
            continue
        if not (0 <= one < k and 0 <= other < k):
            return False
        h._level[k] = 1 + max(h._level[one], h._level[other])
    if h.root >= 0:
        h.depth = h._level[h.root]
    return True


class Plan:
    """What `build` writes: the order of n leaves, their middles, the nodes that they become."""

    def __init__(self, leaves: Floats, numbers: Longs, boxes: Floats, children: Longs) -> None:
        """Takes the leaves' boxes (n, 6) and the numbers (n,) of their pieces; written are 2 n
        - 1 rows of nodes.
        """
        count = len(leaves)
        refuse_unless("leaves", leaves, np.float64, (count, 6))
        refuse_unless("numbers", numbers, np.int64, (count,))
        refuse_unless("boxes", boxes, np.float64, (max(0, 2 * count - 1), 6))
        refuse_unless("children", children, np.int64, (max(0, 2 * count - 1), 2))
        self.leaves, self.numbers, self.boxes, self.children = leaves, numbers, boxes, children
        self.order = np.arange(count)
        self.open = np.empty(
            (count + 1, 3), np.int64
        )  # nodes to be made: first leaf, the one after the last, row


def build(leaves: Floats, numbers: Longs, boxes: Floats, children: Longs) -> None:
    """Write the nodes of the tree over some leaves; the last row is its root.

    The leaves of a node are halved at the median along the longest side of the box around their
    middles.
    """
    p, count = Plan(leaves, numbers, boxes, children), len(leaves)
    if count:
        with cython.nogil:
            _divide(p, count)
            _unite(p)


def _divide(p: Plan, count: int) -> None:
    """Give each node its children, from the root down; rows are taken from the last."""
    size, free = 1, 2 * count - 3
    p.open[0, 0], p.open[0, 1], p.open[0, 2] = 0, count, 2 * count - 2
    while size > 0:
        size -= 1
        first, after, row = p.open[size, 0], p.open[size, 1], p.open[size, 2]
        if after - first == 1:
            p.children[row, 0], p.children[row, 1] = LEAF, p.numbers[p.order[first]]
            for x in range(6):
                p.boxes[row, x] = p.leaves[p.order[first], x]
            continue
        half = (first + after) // 2
        _select(p, first, after - 1, half, _longest(p, first, after))
        p.children[row, 0], p.children[row, 1] = free, free - 1
        p.open[size, 0], p.open[size, 1], p.open[size, 2] = first, half, free
        p.open[size + 1, 0], p.open[size + 1, 1], p.open[size + 1, 2] = half, after, free - 1
        size, free = size + 2, free - 2


def _middle(p: Plan, at: int, axis: int) -> float:
    """Twice the middle of a leaf along an axis."""
    return float(p.leaves[p.order[at], axis] + p.leaves[p.order[at], 3 + axis])


def _longest(p: Plan, first: int, after: int) -> int:
    """The axis along which the middles of some leaves spread most."""
    best, widest = 0, -1.0
    for axis in range(3):
        low = high = _middle(p, first, axis)
        for at in range(first + 1, after):
            middle = _middle(p, at, axis)
            low, high = min(low, middle), max(high, middle)
        if high - low > widest:
            best, widest = axis, high - low
    return best


def _select(p: Plan, low: int, high: int, wanted: int, axis: int) -> None:
    """Put the leaves in such an order that none before `wanted` lies beyond it along the axis
    (Hoare 1961).
    """
    while low < high:
        pivot, i, j = _middle(p, (low + high) // 2, axis), low, high
        while i <= j:
            while _middle(p, i, axis) < pivot:
                i += 1
            while _middle(p, j, axis) > pivot:
                j -= 1
            if i <= j:
                kept = p.order[i]
                p.order[i] = p.order[j]
                p.order[j] = kept
                i, j = i + 1, j - 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            return


def _unite(p: Plan) -> None:
    """Give each node the box around its children; these come before it."""
    for row in range(p.boxes.shape[0]):
        one, other = p.children[row, 0], p.children[row, 1]
        if one != LEAF:
            for x in range(3):
                p.boxes[row, x] = min(p.boxes[one, x], p.boxes[other, x])
                p.boxes[row, 3 + x] = max(p.boxes[one, 3 + x], p.boxes[other, 3 + x])


class Change:
    """New rows for a tree, and the way from the root down to where they are needed."""

    def __init__(self, h: Hierarchy, box: Floats, number: int) -> None:
        """Takes the box (6,) of a piece and its number."""
        refuse_unless("the box", box, np.float64, (6,))
        self.h, self.box, self.number = h, box, number
        self.boxes, self.children = np.empty((h.depth + 3, 6)), np.empty((h.depth + 3, 2), np.int64)
        self._new_boxes, self._new_children = self.boxes, self.children
        self.path = np.empty(h.depth + 3, np.int64)
        self.open, self.levels = np.empty(h.depth + 3, np.int64), np.empty(h.depth + 3, np.int64)
        self.used = 0  # new rows


def inserted(h: Hierarchy, box: Floats, number: int) -> tuple[Floats, Longs, int]:
    """The rows to be added, boxes (m, 6) and children (m, 2), and the root of the tree with one
    more piece.

    The piece gets beside the leaf to which the way is that along which boxes grow least.
    """
    if number < 0:
        raise ValueError(f"the number of a piece must be 0 or more, not {number}")
    c = Change(h, box, number)
    if h.root < 0:
        _add_leaf(c)
        return c.boxes[:1], c.children[:1], len(h.boxes)
    level = _way_in(c)
    leaf = _add_leaf(c)
    below = _add_node(c, c.path[level], leaf)
    root = _rise(c, level, below)
    return c.boxes[: c.used], c.children[: c.used], root


def removed(h: Hierarchy, box: Floats, number: int) -> tuple[Floats, Longs, int]:
    """The rows to be added and the root of the tree without a piece.

    Raises `KeyError` when it is not there.
    """
    c = Change(h, box, number)
    level = _way_to(c) if h.root >= 0 else -1
    if level < 0:
        raise KeyError(f"no piece {number} in this box")
    if level == 0:
        return c.boxes[:0], c.children[:0], -1
    above = c.path[level - 1]
    kept = h.children[above, 0] if h.children[above, 1] == c.path[level] else h.children[above, 1]
    root = _rise(c, level - 1, int(kept))
    return c.boxes[: c.used], c.children[: c.used], root


def _add_leaf(c: Change) -> int:
    for x in range(6):
        c._new_boxes[c.used, x] = c.box[x]
    c._new_children[c.used, 0], c._new_children[c.used, 1] = LEAF, c.number
    c.used += 1
    return int(c.h._boxes.shape[0] + c.used - 1)


def _corner(c: Change, node: int, x: int) -> float:
    """An entry of the box of a node, old or new."""
    old = c.h._boxes.shape[0]
    return float(c.h._boxes[node, x] if node < old else c._new_boxes[node - old, x])


def _add_node(c: Change, one: int, other: int) -> int:
    for x in range(3):
        c._new_boxes[c.used, x] = min(_corner(c, one, x), _corner(c, other, x))
        c._new_boxes[c.used, 3 + x] = max(_corner(c, one, 3 + x), _corner(c, other, 3 + x))
    c._new_children[c.used, 0], c._new_children[c.used, 1] = one, other
    c.used += 1
    return int(c.h._boxes.shape[0] + c.used - 1)


def _rise(c: Change, level: int, below: int) -> int:
    """Copy the nodes above `level` of the path, with a new node below; returns the new root."""
    for up in range(level - 1, -1, -1):
        above, was = c.path[up], c.path[up + 1]
        one, other = c.h._children[above, 0], c.h._children[above, 1]
        below = _add_node(c, below, other) if one == was else _add_node(c, one, below)
    return below


def _way_in(c: Change) -> int:
    """Write the path to the leaf beside which the new piece gets; returns the leaf's level."""
    level, node = 0, c.h.root
    c.path[0] = node
    while c.h._children[node, 0] != LEAF:
        one, other = c.h._children[node, 0], c.h._children[node, 1]
        node = one if _growth(c, one) <= _growth(c, other) else other
        level += 1
        c.path[level] = node
    return level


def _growth(c: Change, node: int) -> float:
    """How much the edges of a node's box get longer when it takes the new piece in, and how far
    its middle is, if not at all.
    """
    grown, away = 0.0, 0.0
    for x in range(3):
        low, high = c.h._boxes[node, x], c.h._boxes[node, 3 + x]
        grown += max(high, c.box[3 + x]) - min(low, c.box[x]) - (high - low)
        away += abs(low + high - c.box[x] - c.box[3 + x])
    return grown + 1e-3 * away


def _way_to(c: Change) -> int:
    """Write the path to the leaf of a piece; returns its level, or -1.

    What does not hold its box is passed by.
    """
    size = 1
    c.open[0], c.levels[0] = c.h.root, 0
    while size > 0:
        size -= 1
        node, level = c.open[size], c.levels[size]
        c.path[level] = node
        one, other = c.h._children[node, 0], c.h._children[node, 1]
        if one == LEAF:
            if other == c.number:
                return int(level)
            continue
        for child in (one, other):
            if _holds(c, child):
                c.open[size], c.levels[size] = child, level + 1
                size += 1
    return -1


def _holds(c: Change, node: int) -> bool:
    for x in range(3):
        if c.h._boxes[node, x] > c.box[x] or c.h._boxes[node, 3 + x] < c.box[3 + x]:
            return False
    return True
