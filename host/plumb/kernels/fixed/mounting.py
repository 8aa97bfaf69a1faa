"""Mounting of a three-axis sensor in integers: plumb_mounting_apply, plumb_mounting_valid."""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp

LIMIT = 7 << 28
"""Limit of every calibrated value: 7 turn/s, 28 g."""
ONE_Q30 = 1 << 30
NAMES = tuple(f"{row}{column}_q30" for row in "xyz" for column in "xyz")
"""Parameters of the group, in their order: body axis, sensor axis."""


def mount(p: Params, group: str, v: tuple[int, int, int]) -> tuple[tuple[int, int, int], bool]:
    """The vector in the body's axes, and whether a component was limited."""
    x, y, z = v
    assert -LIMIT <= x <= LIMIT and -LIMIT <= y <= LIMIT and -LIMIT <= z <= LIMIT, v
    exact_x = (p[f"{group}.xx_q30"] * x + p[f"{group}.xy_q30"] * y + p[f"{group}.xz_q30"] * z + (1 << 29)) >> 30
    exact_y = (p[f"{group}.yx_q30"] * x + p[f"{group}.yy_q30"] * y + p[f"{group}.yz_q30"] * z + (1 << 29)) >> 30
    exact_z = (p[f"{group}.zx_q30"] * x + p[f"{group}.zy_q30"] * y + p[f"{group}.zz_q30"] * z + (1 << 29)) >> 30
    exact = exact_x, exact_y, exact_z
    kept = clamp(exact_x, -LIMIT, LIMIT), clamp(exact_y, -LIMIT, LIMIT), clamp(exact_z, -LIMIT, LIMIT)
    return kept, kept != exact


def valid(p: Params, group: str) -> bool:
    """Whether the firmware would accept this mounting at a commit; p: one set."""
    m = [[p[f"{group}.{row}{column}_q30"] for column in "xyz"] for row in "xyz"]
    if any(sum(abs(entry) for entry in row) >= 2 * ONE_Q30 for row in m):
        return False

    def minor(left: int, right: int) -> int:
        return (m[1][left] * m[2][right] - m[1][right] * m[2][left]) >> 32

    determinant = m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
    return 1 << 57 <= determinant <= 1 << 59
