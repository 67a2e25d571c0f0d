"""Small linear algebra with the same bits on every processor.

Libraries for matrices choose other code for another processor, which rounds in another way; so none of them is asked.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats


def matmul(first: Floats, *others: Floats) -> Floats:
    """The product of matrices (..., m, k), (..., k, n), and so on, or of vectors where one has a single axis."""
    found = first
    for each in others:
        if found.ndim == 1 or each.ndim == 1:
            found = _with_vector(found, each)
        else:
            found = np.einsum("...ij,...jk->...ik", found, each)
    return found


def _with_vector(first: Floats, second: Floats) -> Floats:
    """The product where at least one is a vector (k,)."""
    if first.ndim == 1:
        return np.asarray(np.einsum("i,...ij->...j" if second.ndim > 1 else "i,i->", first, second))
    return np.asarray(np.einsum("...ij,j->...i", first, second))


def norm(vector: Floats) -> float:
    """The length of a vector (n,)."""
    return math.sqrt(float((vector * vector).sum()))


def solved(matrix: Floats, right: Floats) -> Floats:
    """x (..., n) with A x = b for positive definite matrices A (..., n, n) and b (..., n), by elimination."""
    left, found = np.array(matrix, dtype=float), np.array(right, dtype=float)
    size = found.shape[-1]
    for n in range(size):
        factor = left[..., n + 1 :, n] / left[..., n, n, None]
        left[..., n + 1 :, n:] -= factor[..., None] * left[..., n, None, n:]
        found[..., n + 1 :] -= factor * found[..., n, None]
    for n in range(size - 1, -1, -1):
        found[..., n] /= left[..., n, n]
        found[..., :n] -= left[..., :n, n] * found[..., n, None]
    return found
