"""What control_params_valid accepts ends where the arithmetic pages say: the last good value, the first bad one."""

from __future__ import annotations

import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams
from plumb.spec import declarations, parameters

DEFAULT = {row.name: row.default for row in parameters.table() if row.owner == "control"}
LIMIT = 7 << 28
UNIT_GAIN = {"gyro.raw_min": -100, "gyro.raw_max": 100, "gyro.gain": 1}
WIDE_P0 = {"start.p00_hi": 1 << 25, "start.p00_lo": 0, "kalman.qa_hi": 1 << 24, "kalman.qa_lo": 0}
STEEPEST = {"tilt.r_base": 1 << 20, "tilt.r_max": 1 << 24, "tilt.deviation_max": (1 << 16) - 1,
            "tilt.deviation_shift": 16}  # fmt: skip
SLOW = {"kalman.rate_shift": 1, "kalman.rate_gain": 1 << 30, "kalman.bias_max_turn_q29": 1}


def valid(**words: int) -> bool:
    return native_core.params_valid(ControlParams(DEFAULT | words))


def test_the_factory_values_are_valid() -> None:
    assert valid()


@pytest.mark.parametrize(
    ("name", "good", "bad", "others"),
    [
        ("gyro.raw_min", 1951, 1952, {"gyro.gain": 0, "gyro.offset": 0}),  # raw_max
        ("gyro.raw_min", -32768, -32769, {"gyro.gain": 0, "gyro.offset": 0}),
        ("gyro.raw_max", 32767, 32768, {"gyro.gain": 0, "gyro.offset": 0}),
        ("gyro.offset", LIMIT - 100, LIMIT - 99, UNIT_GAIN),
        ("gyro.offset", 100 - LIMIT, 99 - LIMIT, UNIT_GAIN),
        ("gyro.offset", LIMIT - 100, LIMIT - 99, UNIT_GAIN | {"gyro.gain": -1}),
        ("gyro.offset", 100 - LIMIT, 99 - LIMIT, UNIT_GAIN | {"gyro.gain": -1}),
        ("system", 0, 1 + max(one.number for one in declarations.systems().values()), {}),
        ("tilt.mode", 1, 2, {}),
        ("tilt.r_base", 1, 0, {}),
        ("tilt.r_max", 5000, 4999, {"tilt.r_base": 5000}),
        ("tilt.r_max", 1 << 24, (1 << 24) + 1, {}),
        ("tilt.deviation_max", (1 << 16) - 1, 1 << 16, {"tilt.deviation_shift": 16, "tilt.r_gain": 0}),
        ("tilt.deviation_shift", 31, 32, {"tilt.deviation_max": 0}),
        # ((2^32 - 2^16)^2 >> 32) * r_gain >> 32 below 2^32 - 2^20
        ("tilt.r_gain", 4294049762, 4294049763, STEEPEST),
        ("kalman.dt_s_q33", 1, 0, {}),
        ("kalman.rate_now", 2, 3, {}),
        ("kalman.rate_shift", 1, 0, SLOW),
        ("kalman.rate_shift", 16, 17, SLOW | {"kalman.bias_max_turn_q29": 0}),
        ("kalman.rate_gain", 1 << 30, (1 << 30) - 1, SLOW),
        ("kalman.bias_max_turn_q29", 0, -1, {}),
        # (bias_max + 1) * 2 * 2^30 below 2^60
        ("kalman.bias_max_turn_q29", (1 << 29) - 2, (1 << 29) - 1, SLOW),
        ("kalman.qa_hi", 1 << 24, (1 << 24) + 1, {"kalman.qa_lo": 0}),
        ("kalman.qb_frac_q30", (1 << 30) - 1, 1 << 30, {}),
        ("start.bias_hi", (1 << 26) - 1, 1 << 26, {}),
        ("start.bias_hi", 1 - (1 << 26), -(1 << 26), {}),
        ("start.p00_hi", 1 << 25, (1 << 25) + 1, {"start.p00_lo": 0}),
        ("start.p11_hi", (1 << 24) - 1, 1 << 24, {"start.p11_lo": 0}),
        ("start.p01_hi", 1 << 22, (1 << 22) + 1, WIDE_P0),  # qa / 4
        ("start.p01_hi", 3, 4, WIDE_P0 | {"start.p00_hi": 3}),
        ("start.p01_hi", -3, -4, WIDE_P0 | {"start.p00_hi": 3}),
        ("start.p01_hi", -(1 << 24), -(1 << 24) - 1, WIDE_P0),
        ("pid.kp_q22", 1 << 30, (1 << 30) + 1, {}),
        ("pid.kp_q22", -(1 << 30), -(1 << 30) - 1, {}),
        ("pid.kd_q27", 1 << 30, (1 << 30) + 1, {}),
        ("pid.kd_q27", -(1 << 30), -(1 << 30) - 1, {}),
        ("pid.ki_dt_q22", 0, -1, {}),
        ("pid.d_alpha_q31", 0, -1, {}),
        ("pid.slew_q22", 1, 0, {}),
        ("pid.slew_q22", 1 << 23, (1 << 23) + 1, {}),
        ("esc.mid_halfus", 2000, 1999, {}),  # min
        ("esc.mid_halfus", 4000, 4001, {}),  # max
        ("esc.span_halfus", 2400, 2401, {}),
        ("esc.span_halfus", -2400, -2401, {}),
        ("esc.min_halfus", 2000, 1999, {}),  # neutral
        ("esc.min_halfus", 3000, 3001, {}),  # mid
        ("esc.max_halfus", 4200, 4201, {}),
        ("esc.max_halfus", 3000, 2999, {}),  # mid
        ("esc.neutral_halfus", 1800, 1799, {}),
        ("esc.neutral_halfus", 2000, 2001, {}),  # min
        ("esc.neutral_halfus", 2200, 2201, {"esc.min_halfus": 2300}),
    ],
)  # fmt: skip
def test_last_good_and_first_bad(name: str, good: int, bad: int, others: dict[str, int]) -> None:
    assert valid(**others | {name: good})
    assert not valid(**others | {name: bad})
