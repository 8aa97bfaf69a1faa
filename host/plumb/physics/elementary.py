"""Functions of the C library over arrays, element by element.

numpy's own ones differ from them in the last bit on some processors. A plant in C (plant.c of a system) calls the
library, and has to give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from plumb.spec.arrays import FloatArray


def _each(function: Callable[[float], float], values: FloatArray) -> FloatArray:
    return np.array([function(value) for value in values.ravel().tolist()], np.float64).reshape(values.shape)


def sine(angle_rad: FloatArray) -> FloatArray:
    return _each(math.sin, angle_rad)


def cosine(angle_rad: FloatArray) -> FloatArray:
    return _each(math.cos, angle_rad)


def arctangent(slope: FloatArray) -> FloatArray:
    """In rad, within a right angle."""
    return _each(math.atan, slope)
