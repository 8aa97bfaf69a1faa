"""Good recordings of an IMU, drawn from a number: motion, mount, chip, rate, length, stamps and reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison import motions
from plumb.audit.samples import Samples
from plumb.physics import rotation
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude import motion

NUMBERS = range(100)
UP_G = np.array([[0.0], [0.0], [1.0]])
DRIVEN = ("arm-170", "dash-5", "dash-20", "roundabout-15", "roundabout-40", "bank-turn", "merry-go-round",
          "vibration-100", "vibration-300", "bias-step")  # fmt: skip
RATES_HZ = (25.0, 50.0, 62.5, 100.0, 104.0, 119.0, 200.0, 238.0, 333.0, 400.0, 500.0, 952.0, 1000.0)


@dataclass(frozen=True)
class Chip:
    """bits of a count; densities of the noise, deg/s/sqrt(Hz) and g/sqrt(Hz); deviations of bias (deg/s), offset (g),
    scale and cross-axis sensitivity, as its data sheet or a user's has them; its ranges."""

    bits: int
    gyro_noise: float
    accel_noise: float
    bias_dps: float
    offset_g: float
    scale: float
    across: float
    ranges_dps: tuple[float, ...] = (250.0, 500.0, 1000.0, 2000.0)
    ranges_g: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)


CHIPS = {
    "a module of 2 euros": Chip(16, 0.008, 400e-6, 3.0, 0.025, 0.012, 0.01),
    "a phone": Chip(16, 0.007, 180e-6, 0.5, 0.02, 0.005, 0.005),
    "a chip of a drone": Chip(16, 0.003, 70e-6, 0.3, 0.01, 0.005, 0.004),
    "ten bits and another gyro": Chip(12, 0.03, 900e-6, 1.0, 0.012, 0.01, 0.01, (2000.0,), (16.0,)),
    "an instrument": Chip(24, 0.0005, 20e-6, 0.01, 0.001, 2e-4, 2e-4, (450.0, 2000.0), (5.0, 20.0)),
}


def drawn(number: int) -> tuple[str, Samples]:
    """What it is, and the recording."""
    rng = np.random.default_rng([73, number])
    kind = str(rng.choice([*motion.MOTIONS, *DRIVEN]))
    chip = str(rng.choice([*CHIPS]))
    rate_hz = float(rng.choice(RATES_HZ))
    q, felt_g, grid_s = _course(kind, rng)
    mount = rotation.quaternions((rng.standard_normal(3) * rng.choice([0.02, 0.2, 1.5]))[:, None])
    q = rotation.product(q, np.broadcast_to(mount, q.shape))
    felt_g = rotation.to_body(np.broadcast_to(mount, q.shape), felt_g)
    rate_dps = np.asarray(np.degrees(rotation.rates_radps(q, grid_s)), np.float64)
    at = _instants(q.shape[1], rate_hz * grid_s, rng)
    width = max(1, round(1.0 / rate_hz / grid_s))
    gyr, acc = (_sensed(values, at, width) for values in (rate_dps, felt_g))
    gyr, acc = _as_chip(CHIPS[chip], gyr, acc, rate_hz, rng)
    time_s = np.asarray((at - at[0]) * grid_s, np.float64)
    stamps = str(rng.choice(["exact", "jitter", "ms"]))
    if stamps == "jitter":
        time_s = time_s + np.clip(0.05 * rng.standard_normal(len(at)), -0.3, 0.3) / rate_hz
    elif stamps == "ms" and rate_hz <= 500.0:
        time_s = np.round(time_s, 3)
    reference = None
    if rng.random() < 0.5:
        error = np.radians(rng.choice([0.1, 1.0])) * rng.standard_normal((3, 1)) * np.ones((1, len(at)))
        reference = rotation.product(q[:, at], rotation.quaternions(error)).T.copy()
    about = f"{kind}, {chip}, {rate_hz:g} Hz, {time_s[-1]:.0f} s, stamps {stamps}"
    return about + (", reference" if reference is not None else ""), Samples(time_s, gyr, acc, reference)


def _course(kind: str, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, float]:
    """Attitudes (4, points), specific force in body axes (3, points) in g, and the step between them."""
    if kind in motion.MOTIONS:
        points = round(float(rng.uniform(12.0, 90.0)) / motion.GRID_S) + 1
        time_s = np.asarray(np.arange(points) * motion.GRID_S, np.float64)
        turn, accel_g = motion.MOTIONS[kind](time_s, rng.standard_normal((6, points)))
        q, grid_s = rotation.quaternions(turn), motion.GRID_S
    else:
        course, size, _ = motions.MOTIONS[kind]
        q, accel_mps2 = course(size, rng)
        accel_g, grid_s = accel_mps2 / motion.G_MPS2, motions.GRID_S
    heading = rotation.quaternions(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])[:, None])
    q = rotation.product(np.broadcast_to(heading, q.shape), q)
    accel_g = rotation.to_body(np.broadcast_to(rotation.conjugate(heading), q.shape), accel_g)
    return q, rotation.to_body(q, accel_g + UP_G), grid_s


def _instants(points: int, points_a_sample: float, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Places of the samples on the grid; one in a recording of five loses some of its samples."""
    every = 1.0 / points_a_sample
    at: npt.NDArray[np.int64] = np.rint(np.arange(0.0, points - 1, every)).astype(np.int64)
    kept = rng.random(len(at)) > (0.01 if rng.random() < 0.2 else 0.0)
    return np.asarray(at[kept], np.int64)


def _sensed(values: FloatArray, at: npt.NDArray[np.int64], width: int) -> FloatArray:
    """Means over the time since the sample before, (N, 3)."""
    sums = np.cumsum(np.pad(values, ((0, 0), (width, 0)), mode="edge"), axis=1)
    return np.asarray((sums[:, at + width] - sums[:, at]).T / width, np.float64)


def _as_chip(
    chip: Chip, gyr: FloatArray, acc: FloatArray, rate_hz: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """With its errors, in counts of the least range that holds the motion; nothing is clipped."""
    wrong = np.eye(3) + chip.across * rng.standard_normal((3, 3))
    np.fill_diagonal(wrong, 1.0 + chip.scale * rng.standard_normal(3))
    per_sample = np.sqrt(0.5 * rate_hz)
    gyr = gyr @ wrong.T + chip.bias_dps * rng.standard_normal(3)
    gyr = gyr + chip.gyro_noise * per_sample * rng.standard_normal(gyr.shape)
    acc = acc * (1.0 + chip.scale * rng.standard_normal(3)) + chip.offset_g * rng.standard_normal(3)
    acc = acc + chip.accel_noise * per_sample * rng.standard_normal(acc.shape)
    counted = []
    for values, ranges in ((gyr, chip.ranges_dps), (acc, chip.ranges_g)):
        most = float(np.max(np.abs(values)))
        full = next((one for one in ranges if one > 1.05 * most), 1.05 * most)
        unit = full / 2 ** (chip.bits - 1)
        counted.append(np.rint(values / unit) * unit)
    return counted[0], counted[1]
