"""Two's complement arithmetic on Python ints and on int64 arrays alike: one algorithm serves one run or thousands.

An int is exact and unbounded, an array wraps at 64 bits; the functions here give the same results for both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Integer = Any  # Any: the operators of the two kinds have no common type
"""An int, or an int64 array with one value per run."""


def wrap_i32(x: Integer) -> Integer:
    """x modulo 2^32, as two's complement."""
    return ((x + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def wrap_u32(x: Integer) -> Integer:
    return x & 0xFFFFFFFF


def wrap_i64(x: Integer) -> Integer:
    """x modulo 2^64, as two's complement; an array has wrapped already."""
    if isinstance(x, int):
        return ((x + 0x8000000000000000) & 0xFFFFFFFFFFFFFFFF) - 0x8000000000000000
    return x


def clamp(x: Integer, low: Integer, high: Integer) -> Integer:
    """min(max(x, low), high)."""
    if isinstance(x, int) and isinstance(low, int):
        return min(max(x, low), high)
    return np.minimum(np.maximum(x, low), high)


def select(condition: Integer, yes: Integer, no: Integer) -> Integer:
    """yes where the condition holds, else no."""
    if isinstance(condition, bool):
        return yes if condition else no
    return np.where(condition, yes, no)


def clz32(x: Integer) -> Integer:
    """Leading zero bits of 0 < x < 2^32."""
    if isinstance(x, int):
        return 32 - x.bit_length()
    return 32 - np.frexp(x.astype(np.float64))[1].astype(np.int64)


def mulhi_u32(a: Integer, b: Integer) -> Integer:
    """(a * b) >> 32 of two unsigned 32-bit values, with intermediate results that fit int64."""
    return (a * (b >> 16) + ((a * (b & 0xFFFF)) >> 16)) >> 16


def mul(a: Integer, b: Integer) -> Integer:
    """Floor of a * b / 2^32, of two signed 32-bit values."""
    return (a * b) >> 32
