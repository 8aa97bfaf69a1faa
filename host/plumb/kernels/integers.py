"""Integer arithmetic of the core on Python ints, with the names of firmware/core/fixed.h.

An int has no limit, so what two's complement does to a sum is written out. A function with a range checks it: beyond it
the C would be undefined, or compute something else.
"""

from __future__ import annotations

INT32_MIN, INT32_MAX, UINT32_MAX = -(1 << 31), (1 << 31) - 1, (1 << 32) - 1
INT64_MIN, INT64_MAX = -(1 << 63), (1 << 63) - 1


def wrap_i16(x: int) -> int:
    """x modulo 2^16, as two's complement."""
    return ((x + 0x8000) & 0xFFFF) - 0x8000


def wrap_i32(x: int) -> int:
    """x modulo 2^32, as two's complement."""
    return ((x + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def wrap_u32(x: int) -> int:
    """x modulo 2^32."""
    return x & 0xFFFFFFFF


def wrap_i64(x: int) -> int:
    """x modulo 2^64, as two's complement."""
    return ((x + 0x8000000000000000) & 0xFFFFFFFFFFFFFFFF) - 0x8000000000000000


def clamp(x: int, low: int, high: int) -> int:
    """min(max(x, low), high): `high` where the bounds have changed places."""
    if x < low:
        x = low
    return high if x > high else x


def sat_i32(x: int) -> int:
    """x saturated to 32 bits."""
    return clamp(x, INT32_MIN, INT32_MAX)


def clz32(x: int) -> int:
    """Leading zero bits of 0 < x < 2^32."""
    assert 0 < x <= UINT32_MAX, x
    return 32 - x.bit_length()


def mulhi_u32(a: int, b: int) -> int:
    """(a * b) >> 32 of two unsigned 32-bit values."""
    assert 0 <= a <= UINT32_MAX and 0 <= b <= UINT32_MAX, (a, b)
    return (a * b) >> 32


def mulhi_i32(a: int, b: int) -> int:
    """floor(a * b / 2^32) of two signed 32-bit values."""
    assert -0x80000000 <= a <= 0x7FFFFFFF and -0x80000000 <= b <= 0x7FFFFFFF, (a, b)
    return (a * b) >> 32


def mulhi_near(a: int, b: int) -> int:
    """a * b / 2^32 of two signed 32-bit values, rounded to nearest, halves up."""
    assert -0x80000000 <= a <= 0x7FFFFFFF and -0x80000000 <= b <= 0x7FFFFFFF, (a, b)
    return (a * b + 0x80000000) >> 32


def mul_shift(a: int, b: int, n: int) -> int:
    """floor(a * b / 2^n) of a signed 64-bit a and a signed 32-bit b; the result fits 64 bits."""
    assert INT64_MIN <= a <= INT64_MAX and INT32_MIN <= b <= INT32_MAX, (a, b)
    product = (a * b) >> n
    assert INT64_MIN <= product <= INT64_MAX, (a, b, n)
    return product


def add_scaled(x: int, a: int, b: int, n: int) -> int:
    """x + a * b / 2^n of signed 32-bit values, rounded to nearest, halves up, and saturated to 32 bits."""
    assert INT32_MIN <= a <= INT32_MAX and INT32_MIN <= b <= INT32_MAX, (a, b)
    return sat_i32(x + ((a * b + (1 << (n - 1))) >> n))


def sat_shl_hi(x: int, n: int) -> int:
    """Upper word of a signed 64-bit x times 2^n, saturated to 32 bits."""
    assert INT64_MIN <= x <= INT64_MAX, x
    limit = 0x80000000 >> n
    hi = clamp(x >> 32, -limit, limit - 1)
    return wrap_i32(((hi << 32) + wrap_u32(x)) >> (32 - n))
