"""Small linear algebra with the same bits on every processor.

Libraries for matrices choose other code for another processor, which rounds in another way; so none
of them is asked.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats


def matmul(first: Floats, *others: Floats) -> Floats:
    """The product of matrices (..., m, k), (..., k, n), and so on, or of vectors where one has
    a single axis.
    """
    product = first
    for factor in others:
        if product.ndim == 1 or factor.ndim == 1:
            product = _with_vector(product, factor)
        else:
            product = np.einsum("...ij,...jk->...ik", product, factor)
    return product


def _with_vector(first: Floats, second: Floats) -> Floats:
    """The product where at least one is a vector (k,)."""
    if first.ndim == 1:
        return np.asarray(np.einsum("i,...ij->...j" if second.ndim > 1 else "i,i->", first, second))
    return np.asarray(np.einsum("...ij,j->...i", first, second))


def norm(vector: Floats) -> float:
    """The length of a vector (n,)."""
    return math.sqrt(float((vector * vector).sum()))


def solve_positive_definite(matrix: Floats, right: Floats) -> Floats:
    """x (..., n) with A x = b for positive definite matrices A (..., n, n) and b (..., n), by
    elimination.
    """
    eliminated, solution = np.array(matrix, dtype=float), np.array(right, dtype=float)
    size = solution.shape[-1]
    for n in range(size):
        factor = eliminated[..., n + 1 :, n] / eliminated[..., n, n, None]
        eliminated[..., n + 1 :, n:] -= factor[..., None] * eliminated[..., n, None, n:]
        solution[..., n + 1 :] -= factor * solution[..., n, None]
    for n in range(size - 1, -1, -1):
        solution[..., n] /= eliminated[..., n, n]
        solution[..., :n] -= eliminated[..., :n, n] * solution[..., n, None]
    return solution
