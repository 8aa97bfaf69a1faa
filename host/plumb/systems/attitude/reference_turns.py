"""Quaternions of `attitude` in float64: products, matrices, the turn to the vertical. The order is w, x, y, z."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray


def turned(first: FloatArray, then: FloatArray) -> FloatArray:
    """Product of two quaternions (4,)."""
    w, v, x, u = first[0], first[1:], then[0], then[1:]
    return np.concatenate([[w * x - v @ u], w * u + x * v + np.cross(v, u)])


def matrices(q: FloatArray) -> FloatArray:
    """Rotation matrices of quaternions (n, 4), from body to earth, (n, 3, 3)."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def right_products(half_rad: FloatArray) -> FloatArray:
    """Matrices (n, 4, 4) by which a turn of twice these half angles about the body's axes multiplies a quaternion."""
    length = np.linalg.norm(half_rad, axis=1)
    w, (x, y, z) = np.cos(length), (half_rad * np.sinc(length / np.pi)[:, None]).T
    rows = [[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]]
    return np.moveaxis(np.array(rows), -1, 0)


def to_vertical(force: FloatArray) -> FloatArray:
    """The shortest turn of an acceleration (3,) to the vertical, a quaternion."""
    length = float(np.linalg.norm(force))
    turn = np.array([length + force[2], force[1], -force[0], 0.0])
    size = float(np.linalg.norm(turn))
    return turn / size if size > length / 256.0 else np.array([0.0, 1.0, 0.0, 0.0])
