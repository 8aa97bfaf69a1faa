"""`attitude` when the bias of the gyro steps, and when something else looks like it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from plumb.analyses.comparison import motions
from plumb.analyses.comparison.contenders import contenders
from plumb.analyses.comparison.table import compare
from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.attitude import scenarios as attitude
from plumb.systems.attitude.quantise import quantise
from plumb.systems.attitude.settings import Aid
from support.prescribed_motion import (
    PERIOD_US,
    UNIT_DPS,
    UNIT_G,
    UP,
    error_deg,
    felt,
    flagged,
    run,
    sigma_deg,
    steps,
    still,
    swing,
)

AT_S = 12.0


def rested(seconds: float) -> tuple[npt.NDArray[np.int16], FloatArray]:
    """Counts (n, 6) and vertical (n, 3) of a body that lies level."""
    n = steps(seconds)
    return np.tile(np.array([0, 0, 0, 0, 0, round(1.0 / UNIT_G)], np.int16), (n, 1)), np.tile(UP, (n, 1))


def bias_dps(words: Words) -> FloatArray:
    return np.array([words[f"bias_turnps_q32_{axis}"][-1] * 360.0 / 2.0**32 for axis in range(3)])


@pytest.mark.parametrize("step_dps", [(1.0, 0.0, 0.0), (-3.0, 3.0, 3.0), (0.0, -10.0, 0.0), (10.0, 10.0, -10.0)])
def test_at_rest_a_step_of_the_bias_is_learned_within_seconds(step_dps: tuple[float, float, float]) -> None:
    raw, up = rested(30.0)
    raw[steps(AT_S) :, :3] += np.rint(np.array(step_dps) / UNIT_DPS).astype(np.int16)
    words = run(raw)
    error = error_deg(words, up)
    # What the gyro turns until the acceleration leans by 3.6 deg, and in the second of a rest.
    assert error.max() < 5.0 + 1.6 * np.hypot(*step_dps[:2])
    assert flagged(words, "UNSURE")[steps(AT_S) :].any(), "it is reported"
    # 2 deg within 20 s is asked for; 0.1 deg after 8 s is reached.
    assert error[steps(AT_S + 8.0) :].max() < 0.3
    assert bias_dps(words) == pytest.approx(step_dps, abs=0.1)
    assert not flagged(words, "RESTARTED").any()


@pytest.mark.parametrize("in_hand", [False, True], ids=["at rest", "in the hand"])
def test_integers_and_core_take_a_step_to_the_same_bits(in_hand: bool) -> None:
    """No golden vector has one: every word of both, while the variances open again."""
    rate = np.vstack([still(6.0)[0], swing(24.0, 40.0, 2.0)]) if in_hand else still(30.0)[0]
    raw, _ = felt(rate, np.zeros_like(rate))
    raw[steps(AT_S) :, :3] += np.rint(np.array([6.0, -6.0, 6.0]) / UNIT_DPS).astype(np.int16)
    tuning = replace(attitude.DEFAULT, period_us=5 * PERIOD_US)
    params, raw = quantise(tuning), raw[::5]
    core = native_core.run_control(params, raw, np.zeros(len(raw), np.int32))
    assert flagged(core, "UNSURE")[steps(AT_S) // 5 :].any()
    fixed = run_fixed.run_control(params, raw, np.zeros(len(raw), np.int32))
    assert np.array_equal(fixed.digests(), core.digests())


def test_a_step_about_the_vertical_is_a_turn_that_leaves_the_bias_alone() -> None:
    """A turntable looks the same, and neither tilts."""
    raw, up = rested(30.0)
    raw[steps(AT_S) :, 2] += round(4.0 / UNIT_DPS)
    words = run(raw)
    assert error_deg(words, up).max() < 0.1
    assert bias_dps(words) == pytest.approx([0.0] * 3, abs=0.1)


@pytest.mark.parametrize("rate_dps", [0.8, 2.0, 11.0])
def test_a_slow_turn_at_rest_is_no_step(rate_dps: float) -> None:
    rate, moved = still(24.0)
    rate[steps(AT_S) : steps(AT_S + 8.0), 0] = rate_dps
    raw, up = felt(rate, moved)
    words = run(raw)
    assert error_deg(words, up).max() < 1.0
    assert not flagged(words, "UNSURE")[steps(AT_S) :].any()


@pytest.mark.parametrize(
    ("accel_g", "turn_dps", "reads"), [(0.1, 0.0, 1.0), (0.6, 0.0, 1.0), (0.3, 8.0, 1.0), (0.3, 0.0, 0.98)]
)
def test_a_steady_acceleration_is_no_step(accel_g: float, turn_dps: float, reads: float) -> None:
    """Nor one together with a steady turn, nor with an accelerometer that reads too little."""
    rate, moved = still(26.0)
    moved[steps(AT_S) : steps(AT_S + 4.0), 0] = accel_g
    moved[steps(AT_S + 8.0) : steps(AT_S + 12.0), 0] = -accel_g
    rate[steps(AT_S + 1.0) : steps(AT_S + 3.0), 1] = turn_dps
    raw, up = felt(rate, moved)
    raw[:, 3:] = np.rint(reads * raw[:, 3:])
    words = run(raw)
    assert error_deg(words, up).max() < 1.5
    assert not flagged(words, "RESTARTED").any() and not flagged(words, "UNSURE")[steps(AT_S) :].any()


@pytest.mark.parametrize("rest_s", [0.6, 1.6, 2.0])
def test_a_vehicle_that_brakes_never_restarts(rest_s: float) -> None:
    """It drove off before the filter knew its bias, and took the acceleration for the vertical."""
    rate, moved = still(rest_s + 24.0)
    for begin_s, accel_g in ((0.0, 0.3), (10.0, -0.3), (16.0, -0.3)):
        moved[steps(rest_s + begin_s) : steps(rest_s + begin_s + 4.0), 0] = accel_g
    words = run(felt(rate, moved)[0])
    assert not flagged(words, "RESTARTED")[: steps(rest_s + 20.0)].any()


def test_a_vehicle_that_shakes_by_5_deg_and_drives_off_is_no_step() -> None:
    rate, moved = np.vstack([still(8.0)[0], swing(30.0, 60.0, 2.0)]), np.zeros((steps(38.0), 3))
    moved[steps(12.0) : steps(16.0), 0] = 0.3
    moved[steps(24.0) : steps(28.0), 0] = -0.3
    raw, up = felt(rate, moved)
    words = run(raw)
    assert error_deg(words, up).max() < 5.5, "a third of what the accelerometer says"
    assert sigma_deg(words)[steps(8.0) :].max() < 5.0


def test_no_vehicle_restarts_before_it_has_landed() -> None:
    """Climbing and coasting: the acceleration has no vertical part for seconds."""
    raw, _ = rested(24.0)
    thrust = np.where(np.arange(len(raw)) < steps(8.0), 0.0, 0.45)
    raw[steps(9.0) : steps(9.5), 5] += 600
    coasts = slice(steps(12.0), steps(20.0))
    raw[coasts, 5] = raw[coasts, 5] // 5
    tuning = replace(attitude.DEFAULT, period_us=PERIOD_US, aid=Aid(drag_per_s=0.28, hover=0.45))
    words = native_core.run_control(quantise(tuning), raw, np.rint(32767 * thrust).astype(np.int32))
    alone = native_core.run_control(quantise(replace(tuning, aid=Aid())), raw, np.zeros(len(raw), np.int32))
    assert flagged(words, "AIRBORNE")[coasts].all()
    unsure = [flagged(one, "UNSURE")[coasts].any() for one in (words, alone)]
    assert unsure == [False, True], "nothing falls for so long on the ground"
    assert not flagged(words, "RESTARTED").any() and not flagged(alone, "RESTARTED").any()


@pytest.mark.parametrize(("name", "rms_deg"), [("bias-step", 4.0), ("bias-step-rest", 1.2)])
def test_a_drawn_step_costs_less_than_it_costs_vqf(name: str, rms_deg: float) -> None:
    """2.9 and 0.7 deg are reached in the mean of 20 seeds; VQF has 4.9 and 5.7."""
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    (result,) = compare([motions.of_motion(name, range(1000, 1004))], contenders(["VQF", "attitude"]), lambda: None)
    own, other = result.means("attitude"), result.means("VQF")
    assert own is not None and other is not None
    assert own.rmse_deg < min(rms_deg, other.rmse_deg) and own.max_deg < other.max_deg
    for one, rival in zip(result.rows[1::2], result.rows[::2], strict=True):
        # A step about the vertical, which tilts neither at rest, is not learned there: some tenths of a degree.
        assert one.rmse_deg < rival.rmse_deg + 0.4
