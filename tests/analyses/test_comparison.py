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
from plumb.analyses.comparison.table import Input, compare
from plumb.errors import UsageError
from plumb.inputs import recording

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
    assert noise_g == pytest.approx(400e-6 * np.sqrt(HZ / 2.0), rel=0.05)


def test_a_seed_and_a_recording_are_a_sensor_and_the_recording_stays_as_it_was() -> None:
    motion = swing()
    before = motion.gyr_dps.copy()
    for name in set(GRADES) - {grades.AS_RECORDED, "adxl345-itg3205"}:
        assert np.array_equal(GRADES[name].of(motion, 1).gyr_dps, GRADES[name].of(motion, 1).gyr_dps)
        assert not np.array_equal(GRADES[name].of(motion, 1).gyr_dps, GRADES[name].of(motion, 2).gyr_dps), name
        other = replace(motion, name="another recording")
        assert not np.array_equal(GRADES[name].of(motion, 1).gyr_dps, GRADES[name].of(other, 1).gyr_dps), name
        assert GRADES[name].seeds == (1, 2)
    assert np.array_equal(motion.gyr_dps, before) and GRADES[grades.AS_RECORDED].of(motion, 0) is motion


def test_two_chips_have_their_own_resolution() -> None:
    samples = sampled(swing(), GRADES["adxl345-itg3205"].sensor, 1)
    assert samples.counts[0].tolist() == [0, 0, 0, 0, 0, 256]
    assert np.max(samples.counts[:, 0]) == round(14.375 * np.max(swing().gyr_dps))


def test_every_algorithm_follows_a_slow_swing() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    algorithms = contenders()
    calls = []
    (result,) = compare([swing(60.0)], [Input(1, grades.AS_RECORDED)], algorithms, lambda: calls.append(1))
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
    published = [one for one in contenders() if one.name in ("VQF", "BasicVQF", "Madgwick", "Mahony")]
    (result,) = compare([motion], [Input(1, grades.AS_RECORDED)], published, lambda: None)
    for row in result.rows:
        assert row.rmse_deg == pytest.approx(known[row.algorithm], abs=0.005), row
