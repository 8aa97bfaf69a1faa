"""The quad scenarios are the published ones: only then do their figures mean anything.

Float64 throughout; seeds 1000-1039, as every reported figure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.kernels.reference import kernels as reference_kernels
from plumb.proof import metrics
from plumb.spec.tuning import Kalman
from plumb.systems import load, scoring
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.drawn_run import Scenario, on_grid
from plumb.systems.quad.lateral import GRID_S
from plumb.systems.quad.plant import QuadPlant
from plumb.systems.quad.tuning import QuadTuning

SEEDS = range(1000, 1040)


@pytest.fixture(scope="module")
def runs() -> list[Scenario]:
    return [quad.scenario("motion", seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def engineering(runs: list[Scenario]) -> np.ndarray:
    """Rate in deg/s, y and z in g: (3, steps, runs)."""
    raw = np.stack([run.counts() for run in runs], axis=-1).astype(float)
    channels = (quad.CALIBRATION.gyro, quad.CALIBRATION.accel, quad.CALIBRATION.accel_up)
    return np.stack([(raw[:, i] - c.zero_counts) * c.unit_per_count for i, c in enumerate(channels)])


def rmse_deg(runs: list[Scenario], engineering: np.ndarray, tuning: QuadTuning) -> float:
    """Mean over runs of the float64 filter's error, a constant R."""
    rate_dps, y_g, z_g = engineering
    z_deg = np.degrees(np.arctan2(y_g, z_g) if tuning.tilt == "atan2" else np.arcsin(np.clip(y_g, -1, 1)))
    state = reference_kernels.kalman_init(tuning.start)
    estimate = np.empty_like(z_deg)
    for k in range(len(z_deg)):
        reference_kernels.kalman_step(state, tuning.kalman, tuning.period_s, z_deg[k], rate_dps[k], tuning.trust.r_deg2)
        estimate[k] = state.tilt_deg
    truth = np.stack([run.tilt_deg() for run in runs], axis=-1)
    return float(np.mean(metrics.angle_rmse_deg(estimate, truth, scoring.scored(runs[0].time_s))))


@pytest.mark.slow
def test_accelerometer_only_is_within_5_percent_of_2_40_deg(runs: list[Scenario], engineering: np.ndarray) -> None:
    truth = np.stack([run.tilt_deg() for run in runs], axis=-1)
    figures = metrics.accel_only_rmse_deg(engineering[1], engineering[2], truth, scoring.scored(runs[0].time_s))
    assert float(np.mean(figures)) == pytest.approx(2.40, rel=0.05)


def test_the_papers_q_gives_1_87_deg_per_step_and_1_3_per_second(runs: list[Scenario], engineering: np.ndarray) -> None:
    paper = quad.TUNINGS["paper"]
    assert paper.kalman.q_angle_deg2_per_s * paper.period_s == pytest.approx(0.01, rel=1e-12)
    assert paper.kalman.q_bias_dps2_per_s * paper.period_s == pytest.approx(0.005, rel=1e-12)
    assert rmse_deg(runs, engineering, paper) == pytest.approx(1.87, rel=0.05)
    per_second = replace(paper, kalman=Kalman(0.01, 0.005))
    assert rmse_deg(runs, engineering, per_second) == pytest.approx(1.3, rel=0.05)


def test_motion_has_the_published_amplitudes(runs: list[Scenario]) -> None:
    tilt_deg = runs[0].tilt_deg()
    assert np.array_equal(tilt_deg, runs[1].tilt_deg()), "the motion is prescribed, the same for every seed"
    assert np.max(np.abs(tilt_deg[runs[0].time_s < 4.5])) < 1e-5, "at rest first"
    # 15 + 8 + 10 deg is 33; the smoothing takes a little off, and the three seldom add up whole.
    assert 28.0 < np.max(np.abs(tilt_deg)) < 33.0
    bias = np.stack([run.bias_dps for run in runs])
    # U(-2, 2) over the seeds, and the first step of the walk.
    assert np.max(np.abs(bias[:, 0])) <= 2.01 and np.max(np.abs(bias[:, 0])) > 1.5
    late = np.abs(bias[:, -1] - bias[:, 0])
    assert late.mean() == pytest.approx(3.0 * (1.0 - np.exp(-1.2)), abs=0.03)
    lateral = np.stack([run.lateral_g for run in runs])
    # One burst is 0.3 g, two that meet are 0.6; the vibration of 0.03 g rms adds five times that at most.
    assert 0.25 < np.max(np.abs(lateral)) < 0.75


def test_the_motion_is_smoothed_by_0_12_s(runs: list[Scenario]) -> None:
    # A Gaussian of sigma s passes a sine of f Hz with exp(-(2 pi f s)^2 / 2); whole periods of all three parts.
    t, tilt_deg = runs[0].time_s[350:5650], runs[0].tilt_deg()[350:5650]
    for f, amplitude in ((0.25, 15.0), (0.7, 8.0)):
        seen = 2.0 * abs(np.mean(tilt_deg * np.exp(-2j * np.pi * f * t)))
        assert seen == pytest.approx(amplitude * np.exp(-0.5 * (2.0 * np.pi * f * 0.12) ** 2), rel=0.03)


def test_the_sensors_err_as_stated(runs: list[Scenario], engineering: np.ndarray) -> None:
    rest, lsb_dps, lsb_g = slice(0, 200), 1.2024, 1.00708e-3
    at_rest = np.std(engineering[:, rest], axis=1).mean(axis=1)
    # ADC: 0.7 LSB before rounding, and rounding.
    assert at_rest[0] == pytest.approx(np.sqrt(0.5**2 + (0.49 + 1 / 12) * lsb_dps**2), rel=0.02)
    assert at_rest[1:] == pytest.approx(np.sqrt(8.2e-3**2 + (0.49 + 1 / 12) * lsb_g**2), rel=0.02)
    offsets_g = np.mean(engineering[1:, rest], axis=1) - np.array([[0.0], [1.0]])
    assert float(np.sqrt(np.mean(offsets_g**2))) == pytest.approx(3e-3, rel=0.25)
    rate = np.stack([run.rate_dps() for run in runs], axis=-1)
    bias = np.stack([run.bias_dps for run in runs], axis=-1)
    slope = np.sum((engineering[0] - bias) * rate, axis=0) / np.sum(rate * rate, axis=0)
    assert slope == pytest.approx(np.array([run.scale for run in runs]), abs=3e-3)
    # 1 % of scale error, drawn for each seed.
    assert 0.007 < float(np.sqrt(np.mean((slope - 1.0) ** 2))) < 0.014


def test_quiet_is_motion_without_lateral_acceleration() -> None:
    motion, quiet = quad.scenario("motion", 7), quad.scenario("quiet", 7)
    assert np.array_equal(motion.tilt_deg(), quiet.tilt_deg()) and np.array_equal(motion.bias_dps, quiet.bias_dps)
    assert np.array_equal(motion.gyro_noise_dps, quiet.gyro_noise_dps)
    assert not np.any(quiet.lateral_g) and np.any(motion.lateral_g)


@pytest.mark.parametrize("name", list(quad.SCENARIOS))
def test_a_seed_is_a_run_and_another_seed_another(name: str) -> None:
    one, again, other = (quad.scenario(name, seed).counts() for seed in (11, 11, 12))
    assert np.array_equal(one, again) and not np.array_equal(one, other)
    assert one.dtype == np.int16 and one[:, :3].min() > 0 and one[:, :3].max() < 4095 and not np.any(one[:, 3:])


@pytest.mark.parametrize(("name", "period_us"), [("motion", 20_000), ("disturb", 20_000), ("hold", 5_000)])
def test_open_loop_counts_do_not_depend_on_how_often_the_plant_is_read(name: str, period_us: int) -> None:
    run = quad.scenario(name, 3, seconds=20.0, period_us=period_us, bandwidth_hz=50.0)
    plant, counts, truth = QuadPlant(run, open_loop=True), run.counts(), run.tilt_deg()
    for k, time_s in enumerate(run.time_s):
        plant.advance_to(time_s - 0.001, (1900.0, 1100.0))
        plant.volts(time_s - 0.001)
        plant.advance_to(time_s, (1900.0, 1100.0))
        assert plant.counts(time_s) == plant.counts(time_s) == tuple(counts[k].tolist())
        assert plant.tilt_deg == pytest.approx(truth[k], abs=1e-9)


def test_the_hand_lets_go_and_the_motors_turn_the_axis() -> None:
    run = quad.scenario("hold", 4)
    up, down, off = (QuadPlant(run) for _ in range(3))
    for time_s in (2.9, 3.0, 3.3):
        up.advance_to(time_s, (1700.0, 1300.0))
        down.advance_to(time_s, (1300.0, 1700.0))
        off.advance_to(time_s, (0.0, 0.0))
        if time_s < 3.0:
            assert up.tilt_deg == down.tilt_deg == 0.0
    # The hand lets go at rest: whatever is beyond 10 deg is the motors' work.
    assert up.tilt_deg > 10.0 and down.tilt_deg < -10.0 and abs(off.tilt_deg) < 10.0
    assert up.speed[0] == pytest.approx(0.7, abs=0.01) and off.speed == (0.0, 0.0)
    up.advance_to(10.55 + quad.hold_later_s(4), (1700.0, 1300.0))
    assert up.tilt_deg == pytest.approx(20.0), "pulled to 20 deg by hand whatever the motors do"
    up.advance_to(15.0, (2000.0, 1000.0))
    assert up.tilt_deg == 60.0, "the stop"


def test_the_hand_pulls_at_a_time_that_the_seed_draws() -> None:
    later_s = [quad.hold_later_s(seed) for seed in range(40)]
    assert min(later_s) >= 0.0 and 0.8 * quad.HOLD_LATER_S < max(later_s) < quad.HOLD_LATER_S
    for seed in (0, 1):
        run = quad.scenario("hold", seed)
        held = np.flatnonzero(run.hand)[-1] * GRID_S
        assert held == pytest.approx(quad.HOLD_RELEASE_S + later_s[seed], abs=2.0 * GRID_S)


def test_the_hand_waits_for_the_motors() -> None:
    """A board that is armed after 3 s finds the axis level, and has it from then on."""
    axis = QuadPlant(quad.scenario("quiet", 4))
    axis.advance_to(6.0, (1000.0, 1000.0))
    held_deg = axis.tilt_deg
    assert held_deg == pytest.approx(on_grid(axis.scenario.prescribed_deg, 6.0))
    axis.advance_to(6.3, (1700.0, 1300.0))
    assert axis.tilt_deg > held_deg + 10.0


def test_setpoints_are_binary_angles() -> None:
    motion = quad.scenario("motion", 1)
    turns = motion.setpoint() / 2.0**32
    assert turns.max() < 0.1 and np.max(np.abs(turns * 360.0 - motion.tilt_deg())) < 1e-6
    plant = QuadPlant(motion)
    assert plant.setpoint(20.0) == motion.setpoint()[1000]
    assert not np.any(quad.scenario("hold", 1).setpoint())


def test_wrong_names_and_lengths_are_refused() -> None:
    with pytest.raises(UsageError, match="motion"):
        quad.scenario("waltz", 1)
    with pytest.raises(UsageError, match="3600 s"):
        quad.scenario("motion", 1, seconds=0.1)
    with pytest.raises(UsageError, match="0 or more"):
        quad.scenario("motion", -1)
    with pytest.raises(UsageError, match="quad"):
        load("submarine")
    assert vars(load("quad")) is vars(quad)
