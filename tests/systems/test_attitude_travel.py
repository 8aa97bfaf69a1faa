"""`attitude` on a body that moves away, whose vertical was lost, or that flies on its rotors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.attitude import scenarios as attitude
from plumb.systems.attitude.quantise import G_MPS2, quantise
from plumb.systems.attitude.reference import Model
from plumb.systems.attitude.reference_state import Sums
from plumb.systems.attitude.settings import Aid
from support.prescribed_motion import (
    PERIOD_S,
    PERIOD_US,
    UNIT_DPS,
    UNIT_G,
    error_deg,
    felt,
    flagged,
    run,
    sigma_deg,
    steps,
    still,
    swing,
)

Counts = npt.NDArray[np.int16]

REST_S = 8.0
ACCEL_G = 0.3


def dash(speed_mps: float) -> FloatArray:
    """Acceleration (n, 3) in g: to that speed along x by 0.3 g, four seconds at it, and back to rest."""
    push = np.zeros((steps(speed_mps / G_MPS2 / ACCEL_G), 3))
    push[:, 0] = ACCEL_G
    return np.vstack([still(REST_S)[1], push, still(4.0)[1], -push, still(REST_S)[1]])


@pytest.mark.parametrize("speed_mps", [1.0, 1.9, 2.1, 5.0, 12.0, 20.0, 24.0, 26.0])
def test_a_dash_costs_a_fraction_of_what_the_accelerometer_says(speed_mps: float) -> None:
    """Speeds on both sides of travel, 2 m/s, and of what a body at rest cannot have, 25 m/s. The body shakes, as
    vehicles do."""
    moved = dash(speed_mps)
    rate = swing(len(moved) * PERIOD_S, 5.0, 2.0)
    rate[: steps(REST_S - 2.0)] = 0.0
    raw, up = felt(rate, moved)
    words = run(raw)
    error = error_deg(words, up)
    assert np.degrees(np.arctan(ACCEL_G)) > 16.0
    assert error.max() < 5.5, "a third of it"
    assert not flagged(words, "RESTARTED").any()
    assert flagged(words, "ACCELERATING").any() == (speed_mps > 1.0)


@pytest.mark.parametrize("speed_mps", [12.0, 20.0])
def test_a_dash_is_stated_as_uncertain_as_it_is(speed_mps: float) -> None:
    moved = dash(speed_mps)
    rate = swing(len(moved) * PERIOD_S, 5.0, 2.0)
    rate[: steps(REST_S - 2.0)] = 0.0
    raw, up = felt(rate, moved)
    words, driven = run(raw), slice(steps(REST_S), -steps(REST_S))
    rms_deg = np.sqrt(np.mean(error_deg(words, up)[driven] ** 2))
    # 0.7 to 2 is what is asked of every stated deviation; 0.72 and 0.84 are reached.
    assert 0.7 * rms_deg < sigma_deg(words)[driven].mean() < 2.0 * rms_deg


@pytest.mark.parametrize(("share", "doubted"), [(0.95, False), (1.05, True)])
def test_turns_are_doubted_by_a_lasting_velocity_beyond_that_of_a_body_that_moves_little(
    share: float, doubted: bool
) -> None:
    """`motion.velocity_mps`, 0.343 m/s, is what an arm of a metre leaves of its speed in the low-pass of 3 s."""
    tuning = attitude.TUNINGS["standard"]
    model, sums = Model(tuning), Sums()
    sums.square = 0.01
    x = model.begun()
    at_rest = model.tilt_growth(x, sums)
    x.travel_gs = np.array([0.0, share * tuning.motion.velocity_mps / G_MPS2])
    assert (model.tilt_growth(x, sums) > at_rest) == doubted


@pytest.mark.parametrize("unseen_deg", [30.0, 90.0, 135.0, 179.0])
def test_a_vertical_that_rest_contradicts_is_found_within_two_seconds(unseen_deg: float) -> None:
    """The gyro was dead while the body was turned: neither a clipped nor a missing sample shows it."""
    rate, moved = still(20.0)
    turn = slice(steps(10.0), steps(11.0))
    rate[turn, 0] = unseen_deg
    raw, up = felt(rate, moved)
    raw[turn, :3] = 0
    words = run(raw)
    error = error_deg(words, up)
    # or nothing is to be found: the smallest turn is 30 deg
    assert error[turn.stop - 1] > 20.0
    assert flagged(words, "RESTARTED").any()
    assert error[turn.stop + steps(2.0) :].max() < 1.0


def test_a_tilt_that_looks_like_a_slow_dash_waits_for_the_speed() -> None:
    """20 deg feel like 0.34 g: a body at rest would be faster than 25 m/s after 7.4 s."""
    rate, moved = still(30.0)
    turn = slice(steps(10.0), steps(11.0))
    rate[turn, 0] = 20.0
    raw, up = felt(rate, moved)
    raw[turn, :3] = 0
    words = run(raw)
    restarted = np.flatnonzero(flagged(words, "RESTARTED"))
    assert restarted[0] * PERIOD_S == pytest.approx(11.0 + 2.5 / np.sin(np.radians(20.0)), abs=1.0)
    assert error_deg(words, up)[-1] < 1.0


def flight(pitch_deg: float, drag_per_s: float, seconds: float) -> tuple[Counts, FloatArray, FloatArray]:
    """Counts (n, 6), vertical (n, 3) and thrust commands (n,) of a quadrotor that rests, takes off and flies pitched.

    It holds its height. Its accelerometer feels thrust and the drag of its rotors, and never gravity."""
    rest, tilt = steps(REST_S), np.radians(pitch_deg)
    n = rest + steps(seconds)
    rate, speed = np.zeros((n, 3)), 0.0
    rate[rest + steps(2.0) : rest + steps(3.0), 1] = pitch_deg
    raw, up = felt(rate, np.zeros_like(rate))
    for k in range(rest, n):
        angle = np.arctan2(-up[k, 0], up[k, 2])
        drag = -drag_per_s * speed / G_MPS2
        thrust_g = (1.0 + drag * np.sin(angle)) / np.cos(angle)
        speed += PERIOD_S * G_MPS2 * (thrust_g * np.sin(angle) + drag * np.cos(angle))
        raw[k, 3:] = np.rint(np.array([drag, 0.0, thrust_g]) / UNIT_G)
        raw[k, :3] = np.rint(rate[k] / UNIT_DPS)
    assert up[-1, 2] == pytest.approx(np.cos(tilt), abs=1e-3)
    return raw, up, np.asarray(np.where(np.arange(n) < rest, 0.0, 0.45), np.float64)


def flown(raw: Counts, thrust: FloatArray, setting_per_s: float) -> Words:
    tuning = replace(attitude.DEFAULT, period_us=PERIOD_US, aid=Aid(drag_per_s=setting_per_s, hover=0.45))
    channels = {
        name: replace(getattr(tuning, name), zero_counts=0.0, unit_per_count=unit, min_counts=-32767, max_counts=32767)
        for name, unit in (("gyro", UNIT_DPS), ("accel", UNIT_G))
    }
    setpoint = np.rint(32767 * thrust).astype(np.int32)
    return native_core.run_control(quantise(replace(tuning, **channels)), raw, setpoint)


def test_the_drag_of_the_rotors_holds_the_vertical_of_a_pitched_flight() -> None:
    raw, up, thrust = flight(15.0, 0.2, 40.0)
    begun = steps(REST_S + 5.0)
    aided, alone = flown(raw, thrust, 0.2), flown(raw, thrust, 0.0)
    assert flagged(aided, "AIRBORNE")[begun:].all() and not flagged(alone, "AIRBORNE").any()
    # 0.2 deg is reached without noise; 1.5 is the worst seed that is asked of flights of this kind.
    assert error_deg(aided, up)[begun:].max() < 1.5
    speed_mps = G_MPS2 * np.hypot(aided["velocity_gs_q28_0"], aided["velocity_gs_q28_1"]) / 2.0**28
    # The thrust that pitch takes sideways against the drag: within a tenth it has settled.
    assert speed_mps[-1] == pytest.approx(G_MPS2 * np.tan(np.radians(15.0)) / 0.2, rel=0.1)
    assert error_deg(flown(raw, thrust, 0.3), up)[begun:].max() < 4.0, "set half as large again"


def test_a_gust_makes_the_stated_tilt_as_large_as_the_error_that_it_brings() -> None:
    """5 m/s of wind from one step to the next, and a level hover that gives way to it."""
    raw, up, thrust = flight(0.0, 0.2, 30.0)
    gust = steps(REST_S + 12.0)
    since_s = np.arange(len(raw) - gust) * PERIOD_S
    raw[gust:, 3] += np.rint(0.2 * 5.0 * np.exp(-0.2 * since_s) / G_MPS2 / UNIT_G).astype(np.int16)
    words = flown(raw, thrust, 0.2)
    sigma, error = sigma_deg(words), error_deg(words, up)
    assert 1.5 <= sigma[gust - 1] < 1.6, "the least in flight"
    grows = slice(gust, gust + steps(4.0))
    # or it is another gust: the drag of 5 m/s at 0.2 / s is 0.1 g, 5.8 deg, and sigma grows against it: 3.5.
    assert 3.0 < error[grows].max() < 4.0 and (error[grows] < sigma[grows]).all()
    assert np.mean(sigma[gust:] ** 2) > np.mean(error[gust:] ** 2) and error[-1] < 0.5


def test_without_thrust_the_ground_that_carries_the_vehicle_ends_the_flight() -> None:
    raw, _, thrust = flight(0.0, 0.2, 10.0)
    landed = steps(REST_S + 6.0)
    thrust[landed:] = 0.0
    words = flown(raw, thrust, 0.2)
    assert flagged(words, "AIRBORNE")[: landed + steps(0.8)][steps(REST_S + 1.0) :].all(), "a second says so"
    assert not flagged(words, "AIRBORNE")[landed + steps(1.2) :].any()
    falls = raw.copy()
    falls[landed:, 3:] = 0
    falling = slice(landed + steps(0.3), landed + steps(2.0))
    assert flagged(flown(falls, thrust, 0.2), "AIRBORNE")[falling].all(), "nothing carries a fall"


def test_a_hover_as_still_as_a_stand_is_no_rest() -> None:
    """It yaws slowly and steadily: what rests takes such a rate for the gyro's bias."""
    raw, _, thrust = flight(0.0, 0.2, 20.0)
    begun = steps(REST_S + 2.0)
    raw[begun:, 2] = round(0.5 / UNIT_DPS)
    in_the_air, on_the_ground = flown(raw, thrust, 0.2), flown(raw, 0.0 * thrust, 0.2)
    assert flagged(on_the_ground, "REST")[-1] and not flagged(in_the_air, "REST")[begun:].any()
    bias_dps = [float(words["bias_turnps_q32_2"][-1]) * 360.0 / 2.0**32 for words in (in_the_air, on_the_ground)]
    # The hover yaws by 0.5 deg/s: nothing of it is learned aloft, nearly all of it (0.49) on a stand.
    assert abs(bias_dps[0]) < 0.05 and bias_dps[1] > 0.4
