"""Sensors at rest, injected for an hour: their noise never looks like a dead input. The C of link/injected.c alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from plumb.physics.sensors import ADC_NOISE_LSB, Adxl345, Enc03, Itg3205, Mma7260, adc_counts
from plumb.spec import parameters
from plumb.systems import shipped_tunings
from support import link_functions
from support.campaigns import LONG

SECONDS = 3600
FILTER_HZ = 5.0
"""Corner of the accelerometer's low-pass: the quietest that the design has."""
GYRO_NOISE_DPS = 0.5
SEEDS = range(10) if LONG else range(1)
Counts = npt.NDArray[np.int16]


def table(tuning: str, system: str, period_us: int) -> list[int]:
    values = {**shipped_tunings.table_of(system, tuning), "period_us": period_us}
    return [values[row.name] for row in parameters.table()]


def analog(steps: int, period_us: int, rng: np.random.Generator) -> Counts:
    """ENC-03, and MMA7260 behind its low-pass; the noise of the converter on each."""
    accelerometer, gyro = Mma7260(FILTER_HZ), Enc03()
    decay = np.exp(-2.0 * np.pi * FILTER_HZ * period_us * 1e-6)
    kernel = decay ** np.arange(1 + int(40.0 / -np.log(decay))) * np.sqrt(1.0 - decay**2)
    white = rng.standard_normal((2, steps))
    filtered = np.stack([np.convolve(row, kernel)[:steps] for row in white]) * accelerometer.noise_g
    volts = [gyro.volts(GYRO_NOISE_DPS * rng.standard_normal(steps))]
    volts += [accelerometer.volts(level + noise) for level, noise in zip((0.0, 1.0), filtered, strict=True)]
    noise_v = ADC_NOISE_LSB * 3.3 / 4096 * rng.standard_normal((3, steps))
    counts = np.zeros((steps, 6), np.int16)
    counts[:, :3] = np.stack([adc_counts(volt + noise) for volt, noise in zip(volts, noise_v, strict=True)], axis=-1)
    return counts


def digital(steps: int, period_us: int, rng: np.random.Generator) -> Counts:
    """ITG-3205 and ADXL345 upright."""
    accelerometer, gyro = Adxl345(), Itg3205()
    counts = np.zeros((steps, 6), np.int16)
    counts[:, 0] = gyro.counts(GYRO_NOISE_DPS * rng.standard_normal(steps))
    for channel, level_g, noise_lsb in ((1, 0.0, accelerometer.noise_lsb[0]), (2, 1.0, accelerometer.noise_lsb[1])):
        counts[:, channel] = accelerometer.counts(
            level_g + accelerometer.g_per_lsb * noise_lsb * rng.standard_normal(steps)
        )
    return counts


CASES = [("quad", "hold", analog), ("balancer", "tuned", digital)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("period_us", [5000, 20_000])
@pytest.mark.parametrize(("system", "tuning", "made"), CASES, ids=["analog", "digital"])
def test_an_hour_at_rest_disarms_nothing(system: str, tuning: str, made: object, period_us: int, seed: int) -> None:
    assert callable(made)
    counts = made(SECONDS * 1_000_000 // period_us, period_us, np.random.default_rng(seed))
    assert link_functions.first_doubt(table(tuning, system, period_us), counts) == 0


@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize(("system", "tuning", "made"), CASES, ids=["analog", "digital"])
def test_one_dead_channel_is_detected_among_noisy_ones(system: str, tuning: str, made: object, channel: int) -> None:
    assert callable(made)
    counts = made(2000, 5000, np.random.default_rng(3))
    counts[1000:, channel] = counts[1000, channel]
    found = link_functions.first_doubt(table(tuning, system, 5000), counts)
    assert 1000 < found <= 1000 + 100  # within 500 ms
