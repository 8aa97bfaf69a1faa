"""Vectors and sums of many runs at once, the runs as the last axis.

Sums go from the first term to the last one, as they do in a plant in C: numpy's own add in an order of its own.
"""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray


def total(terms: FloatArray) -> FloatArray:
    """Sum over the first axis."""
    found = terms[0]
    for term in terms[1:]:
        found = found + term
    return np.asarray(found)


def length(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors (n, runs)."""
    return np.asarray(np.sqrt(total(vectors * vectors)))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of vectors (3, runs)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def to_earth(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors of the body (3, runs) in earth axes; matrix: from body to earth, (3, 3, runs)."""
    x, y, z = vectors
    return np.asarray(matrix[:, 0] * x + matrix[:, 1] * y + matrix[:, 2] * z)


def to_body(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors of the earth's axes (3, runs) in body axes."""
    x, y, z = vectors
    return np.asarray(matrix[0] * x + matrix[1] * y + matrix[2] * z)
