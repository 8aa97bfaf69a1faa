"""What `attitude` does when sensors or motion leave what it is made for: a named flag, and a bound of the error.

The bodies here turn and move as prescribed, with an ideal sensor of 16 bits; native is equal to the other boards.
"""

from __future__ import annotations

import numpy as np
import pytest

from plumb.systems.attitude import reference
from support.prescribed_motion import (
    BLOCK_S,
    MISSING_COUNT,
    PERIOD_S,
    error_deg,
    felt,
    flagged,
    run,
    sigma_deg,
    steps,
    still,
    swing,
    tuning_of,
)


def test_a_gap_in_motion_is_flagged_and_its_end_bridges_it() -> None:
    rate = np.vstack([still(3.0)[0], swing(2.0, 200.0, 0.5), still(12.0)[0]])
    raw, up = felt(rate, np.zeros_like(rate))
    gap = slice(steps(4.0), steps(4.1))
    raw[gap] = MISSING_COUNT
    words = run(raw)
    error = error_deg(words, up)
    assert np.array_equal(np.flatnonzero(flagged(words, "MISSING")), np.arange(gap.start, gap.stop))
    unseen_deg = np.abs(rate[gap] - rate[gap.start - 1]).sum(axis=0).max() * PERIOD_S
    # A straight line through a gap is off by less than what nobody felt in it (0.74 of it; 1.5 doubles that).
    assert unseen_deg > 0.1 and error[gap].max() < 1.5 * unseen_deg
    # The second order of the swing is left: 0.12 of what was unseen.
    assert error[gap.stop] < 0.15 * unseen_deg, "a straight line, and the swing is curved by (pi / s)^2"
    sigma = sigma_deg(words)
    assert sigma[gap.stop + steps(3 * BLOCK_S)] > max(2.0 * sigma[gap.start], error[gap.stop])
    # Level again: 0.02 deg, five times below the tenth of a degree that the tables show.
    assert error[-1] < 0.1


def test_a_gap_that_would_end_with_a_block_ends_a_step_later() -> None:
    rate = np.vstack([still(3.0)[0], swing(2.0, 200.0, 0.5)])
    raw, up = felt(rate, np.zeros_like(rate))
    block = steps(BLOCK_S)
    last = 30 * block - 1  # the last step of a block
    raw[last - 3 : last] = MISSING_COUNT
    words = run(raw)
    assert words["block_step"][last] == 0, "the block ends there"
    assert np.array_equal(np.flatnonzero(flagged(words, "MISSING")), np.arange(last - 3, last + 1))
    assert words["missing_steps"][-1] == 4
    # 0.004 deg is reached, the rounding of the counts; 0.2 deg is a fifteenth of what a gap hides.
    assert error_deg(words, up)[last + 1 :].max() < 0.2


@pytest.mark.parametrize("share", [0.01, 0.02, 0.04])
def test_samples_lost_without_notice_raise_the_stated_deviation(share: float) -> None:
    """Three draws of a body that swings and turns. The stated deviation is 0.7 to 2 times the error."""
    turns = swing(60.0, 200.0, 0.5)
    turns[:, 2] = 140.0 * np.sin(2 * np.pi * 0.23 * PERIOD_S * np.arange(len(turns)))
    rate = np.vstack([still(3.0)[0], turns])
    raw, up = felt(rate, np.zeros_like(rate))
    rms_deg, stated_deg = [], []
    for seed in range(3):
        kept = np.random.default_rng(seed).random(len(raw)) >= share
        words, later = run(raw[kept]), slice(steps(13.0), None)
        rms_deg.append(np.sqrt(np.mean(error_deg(words, up[kept])[later] ** 2)))
        stated_deg.append(sigma_deg(words)[later].mean())
    # 0.87, 0.77 and 0.74 times are reached; the filter's own variance alone says 0.3 to 0.4 times.
    assert 0.7 * np.mean(rms_deg) < np.mean(stated_deg) < 2.0 * np.mean(rms_deg)


def test_a_block_of_fifteen_steps_is_measured_though_every_other_sample_is_missing() -> None:
    """Seven of its steps bridge a gap at most, and eight compute the covariance of a block in motion."""
    rate, moved = swing(12.0, 40.0, 0.7), still(12.0)[1]
    raw, _ = felt(rate, moved)
    half = raw.copy()
    half[1::2] = MISSING_COUNT
    whole_deg, half_deg = (sigma_deg(run(counts, period_us=8000))[-1] for counts in (raw, half))
    # 1.07 times: half of the samples are missing, and white noise alone would cost 2 ** 0.5.
    assert half_deg < 1.5 * whole_deg


def test_a_clipped_gyro_makes_the_tilt_unsure_and_rest_mends_it_within_ten_seconds() -> None:
    turn = np.zeros((steps(0.5), 3))
    turn[:, 0] = 800.0
    rate = np.vstack([still(3.0)[0], turn, still(12.0)[0]])
    raw, up = felt(rate, np.zeros_like(rate))
    words = run(raw, limit_dps=500.0)
    error, stop = error_deg(words, up), steps(3.5)
    assert flagged(words, "GYRO_CLIPPED")[steps(3.0) : stop].all()
    assert error[stop - 1] > 100.0, "the sensor cannot have felt 150 of the 400 degrees"
    assert flagged(words, "UNSURE")[stop : stop + steps(BLOCK_S)].any()
    # 2 deg is the promise for rest after a clipped turn; 0.4 is reached.
    assert error[stop + steps(10.0) :].max() < 2.0
    assert not flagged(words, "UNSURE")[-1]


def test_rates_alone_carry_the_tilt_and_say_that_it_becomes_unsure() -> None:
    """The accelerometer is lost for 20 s of motion: its channels are marked, those of the gyro go on."""
    rate = np.vstack([still(12.0)[0], swing(20.0, 60.0, 0.5), still(12.0)[0]])
    raw, up = felt(rate, np.zeros_like(rate))
    lost = slice(steps(12.0), steps(32.0))
    raw[lost, 3:] = MISSING_COUNT
    words = run(raw)
    error, sigma = error_deg(words, up), sigma_deg(words)
    assert not flagged(words, "MISSING").any() and flagged(words, "ACCEL_CLIPPED")[lost].all()
    # The ideal gyro errs by 0.05 deg; half a degree is what 90 deg/h do in 20 s.
    assert error[lost].max() < 0.5
    assert sigma[lost.stop - 1] > 2.0 * sigma[lost.start - 1]
    grows = sigma[lost][:: steps(4.0)]
    assert (np.diff(grows) > 0.05).all(), "by 0.1 deg in 4 s"
    assert error[-1] < 0.1 and sigma[-1] < 2.0 * sigma[lost.start - 1], "the accelerations are back"


def test_rates_alone_are_the_same_in_float64() -> None:
    rate = np.vstack([still(6.0)[0], swing(8.0, 60.0, 0.5), still(4.0)[0]])
    raw, _ = felt(rate, np.zeros_like(rate))
    raw[steps(6.0) : steps(12.0), 3:] = MISSING_COUNT
    raw[steps(7.0) : steps(7.1)] = MISSING_COUNT
    words, floats = run(raw), reference.run_control(tuning_of(), raw)
    up = np.stack([floats[f"up_{axis}"] for axis in "xyz"], 1)
    # Both round: 0.003 deg apart, and 0.036 of 0.84 deg in sigma, a covariance of 32 bits.
    assert error_deg(words, up).max() < 0.01
    assert np.abs(sigma_deg(words) - floats["tilt_sigma_deg"])[steps(1.0) :].max() < 0.05


def test_an_accelerometer_at_its_rail_is_not_used_after_two_blocks() -> None:
    """One axis stays at the end of its range for 8 s of motion, then moves again."""
    rate = np.vstack([still(6.0)[0], swing(8.0, 60.0, 0.5), still(6.0)[0]])
    raw, up = felt(rate, np.zeros_like(rate))
    held = slice(steps(6.0), steps(14.0))
    raw[held, 3] = 32767
    words, floats = run(raw), reference.run_control(tuning_of(), raw)
    error, sigma = error_deg(words, up), sigma_deg(words)
    assert flagged(words, "ACCEL_CLIPPED")[held].all() and not flagged(words, "ACCEL_CLIPPED")[held.stop :].any()
    # Used for 8 s, such an acceleration turns the estimate by 111 deg.
    assert error[held].max() < 0.1
    assert sigma[held.stop - 1] > 2.0 * sigma[held.start - 1], "it says that it becomes unsure"
    assert error[-1] < 0.2, "the accelerations are back"
    vertical = np.stack([floats[f"up_{axis}"] for axis in "xyz"], 1)
    assert error_deg(words, vertical).max() < 0.01


def test_before_the_first_acceleration_nothing_is_up() -> None:
    rate, moved = still(8.0)
    raw, up = felt(rate + 0.0, moved)
    raw[: steps(2.0), 3:] = MISSING_COUNT
    words = run(raw)
    assert words["up_q30_2"][steps(1.9)] == 1 << 30, "as at the start of a run"
    assert error_deg(words, up)[-1] < 0.1


def test_a_clipped_accelerometer_is_flagged_and_tilts_nothing() -> None:
    rate, moved = still(6.0)
    hit = slice(steps(3.0), steps(3.012))
    moved[hit, 0] = 30.0
    moved[hit.stop : hit.stop + steps(0.024), 0] = -15.0  # and it stops
    raw, up = felt(rate, moved)
    words = run(raw)
    assert flagged(words, "ACCEL_CLIPPED")[hit].all()
    assert error_deg(words, up).max() < 1.0, "the sensor missed 0.17 g s"


def test_a_fall_is_flagged_within_two_blocks_and_does_not_tilt_the_estimate() -> None:
    rate, moved = still(8.0)
    fall = slice(steps(4.0), steps(5.0))
    moved[fall, 2] = -1.0
    rate[fall] = swing(1.0, 90.0, 1.0)
    raw, up = felt(rate, moved)
    words = run(raw)
    assert flagged(words, "FALLING")[fall.start + steps(2 * BLOCK_S) : fall.stop].all()
    assert not flagged(words, "FALLING")[: fall.start].any()
    assert error_deg(words, up)[fall.start :].max() < 1.0


def test_a_run_that_begins_in_a_fall_waits_for_an_acceleration_before_it_says_what_is_up() -> None:
    rate, moved = still(4.0)
    moved[: steps(1.0), 2] = -1.0
    raw, up = felt(rate, moved)
    words = run(raw)
    assert flagged(words, "UNSURE")[: steps(1.0)].all()
    # Rest shows what is up: nothing but the steps of the counts is left.
    assert error_deg(words, up)[-1] < 0.1


def test_a_centrifuge_is_flagged_and_tilts_the_estimate_by_a_fraction_of_what_the_accelerometer_says() -> None:
    rate, moved = still(25.0)
    spin = slice(steps(5.0), steps(13.0))
    turned = 2 * np.pi * 0.25 * PERIOD_S * np.arange(spin.stop - spin.start)
    moved[spin] = 0.5 * np.stack([np.cos(turned), np.sin(turned), 0 * turned], 1)
    rate[spin, 2] = 90.0
    raw, up = felt(rate, moved)
    words = run(raw)
    error = error_deg(words, up)
    assert flagged(words, "ACCELERATING")[spin].any()
    assert error[spin].max() < 3.0, "the accelerometer alone is off by atan(0.5), 26.6 deg"
    # 0.08 deg: what the spin left is forgotten.
    assert error[-1] < 0.5


def test_a_start_on_a_sled_is_flagged_and_bounded() -> None:
    rate, moved = still(30.0)
    push = slice(steps(5.0), steps(8.0))
    moved[push, 0] = 0.2
    moved[push.stop : push.stop + steps(3.0), 0] = -0.2
    raw, up = felt(rate, moved)
    words = run(raw)
    assert flagged(words, "ACCELERATING")[push].any()
    error = error_deg(words, up)
    assert error.max() < 6.0, "the accelerometer alone is off by atan(0.2), 11.3 deg"
    assert error[-1] < 1.0


def test_a_body_at_rest_that_would_be_faster_than_25_mps_restarts_the_filter_which_keeps_counting() -> None:
    rate, moved = still(60.0)
    moved[steps(5.0) :, 0] = 0.3
    words = run(felt(rate, moved)[0])
    restarted = np.flatnonzero(flagged(words, "RESTARTED"))
    assert restarted.size and restarted[0] > steps(5.0 + 2.5 / 0.3)
    assert flagged(words, "ALIGNING")[restarted[0]]
    assert np.array_equal(words["step"], np.arange(1, len(words["step"]) + 1))


@pytest.mark.parametrize("seed", range(4))
def test_after_any_input_a_minute_of_rest_is_enough(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wild = rng.integers(-32768, 32768, (steps(10.0), 6)).astype(np.int16)
    rest, up = felt(*still(60.0))
    words = run(np.vstack([wild, rest]))
    size = np.sqrt(sum((words[f"attitude_{part}_q30"] / 2.0**30) ** 2 for part in "wxyz"))
    # 3e-4 is reached on wild counts; 1e-3 of length is 0.06 deg of a direction.
    assert np.abs(size - 1.0).max() < 1e-3
    assert error_deg(words, np.vstack([np.tile(up[0], (len(wild), 1)), up]))[-1] < 0.1
