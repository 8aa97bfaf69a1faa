"""What every compared algorithm gets, how its error is measured, and which errors a sensor of another grade adds."""

from __future__ import annotations

import csv
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb.analyses.comparison import grades
from plumb.analyses.comparison.contenders import contenders
from plumb.analyses.comparison.grades import GRADES
from plumb.analyses.comparison.samples import (
    SIXTEEN_BITS,
    Motion,
    error_deg,
    motion_of,
    sampled,
    vertical_of,
)
from plumb.analyses.comparison.table import compare, of_recordings, row_of
from plumb.errors import UsageError
from plumb.readers import recording

FloatArray = npt.NDArray[np.float64]
HZ = 100.0


def swing(seconds: float = 20.0, hz: float = HZ) -> Motion:
    """Tilting by 30 deg about x, twice in five seconds, without translation."""
    time_s = np.arange(int(seconds * hz)) / hz
    tilt = np.radians(30.0) * np.sin(2.0 * np.pi * 0.4 * time_s)
    zero = np.zeros_like(tilt)
    up = np.column_stack([zero, np.sin(tilt), np.cos(tilt)])
    # A sample of the gyro is the mean rate of the interval that it ends.
    rate_dps = np.degrees(np.diff(tilt, prepend=tilt[0])) * hz
    rates = np.column_stack([rate_dps, zero, zero])
    return Motion("swing", 1.0 / hz, rates, up, up, time_s >= 2.0)


def test_the_error_is_the_angle_between_verticals_and_heading_does_not_count() -> None:
    up = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    tilted = np.array([[0.0, np.sin(0.01), np.cos(0.01)], [0.0, 0.0, 9.81]])
    assert error_deg(tilted, up) == pytest.approx([np.degrees(0.01), 0.0], abs=1e-9)
    quat = np.array([[np.cos(0.2), np.sin(0.2), 0.0, 0.0]])
    heading = np.array([[np.cos(0.7), 0.0, 0.0, np.sin(0.7)]])
    (a, _, _, b), (c, d, _, _) = heading[0], quat[0]
    turned = np.array([[a * c, a * d, b * d, b * c]])  # heading * quat
    assert error_deg(vertical_of(turned), vertical_of(quat)) == pytest.approx([0.0], abs=1e-6)


def test_counts_have_16_bits_at_2000_deg_per_s_and_16_g() -> None:
    motion = swing()
    motion = replace(motion, gyr_dps=motion.gyr_dps * 0.0 + [1000.0, -500.0, 2500.0], acc_g=motion.acc_g * 0.0 + 8.0)
    samples = sampled(motion, SIXTEEN_BITS, 1)
    assert samples.counts[0].tolist() == [16384, -8192, 32767, 16384, 16384, 16384]
    assert samples.gyr_radps[0] == pytest.approx(np.radians([1000.0, -500.0, 2000.0]), rel=1e-4)
    assert samples.acc_mps2[0] == pytest.approx([8.0 * recording.G_MPS2] * 3)
    assert samples.period_us == 10_000


def test_a_lower_rate_has_the_mean_of_each_block_and_the_reference_of_its_end() -> None:
    assert recording.block_means(np.arange(14.0).reshape(7, 2), 3).tolist() == [[2.0, 3.0], [8.0, 9.0]]
    motion = swing()
    samples = sampled(motion, SIXTEEN_BITS, 6)
    assert len(samples.counts) == len(motion.gyr_dps) // 6 and samples.period_us == 60_000
    assert samples.up[10] == pytest.approx(motion.up[65])
    assert samples.scored.tolist() == motion.movement[5::6][: len(samples.scored)].tolist()


def added(name: str, seed: int, motion: Motion) -> FloatArray:
    return np.asarray(GRADES[name].of(motion, seed).gyr_dps - motion.gyr_dps, np.float64)


def felt(name: str, motion: Motion, seed: int) -> FloatArray:
    worse = GRADES[name].of(motion, seed)
    return np.hstack([worse.gyr_dps, worse.acc_g])


def test_a_grade_adds_what_its_title_says() -> None:
    motion = swing(200.0)
    assert np.unique(np.abs(added("bias", 1, motion)).round(9)).tolist() == [4.0]
    warm = np.abs(added("warm-up", 1, motion))
    assert np.all(warm[0] == 0.0) and warm[3000] == pytest.approx([1.0 - np.exp(-1.0)] * 3)
    assert np.std(added("noise", 1, motion)) == pytest.approx(0.1 * np.sqrt(HZ / 2.0), rel=0.02)
    fast = replace(motion, gyr_dps=np.tile([100.0, 0.0, 0.0], (len(motion.gyr_dps), 1)))
    columns = [added("matrix", seed, fast)[0] for seed in range(400)]
    assert np.std(columns) == pytest.approx(1.0, rel=0.1)  # deg/s of 100, each entry 1 % rms
    felt = [added("g-sensitivity", seed, motion)[0] for seed in range(400)]
    assert np.std(felt) == pytest.approx(0.1, rel=0.1)  # deg/s at 1 g
    cheap = [GRADES["mpu6050"].of(fast, seed) for seed in range(400)]
    at_rest = [one.gyr_dps[0] - fast.gyr_dps[0] for one in cheap]
    assert np.std(at_rest, axis=0) == pytest.approx(
        [np.hypot(1.0, 1.0), np.hypot(1.0, 0.7), np.hypot(1.0, 0.7)], rel=0.12
    )
    noise_g = np.std(cheap[0].acc_g - fast.acc_g)
    # A standard deviation over thousands of samples scatters by one percent; five times that.
    assert noise_g == pytest.approx(400e-6 * np.sqrt(HZ / 2.0), rel=0.05)


def test_a_seed_and_a_recording_are_a_sensor_and_the_recording_stays_as_it_was() -> None:
    motion = swing()
    before = motion.gyr_dps.copy()
    drawn = {name for name, grade in GRADES.items() if grade.degrade and grade.draws}
    assert {"matrix", "mpu6050", "accel-errors", "mpu6050-whole"} < drawn
    for name in drawn:
        assert np.array_equal(felt(name, motion, 1), felt(name, motion, 1))
        assert not np.array_equal(felt(name, motion, 1), felt(name, motion, 2)), name
        assert not np.array_equal(felt(name, motion, 1), felt(name, replace(motion, name="another recording"), 1)), name
        assert GRADES[name].seeds == (1, 2)
    assert np.array_equal(motion.gyr_dps, before) and GRADES[grades.AS_RECORDED].of(motion, 0) is motion


def test_the_accelerometer_of_a_grade_has_offset_scale_and_misalignment() -> None:
    motion = swing(1.0)
    falling = replace(motion, acc_g=0.0 * motion.acc_g)
    level = replace(motion, acc_g=np.tile([0.0, 0.0, 1.0], (len(motion.acc_g), 1)))
    offsets = np.array([GRADES["accel-errors"].of(falling, seed).acc_g[0] for seed in range(400)])
    assert np.linalg.norm(offsets, axis=1) == pytest.approx(np.full(400, 0.03))
    at_1g = np.array([GRADES["accel-errors"].of(level, seed).acc_g[0] for seed in range(400)]) - offsets - [0, 0, 1]
    # A standard deviation over 400 seeds scatters by (2 * 400) ** -0.5, 3.5 %: three times that and a half.
    assert np.std(at_1g, axis=0) == pytest.approx([0.005, 0.005, 0.02], rel=0.12)
    assert np.array_equal(GRADES["accel-errors"].of(level, 1).gyr_dps, level.gyr_dps)
    assert GRADES["gravity-low"].of(level, 0).acc_g[0] == pytest.approx([0.0, 0.0, 0.97])


def test_declared_missing_samples_are_held_and_marked() -> None:
    motion = swing(200.0)
    for name, share in (("missing-0.1", 0.001), ("missing-1", 0.01), ("missing-10", 0.1)):
        assert GRADES[name].seeds == (1, 2, 3)
        (samples,) = GRADES[name].samples(motion, 1, 1)
        # At a share of 0.1 % some twenty samples are missing: they scatter by a fifth, and 2.5 times that is allowed.
        assert np.mean(samples.missing) == pytest.approx(share, rel=0.5) and not samples.missing[0]
        lost = np.flatnonzero(samples.missing)
        assert np.array_equal(samples.counts[lost], samples.counts[lost - 1])
        assert np.all(samples.marked[lost] == -32768)
        kept = ~samples.missing
        assert np.array_equal(samples.marked[kept], sampled(motion, SIXTEEN_BITS, 1).counts[kept])
    (third,) = GRADES["missing-10"].samples(motion, 1, 3)  # samples are lost at the rate at which they are taken
    # Some hundreds are missing: they scatter by less than a tenth, and twice that is allowed.
    assert np.mean(third.missing) == pytest.approx(0.1, rel=0.2) and len(third.missing) == len(motion.gyr_dps) // 3


def test_gaps_take_100_ms_out_of_every_10_s() -> None:
    motion = swing(200.0)
    (samples,), (other,) = (GRADES["gaps"].samples(motion, seed, 1) for seed in (1, 2))
    begins = np.flatnonzero(np.diff(samples.missing.astype(int)) == 1)
    assert np.unique(np.diff(begins)).tolist() == [1000] and np.sum(samples.missing) in (199, 200)
    assert not np.array_equal(samples.missing, other.missing)


def test_samples_lost_without_notice_leave_no_trace() -> None:
    motion = swing(200.0)
    (samples,), whole = GRADES["lost-2"].samples(motion, 1, 1), sampled(motion, SIXTEEN_BITS, 1)
    assert len(samples.counts) == pytest.approx(0.98 * len(whole.counts), rel=0.005)
    assert not samples.missing.any() and len(samples.up) == len(samples.counts) == len(samples.scored)
    assert samples.period_us == whole.period_us


def test_clipped_counts_are_one_beyond_the_range_of_the_sensor() -> None:
    motion = swing()
    motion = replace(motion, gyr_dps=0.0 * motion.gyr_dps + [300.0, -700.0, 100.0], acc_g=0.0 * motion.acc_g + 5.0)
    for name, counts in (("clip-250", [32767, -32767]), ("clip-500", [19660, -32767])):
        (samples,) = GRADES[name].samples(motion, 0, 1)
        assert samples.counts[0, :2].tolist() == counts and samples.sensor.gyro.max_counts == 32766
        assert np.degrees(samples.gyr_radps[0, 2]) == pytest.approx(100.0, abs=0.01)
    (samples,) = GRADES["accel-4g"].samples(motion, 0, 1)
    assert samples.counts[0, 3:].tolist() == [32767] * 3
    assert np.degrees(samples.gyr_radps[0]) == pytest.approx([300.0, -700.0, 100.0], abs=0.05)


def test_starts_inside_a_motion_are_scored_from_2_to_10_s_and_after() -> None:
    motion = swing(62.0)
    soon = GRADES["moving-start"].samples(motion, 0, 1)
    assert len(soon) == 6 and soon[1].up[0] == pytest.approx(motion.up[1200])
    assert [np.flatnonzero(one.scored)[[0, -1]].tolist() for one in soon] == [[200, 999]] * 6
    later = GRADES["moving-start-later"].samples(motion, 0, 1)
    assert [int(np.sum(one.scored)) for one in later] == [3000, 3000, 3000, 2000, 1000]


def test_sigma_is_shown_with_the_error() -> None:
    row = row_of("one", "swing", 0, np.array([1.0, 1.0, 4.0, 2.0]), np.array([1.0, 0.5, 1.0, 1.5]))
    assert (row.sigma_deg, row.beyond_3_sigma) == (1.0, 0.25)
    assert row_of("one", "swing", 0, np.ones(4), None).sigma_deg is None


def test_an_input_says_which_algorithm_cannot_learn_its_bias() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    algorithms = contenders()
    assert not of_recordings([swing()], grades.AS_RECORDED, 1).outside(algorithms)
    outside = of_recordings([swing()], "bias", 1).outside(algorithms)
    assert list(outside) == ["VQF", "BasicVQF", "Madgwick"]
    assert outside["VQF"] == "VQF has a limit of 2 deg/s of the gyro's bias, which is 4 deg/s an axis"
    assert "VQF" not in of_recordings([swing()], "mpu6050", 1).outside(algorithms)
    with pytest.raises(UsageError, match=r"^there is no algorithm 'AHRS' to compare; there are VQF, BasicVQF, "):
        contenders(["AHRS"])


def test_two_chips_have_their_own_resolution() -> None:
    samples = sampled(swing(), GRADES["adxl345-itg3205"].sensor, 1)
    assert samples.counts[0].tolist() == [0, 0, 0, 0, 0, 256]
    assert np.max(samples.counts[:, 0]) == round(14.375 * np.max(swing().gyr_dps))


def test_every_algorithm_follows_a_slow_swing() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    algorithms = contenders()
    calls = []
    (result,) = compare([of_recordings([swing(60.0)], grades.AS_RECORDED, 1)], algorithms, lambda: calls.append(1))
    assert [row.algorithm for row in result.rows] == [one.name for one in algorithms]
    assert [one.name for one in algorithms][:4] == ["VQF", "BasicVQF", "Madgwick", "Mahony"]
    assert len(calls) == len(algorithms)
    for row in result.rows:
        assert 0.0 < row.rmse_deg < 1.0 and row.rmse_deg < row.p95_deg <= row.max_deg < 2.0, row


def test_stamps_that_stray_are_resampled_to_their_period(tmp_path: Path) -> None:
    motion = swing()
    time_s = motion.time_s + np.random.default_rng(3).uniform(-0.002, 0.002, len(motion.time_s))
    half = 0.5 * np.arctan2(motion.up[:, 1], motion.up[:, 2])
    zero = np.zeros_like(half)
    loaded = recording.Recording(
        tmp_path / "jitter.npz", time_s - time_s[0], motion.gyr_dps, motion.acc_g,
        np.column_stack([np.cos(half), np.sin(half), zero, zero]), motion.movement,
    )  # fmt: skip
    even = motion_of(loaded)
    assert even.period_s == pytest.approx(0.01, rel=0.02) and len(even.up) == len(even.gyr_dps)
    there = [np.interp(even.time_s, loaded.time_s, column) for column in motion.up.T]
    assert np.max(error_deg(even.up, np.column_stack(there))) < 0.1
    with pytest.raises(UsageError, match=r"^jitter.npz has no reference"):
        motion_of(replace(loaded, ref_quat=None))
    with pytest.raises(UsageError, match=r"^jitter.npz has no sample that is marked"):
        motion_of(replace(loaded, movement=np.zeros(len(time_s), np.bool_)))


@pytest.mark.slow
def test_published_errors_are_those_of_an_independent_evaluation() -> None:
    """Same packages, same versions, same defaults; only the rounding to counts is new."""
    folder = os.environ.get("PLUMB_DATA")
    if not folder:
        pytest.skip("PLUMB_DATA does not name a folder with recordings")
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    name = "broad_02_undisturbed_slow_rotation_B"
    with (Path(folder) / "baselines.csv").open(newline="") as file:
        known = {
            row["algorithm"].split()[0]: float(row["inclination_rmse_deg"])
            for row in csv.DictReader(file)
            if f"broad_{row['trial']}" == name and row["parameters"].startswith("default")
        }
    motion = motion_of(recording.load(Path(folder) / f"{name}.npz"))
    published = contenders(["VQF", "BasicVQF", "Madgwick", "Mahony"])
    (result,) = compare([of_recordings([motion], grades.AS_RECORDED, 1)], published, lambda: None)
    for row in result.rows:
        # Half of the last digit that the evaluation prints.
        assert row.rmse_deg == pytest.approx(known[row.algorithm], abs=0.005), row
