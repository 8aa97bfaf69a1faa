"""Ranges of parameters that a declaration generates, against this list, which is written by hand from the arithmetic
pages: the last good value and the first bad one, in C and in the integer model."""

from __future__ import annotations

from itertools import product

import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams
from plumb.spec import declarations, parameters
from plumb.systems.balancer import fixed as balancer
from plumb.systems.quadrotor import fixed as quadrotor
from plumb.systems.wheels import fixed as wheels

STEPS = 65535
GAIN, WORD = 1 << 30, (1 << 31) - 1
RANGES = {
    "balancer": {
        "wheel.edges_max": (1, 32767),
        "wheel.edge_mps_q26": (-(15 << 26), 15 << 26),
        "wheel.alpha_q31": (0, WORD),
        "wheel.accel_gain_q30": (0, WORD),
        "speed.kp_q22": (-GAIN, GAIN),
        "speed.ki_dt_q22": (0, WORD),
        "speed.kd_q27": (-GAIN, GAIN),
        "speed.d_alpha_q31": (0, WORD),
        "speed.slew_q22": (1, 1 << 23),
        "drive.speed_max_mps_q26": (0, 8 << 26),
        "drive.lean_max_turn_q34": (0, 1 << 30),
        "drive.span_q15": (-32767, 32767),
        "drive.duty_max_q15": (0, 32767),
        "drive.fall_turn_q32": (0, 1 << 31),
    },
    "quadrotor": {
        "quadrotor.tilt_max_q30": (0, 644245094),  # the sine of 36.87 deg, 0.6
        "quadrotor.tilt_gain_q28": (0, WORD),
        "quadrotor.tilt_rate_max_q28": (0, 5 << 28),
        "quadrotor.stick_rate_q28": (0, 5 << 28),
        "quadrotor.yaw_rate_max_q28": (0, 11 << 26),
        "quadrotor.d_alpha_q31": (0, WORD),
        "quadrotor.integral_max_q30": (0, 1 << 30),
        "quadrotor.yaw_max_q24": (0, 1 << 24),
        "quadrotor.idle_q24": (0, 1 << 22),
        "quadrotor.airmode": (0, 1),
        "quadrotor.low_q15": (0, 1 << 13),
        "quadrotor.lost_steps": (1, STEPS),
        "quadrotor.held_steps": (0, STEPS - 1),
        "quadrotor.back_steps": (1, STEPS),
        "quadrotor.lost_action": (0, 1),
        "quadrotor.land_gs_q28": (0, 1 << 27),
        "quadrotor.land_steps": (1, STEPS - 1),
        "quadrotor.blind_steps": (1, STEPS),
        "quadrotor.idle_limit": (1, STEPS),
        "quadrotor.lying_limit": (1, STEPS),
        "quadrotor.runaway_limit": (1, STEPS),
        "quadrotor.upturned_limit": (1, STEPS),
        "quadrotor.unsure_rate_q28": (0, 5 << 28),
        **{
            f"rate_{axis}.{name}": (0, WORD if name == "ki_dt_q35" else GAIN)
            for axis, name in product(("roll", "pitch", "yaw"), ("kp_q29", "ki_dt_q35", "kd_q28", "ff_q29"))
        },
    },
    "wheels": {
        "wheels.count_turnps_q28": (-(1 << 30), 1 << 30),
        "wheels.counts_max": (1, 32767),
        "wheels.bias_alpha_q31": (0, 1 << 30),
        "wheels.doubt_turnps_q28": (0, 1 << 28),
        "wheels.slip_turnps_q28": (0, 4 << 28),
        "wheels.slip_hold": (0, STEPS),
        "wheels.turn_max_turnps_q28": (0, 4 << 28),
        "wheels.integral_max_q30": (0, 1 << 30),
        "wheels.turn_duty_max_q15": (0, 32767),
        "wheels.lost_steps": (1, STEPS),
        "wheels.absent_steps": (1, STEPS),
        "wheels.stopping_steps": (0, STEPS - 1),
        "wheels.up_turn_q32": (0, 1 << 31),
        "wheels.turn_counts_q36": (-(1 << 30), 1 << 30),
        "wheels.slip_mps_q26": (0, 8 << 26),
        "wheels.felt_mps_q26": (0, 1 << 30),
        "wheels.apart_alpha_q31": (0, 1 << 30),
        "wheels.apart_max_mps_q26": (0, 1 << 30),
        "wheels.dead_steps": (2, STEPS),
        "wheels.rocked_turnps_q28": (0, (1 << 30) - 1),
        "wheels.full_steps": (1, STEPS),
        "wheels.still_steps": (1, STEPS),
        "turn.kp_q29": (0, GAIN),
        "turn.ki_dt_q35": (0, WORD),
        "turn.kd_q28": (0, GAIN),
        "turn.ff_q29": (0, GAIN),
    },
}
WIDER = {"wheel.edge_mps_q26": (-(1 << 30), 1 << 30)}
"""Declared ranges of words of which a kernel takes less, so that an old saved table still loads."""
MODELS = {"balancer": balancer.control_valid, "quadrotor": quadrotor.control_valid, "wheels": wheels.control_valid}
BESIDE = {
    "wheel.edges_max": {"wheel.edge_mps_q26": 1},
    "wheel.edge_mps_q26": {"wheel.edges_max": 1},
    "wheels.count_turnps_q28": {"wheels.counts_max": 1},
    "wheels.counts_max": {"wheels.count_turnps_q28": 1 << 15},
}
"""Other words with which a range is reached: the wheels may show 4 turn/s, and 15 m/s."""
CASES = [(system, name) for system, ranges in RANGES.items() for name in ranges]


@pytest.mark.parametrize("system", RANGES)
def test_every_parameter_of_the_system_is_in_the_list(system: str) -> None:
    declared = {row["name"]: (row["min"], row["max"]) for row in declarations.system(system).parameters}
    assert declared == {name: WIDER.get(name, limits) for name, limits in RANGES[system].items()}


@pytest.mark.parametrize(("system", "name"), CASES)
def test_last_good_and_first_bad(system: str, name: str) -> None:
    row = next(row for row in parameters.table() if row.name == name)
    least, most = (-(1 << 31), WORD) if row.type == "int32" else (0, (1 << 32) - 1)
    factory = {row.name: row.default for row in parameters.table() if row.owner == "control"}
    factory["system"] = declarations.system(system).number
    low, high = RANGES[system][name]
    for value in (low - 1, low, high, high + 1, least, most):
        if least <= value <= most:
            words, good = {**factory, **BESIDE.get(name, {}), name: value}, low <= value <= high
            assert native_core.params_valid(ControlParams(words)) is good, (name, value)
            assert MODELS[system](words) is good, (name, value)


def test_what_the_wheels_may_show() -> None:
    words = {row.name: row.default for row in parameters.table() if row.owner == "control"}
    words["system"] = declarations.system("wheels").number
    for count, most, good in (
        (1 << 25, 32, True),
        (-(1 << 25), 32, True),
        (1 << 25, 33, False),
        (-(1 << 25), 33, False),
    ):
        shown = {**words, "wheels.count_turnps_q28": count, "wheels.counts_max": most}
        assert native_core.params_valid(ControlParams(shown)) is good
        assert wheels.control_valid(shown) is good
