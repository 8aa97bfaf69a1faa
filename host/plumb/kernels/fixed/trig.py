"""Arc tangent, arc sine, sine, cosine and length, from docs/reference/arithmetic/kernels.md alone; the integer side of
`plumb.contract.run_fixed`."""

from __future__ import annotations

from plumb.kernels.integers import clz32, mulhi_u32, wrap_i32, wrap_u32

ATAN_Q33 = (1367129643, -455662709, 272695593, -190149124, 131821425, -76439450, 29889517, -5543123)
ASIN_Q32 = (1073741824, -146689165, 60745628, -33710821, 19130782, -8341557, 1831557)
SIN_Q31 = (1686629690, -173399356, 5346959, -77046)
COS_Q32 = (1324675872, -68093819, 1399910, -15167)
LENGTH_MAX = 7 << 28

# fmt: off
ROOT = (
    0xFFFD03E9, 0xFC1503BC, 0xF8590393, 0xF4C6036C, 0xF15A0349, 0xEE110327, 0xEAEA0308, 0xE7E202EB,
    0xE4F802CF, 0xE22802B5, 0xDF73029D, 0xDCD60286, 0xDA500270, 0xD7E0025C, 0xD5840249, 0xD33B0236,
    0xD1050225, 0xCEE00214, 0xCCCC0205, 0xCAC701F6, 0xC8D201E7, 0xC6EB01DA, 0xC51101CD, 0xC34401C0,
    0xC18401B4, 0xBFCF01A9, 0xBE26019E, 0xBC880194, 0xBAF4018A, 0xB96A0180, 0xB7EA0177, 0xB673016E,
    0xB5040166, 0xB39F015E, 0xB2410156, 0xB0EB014E, 0xAF9D0147, 0xAE560140, 0xAD160139, 0xABDD0133,
    0xAAAA012C, 0xA97E0126, 0xA8580120, 0xA738011B, 0xA61D0115, 0xA5080110, 0xA3F8010B, 0xA2EE0106,
    0xA1E80101, 0xA0E800FC, 0x9FEC00F7, 0x9EF400F3, 0x9E0100EF, 0x9D1300EA, 0x9C2800E6, 0x9B4200E2,
    0x9A5F00DF, 0x998100DB, 0x98A600D7, 0x97CF00D4, 0x96FB00D0, 0x962A00CD, 0x955D00CA, 0x949400C7,
    0x93CD00C4, 0x930900C1, 0x924900BE, 0x918B00BB, 0x90D100B8, 0x901900B5, 0x8F6300B3, 0x8EB100B0,
    0x8E0100AE, 0x8D5300AB, 0x8CA800A9, 0x8BFF00A6, 0x8B5900A4, 0x8AB500A2, 0x8A1300A0, 0x8974009D,
    0x88D6009B, 0x883B0099, 0x87A20097, 0x870A0095, 0x86750093, 0x85E20092, 0x85500090, 0x84C0008E,
    0x8433008C, 0x83A6008A, 0x831C0089, 0x82930087, 0x820C0085, 0x81870084, 0x81030082, 0x80810081,
)
# fmt: on
"""Segments of 1 / sqrt, Q16: value at the left end (upper half), decrease over the segment (lower half)."""


def reciprocal(d: int) -> int:
    """2^61 / d for 2^30 <= d < 2^31: one division of 32 bits, one Newton step."""
    assert 1 << 30 <= d < 1 << 31, d
    x = 0xFFFFFFFF // (d >> 15)
    e = wrap_i32(x * (d >> 1))
    return (x << 14) - ((x * ((e >> 17) + 1)) >> 15)


def polynomial(c: tuple[int, ...], v: int) -> int:
    """c[0] + c[1] v + c[2] v^2 + ...; v in Q30, 0 to 1."""
    assert 0 <= v <= 1 << 30, v
    p = c[-1]
    for coefficient in c[-2::-1]:
        p = coefficient + 4 * ((p * v) >> 32)
    return p


def atan2(y: int, x: int) -> int:
    """Angle of the point (x, y), turn Q32; the half turn is -2^31 and (0, 0) is 0."""
    ax, ay = abs(x), abs(y)
    longer = max(ax, ay, 1)
    n = clz32(longer)
    m = (min(ax, ay) << n) >> 1
    d = (longer << n) >> 1
    t = (m * reciprocal(d)) >> 31
    s = (t * t) >> 30
    turn = (t * polynomial(ATAN_Q33, s)) >> 31
    if ay > ax:
        turn = (1 << 30) - turn
    if x < 0:
        turn = (1 << 31) - turn
    return wrap_i32(-turn if y < 0 else turn)


def root(w: int) -> int:
    """sqrt(w / 2^30), Q29, of 2^30 <= w < 2^32."""
    assert 1 << 30 <= w < 1 << 32, w
    entry = ROOT[(w >> 25) - 32]
    r = (entry >> 16) - (((entry & 0xFFFF) * ((w >> 9) & 0xFFFF)) >> 16)
    s = (w * r) >> 17
    e = wrap_i32(mulhi_u32(w, wrap_u32(r * r)) - (1 << 30))
    return s - ((s * e) >> 31)


def asin(x: int) -> int:
    """Angle whose sine is x / 2^30, turn Q32; beyond +-1 a quarter turn."""
    v = min(abs(x), 1 << 30)
    rest = max((1 << 30) - v, 1)
    m = clz32(rest) & ~1
    acos = ((root(rest << m) * polynomial(ASIN_Q32, v)) >> 29) >> (m >> 1)
    if v == 1 << 30:
        acos = 0
    turn = (1 << 30) - acos
    return -turn if x < 0 else turn


def length(y: int, x: int) -> int:
    """Half the length of (x, y), for components of at most 7 * 2^28."""
    assert -LENGTH_MAX <= y <= LENGTH_MAX and -LENGTH_MAX <= x <= LENGTH_MAX, (y, x)
    square = (y * y + x * x) | 1
    n = (64 - square.bit_length()) & ~1
    return (root((square << n) >> 32) << 1) >> (n >> 1)


def sincos(turn: int) -> tuple[int, int]:
    """Sine and cosine of a binary angle, Q30."""
    quadrant = wrap_u32(turn + (1 << 29)) >> 30
    x = wrap_i32(turn - (quadrant << 30))
    v = (x * x) >> 28
    sine = (x * polynomial(SIN_Q31, v)) >> 30
    cosine = (1 << 30) - ((v * polynomial(COS_Q32, v)) >> 32)
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[quadrant]
