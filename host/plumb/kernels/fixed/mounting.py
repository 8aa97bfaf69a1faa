"""Mounting of a three-axis sensor in integers: plumb_mounting_apply, plumb_mounting_valid."""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, select

LIMIT = 7 << 28
"""Limit of every calibrated value: 7 turn/s, 28 g."""
ONE_Q30 = 1 << 30
NAMES = tuple(f"{row}{column}_q30" for row in "xyz" for column in "xyz")
"""Parameters of the group, in their order: body axis, sensor axis."""


def mount(p: Params, group: str, v: tuple[Integer, Integer, Integer]) -> tuple[list[Integer], Integer]:
    """The vector in the body's axes, and 1 where a component was limited, else 0."""
    found, limited = [], 0
    for row in "xyz":
        total = sum(p[f"{group}.{row}{column}_q30"] * value for column, value in zip("xyz", v, strict=True))
        exact = (total + (1 << 29)) >> 30
        kept = clamp(exact, -LIMIT, LIMIT)
        limited = limited | select(kept != exact, 1, 0)
        found.append(kept)
    return found, limited


def valid(p: Params, group: str) -> bool:
    """Whether the firmware would accept this mounting at a commit; p: one set."""
    m = [[int(p[f"{group}.{row}{column}_q30"]) for column in "xyz"] for row in "xyz"]
    if any(sum(abs(entry) for entry in row) >= 2 * ONE_Q30 for row in m):
        return False

    def minor(left: int, right: int) -> int:
        return (m[1][left] * m[2][right] - m[1][right] * m[2][left]) >> 32

    determinant = m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
    return 1 << 57 <= determinant <= 1 << 59
