"""The formats are wide enough and not wasteful: what the golden vectors make of every word, extremes included."""

from __future__ import annotations

import pytest

from plumb import systems
from plumb.proof import ranges
from plumb.spec.records import names_of


@pytest.mark.parametrize("system", systems.SYSTEMS)
def test_every_word_is_used(system: str) -> None:
    rows = {row.name: row for row in ranges.used(system)}
    assert tuple(rows) == names_of(system)
    filled = [row for name, row in rows.items() if not name.startswith("unused_")]  # what fills a frame of inputs is 0
    assert all(row.worst > 0 for row in filled), "a word that no vector ever moves proves nothing"


def test_quads_words_stay_within_what_the_design_says() -> None:
    worst = {row.name: row.worst for row in ranges.used("quad")}
    assert worst["rate_turnps_q28"] <= 7 and worst["rate_corrected_turnps_q28"] <= 8
    assert worst["accel_y_g_q26"] <= 28 and worst["p00"] <= 2**56 and worst["p11"] <= 2**56
    assert worst["k0_q29"] < 1 and worst["k1_q29"] < 1 and worst["variance"] <= 2**24
    assert worst["integral_q54"] <= 2 and worst["excess_q22"] < 257
    assert worst["bias_turn_q61"] <= 1 / 8 and worst["pulse_halfus_0"] <= 4200


def test_balancers_words_stay_within_what_the_design_says() -> None:
    worst = {row.name: row.worst for row in ranges.used("balancer")}
    assert worst["setpoint_mps_q26"] == 32 and 14 < worst["speed_mps_q26"] <= 15
    assert worst["velocity_mps_q26"] <= 15 + 2**-26 and worst["speed_error_mps_q26"] <= 23
    assert worst["wheel_accel_g_q26"] == 3 and worst["accel_filtered_g_q25"] <= 3, "reached, and held"
    assert worst["gravity_x_g_q26"] <= 31 and worst["rate_turnps_q28"] <= 7 and worst["rate_corrected_turnps_q28"] <= 8
    assert worst["speed_command_q22"] == 1 and worst["speed_integral_q54"] <= 2 and worst["speed_excess_q22"] < 257
    assert worst["lean_turn_q32"] <= 1 / 16 and 0.9999 < worst["duty_q15"] < 1
    assert worst["p00"] <= 2**56 and worst["p11"] <= 2**56 and worst["k0_q29"] < 1 and worst["k1_q29"] < 1


def test_turntables_words_stay_within_what_the_design_says() -> None:
    limits = {
        "gyro_last": 32767, "angular_last": 32767, "gyro_before": 32767, "angular_before": 32767, "gyro_spikes": 7,
        "angular_spikes": 7, "gyro_gap_steps": 65535, "angular_gap_steps": 65535, "rate_turnps": 7, "rate_fused": 7,
        "rate_corrected": 7, "acceleration": 7, "increment": 1 / 16, "gyro_age": 16, "lag_step": 16, "bias_gyro": 1 / 8,
        "bias_angular": 2**-11, "scale_q30": 1 / 4, "innovation": 4, "attitude": 1 + 2**-28, "scale_variance": 2**-8,
        "lag_variance": 1, **{f"{of}_{state}": 8 for of in ("scale", "lag") for state in ("rate", "gyro", "ang")},
        **{f"p{i}": 2**-6 for i in range(4)}, "p4": 2**-3,
    }  # fmt: skip
    reached = dict.fromkeys(limits, 0.0)
    for row in ranges.used("turntable"):
        kind = max((name for name in limits if row.name.startswith(name)), key=len, default=None)
        if kind is None:
            assert row.name.startswith(("raw", "setpoint", "clamped_steps", "flags", "step")), row.name
        else:
            reached[kind] = max(reached[kind], row.worst)
    assert {name: worst for name, worst in reached.items() if not 0 < worst <= limits[name]} == {}
    assert reached["innovation"] == 4 and reached["gyro_gap_steps"] == 65535, "reached, and held"
