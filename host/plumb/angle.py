"""Arc tangent and arc sine as binary angles, from DESIGN.md "Numbers" alone; the integer side of `plumb.fixed`.

Like all kernels here they take ints, or int64 arrays, and give the same for both.
"""

from __future__ import annotations

import numpy as np

from plumb.integers import Integer, clamp, clz32, mulhi_u32, select, wrap_i32, wrap_u32

ATAN_Q33 = (1367129643, -455662709, 272695593, -190149124, 131821425, -76439450, 29889517, -5543123)
ASIN_Q32 = (1073741824, -146689165, 60745628, -33710821, 19130782, -8341557, 1831557)

ROOT = tuple(
    int(entry, 16)
    for entry in [
        "fffd03e9",
        "fc1503bc",
        "f8590393",
        "f4c6036c",
        "f15a0349",
        "ee110327",
        "eaea0308",
        "e7e202eb",
        "e4f802cf",
        "e22802b5",
        "df73029d",
        "dcd60286",
        "da500270",
        "d7e0025c",
        "d5840249",
        "d33b0236",
        "d1050225",
        "cee00214",
        "cccc0205",
        "cac701f6",
        "c8d201e7",
        "c6eb01da",
        "c51101cd",
        "c34401c0",
        "c18401b4",
        "bfcf01a9",
        "be26019e",
        "bc880194",
        "baf4018a",
        "b96a0180",
        "b7ea0177",
        "b673016e",
        "b5040166",
        "b39f015e",
        "b2410156",
        "b0eb014e",
        "af9d0147",
        "ae560140",
        "ad160139",
        "abdd0133",
        "aaaa012c",
        "a97e0126",
        "a8580120",
        "a738011b",
        "a61d0115",
        "a5080110",
        "a3f8010b",
        "a2ee0106",
        "a1e80101",
        "a0e800fc",
        "9fec00f7",
        "9ef400f3",
        "9e0100ef",
        "9d1300ea",
        "9c2800e6",
        "9b4200e2",
        "9a5f00df",
        "998100db",
        "98a600d7",
        "97cf00d4",
        "96fb00d0",
        "962a00cd",
        "955d00ca",
        "949400c7",
        "93cd00c4",
        "930900c1",
        "924900be",
        "918b00bb",
        "90d100b8",
        "901900b5",
        "8f6300b3",
        "8eb100b0",
        "8e0100ae",
        "8d5300ab",
        "8ca800a9",
        "8bff00a6",
        "8b5900a4",
        "8ab500a2",
        "8a1300a0",
        "8974009d",
        "88d6009b",
        "883b0099",
        "87a20097",
        "870a0095",
        "86750093",
        "85e20092",
        "85500090",
        "84c0008e",
        "8433008c",
        "83a6008a",
        "831c0089",
        "82930087",
        "820c0085",
        "81870084",
        "81030082",
        "80810081",
    ]
)
"""Segments of 1 / sqrt: upper half its left end, lower half the fall over it, Q16."""
ROOT_ARRAY = np.array(ROOT, np.int64)


def reciprocal(d: Integer) -> Integer:
    """2^61 / d for 2^30 <= d < 2^31: one division of 32 bits, one Newton step."""
    x = 0xFFFFFFFF // (d >> 15)
    e = wrap_i32(x * (d >> 1))
    return (x << 14) - ((x * ((e >> 17) + 1)) >> 15)


def polynomial(c: tuple[int, ...], v: Integer) -> Integer:
    """c[0] + c[1] v + c[2] v^2 + ...; v in Q30, 0 to 1."""
    p = c[-1]
    for coefficient in c[-2::-1]:
        p = coefficient + 4 * ((p * v) >> 32)
    return p


def atan2(y: Integer, x: Integer) -> Integer:
    """Angle of the point (x, y), turn Q32; the half turn is -2^31 and (0, 0) is 0."""
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    longer = clamp(select(steep, ay, ax), 1, 1 << 31)
    n = clz32(longer)
    m = (select(steep, ax, ay) << n) >> 1
    d = (longer << n) >> 1
    t = (m * reciprocal(d)) >> 31
    s = (t * t) >> 30
    turn = (t * polynomial(ATAN_Q33, s)) >> 31
    turn = select(steep, (1 << 30) - turn, turn)
    turn = select(x < 0, (1 << 31) - turn, turn)
    return wrap_i32(select(y < 0, -turn, turn))


def asin(x: Integer) -> Integer:
    """Angle whose sine is x / 2^30, turn Q32; beyond +-1 a quarter turn."""
    v = clamp(abs(x), 0, 1 << 30)
    rest = clamp((1 << 30) - v, 1, 1 << 30)
    m = clz32(rest) & ~1
    w = rest << m
    segment = (w >> 25) - 32
    entry = ROOT[segment] if isinstance(segment, int) else ROOT_ARRAY[segment]
    r = (entry >> 16) - (((entry & 0xFFFF) * ((w >> 9) & 0xFFFF)) >> 16)
    s = (w * r) >> 17
    e = wrap_i32(mulhi_u32(w, wrap_u32(r * r)) - (1 << 30))
    root = s - ((s * e) >> 31)
    acos = ((root * polynomial(ASIN_Q32, v)) >> 29) >> (m >> 1)
    acos = select(v == 1 << 30, 0, acos)
    turn = (1 << 30) - acos
    return select(x < 0, -turn, turn)
