"""Quaternions w, x, y, z from body to earth, an array of them at once: (4, n), vectors (3, n)."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray


def quaternions(turn_rad: FloatArray) -> FloatArray:
    """Rotation vectors (3, n) to quaternions (4, n)."""
    half = np.linalg.norm(turn_rad, axis=0) / 2.0
    return np.concatenate([np.cos(half)[None], turn_rad / 2.0 * np.sinc(half / np.pi)])


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of quaternions (4, n)."""
    (w, x, y, z), (s, i, j, k) = a, b
    return np.stack([
        w * s - x * i - y * j - z * k,
        w * i + x * s + y * k - z * j,
        w * j - x * k + y * s + z * i,
        w * k + x * j - y * i + z * s,
    ])  # fmt: skip


def conjugate(q: FloatArray) -> FloatArray:
    """The opposite turns."""
    return np.stack([q[0], -q[1], -q[2], -q[3]])


def to_body(q: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors of the earth's axes (3, n) in body axes."""
    pure = np.concatenate([np.zeros((1, vectors.shape[1])), vectors])
    return product(product(conjugate(q), pure), q)[1:]


def rates_radps(q: FloatArray, step_s: float) -> FloatArray:
    """Mean rate in body axes between an attitude and the one before, (3, n), step_s apart; the first is 0."""
    step = product(conjugate(q[:, :-1]), q[:, 1:])
    step = np.where(step[0] < 0.0, -step, step)
    sine = np.linalg.norm(step[1:], axis=0)
    angle = 2.0 * np.arctan2(sine, step[0])
    turned = step[1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return np.concatenate([np.zeros((3, 1)), turned / step_s], axis=1)
