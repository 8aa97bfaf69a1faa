"""Recordings of an IMU made from a known motion, and faults that are put into them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from plumb.audit import mends, signed_axes
from plumb.audit.samples import Samples
from plumb.physics import rotation
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude import motion

UP_G = np.array([[0.0], [0.0], [1.0]])
Spoil = Callable[[Samples, np.random.Generator], Samples]


def in_the_hand(seed: int, rate_hz: float, seconds: float = 40.0, name: str = "hand") -> Samples:
    """A body that is turned and moved in the hand, at rest at both ends, with the errors of a cheap sensor and a
    reference of 0.1 deg. rate_hz: 50 to 1000."""
    rng = np.random.default_rng(seed)
    points = round(seconds / motion.GRID_S) + 1
    grid_s = np.arange(points) * motion.GRID_S
    turn, moved_g = motion.MOTIONS[name](np.asarray(grid_s, np.float64), rng.standard_normal((6, points)))
    inclined = np.radians(15.0) * rng.standard_normal(2)
    begun = rotation.quaternions(np.array([*inclined, rng.uniform(-3.0, 3.0)])[:, None])
    q = rotation.product(np.broadcast_to(begun, (4, points)), rotation.quaternions(turn))
    rate_dps = np.asarray(np.degrees(rotation.rates_radps(q, motion.GRID_S)), np.float64)
    felt_g = rotation.to_body(q, moved_g + UP_G)
    every = 1.0 / rate_hz
    n = round(seconds * rate_hz)
    at = np.minimum(np.rint(np.arange(n) * every / motion.GRID_S).astype(int), points - 1)
    width = max(1, round(every / motion.GRID_S))

    def sensed(values: FloatArray) -> FloatArray:
        sums = np.cumsum(np.pad(values, ((0, 0), (width, 0)), mode="edge"), axis=1)
        return (sums[:, at + width] - sums[:, at]).T / width

    matrix = np.eye(3) + 0.003 * rng.standard_normal((3, 3))
    gyr = sensed(rate_dps) @ matrix.T + rng.standard_normal(3) + 0.005 * np.sqrt(rate_hz) * rng.standard_normal((n, 3))
    acc = sensed(felt_g) + 0.005 * rng.standard_normal(3) + 2e-4 * np.sqrt(rate_hz) * rng.standard_normal((n, 3))
    seen = rotation.product(q[:, at], rotation.quaternions(np.radians(0.1) * rng.standard_normal((3, n))))
    unit_dps, unit_g = 2000.0 / 32768, 16.0 / 32768
    return Samples(
        np.asarray(np.arange(n) * every, np.float64),
        np.rint(gyr / unit_dps) * unit_dps,
        np.rint(acc / unit_g) * unit_g,
        seen.T.copy(),
    )


def _scaled(sensor: str, factor: float) -> Spoil:
    return lambda samples, _: replace(samples, **{sensor: getattr(samples, sensor) * factor})


def _named(sensor: str, axes: str) -> Spoil:
    matrix = signed_axes.of_name(axes)
    assert matrix is not None
    return lambda samples, _: replace(samples, **{sensor: getattr(samples, sensor) @ matrix.T})


def left_handed(samples: Samples, _: np.random.Generator) -> Samples:
    mirror = np.diag([1.0, -1.0, 1.0])
    return replace(samples, gyr_dps=samples.gyr_dps @ mirror, acc_g=samples.acc_g @ mirror)


def late_gyro(samples: Samples, rng: np.random.Generator) -> Samples:
    """By whole samples, so that limits and counts stay what they are; at rest at both ends."""
    step_s = float(samples.time_s[1] - samples.time_s[0])
    return replace(samples, gyr_dps=np.roll(samples.gyr_dps, round(rng.uniform(0.07, 0.15) / step_s), axis=0))


def late_reference(samples: Samples, rng: np.random.Generator) -> Samples:
    if samples.ref_quat is None:
        return samples
    step_s = float(samples.time_s[1] - samples.time_s[0])
    return replace(samples, ref_quat=np.roll(samples.ref_quat, round(rng.uniform(0.08, 0.15) / step_s), axis=0))


def shared_stamps(samples: Samples, _: np.random.Generator) -> Samples:
    return samples.with_time(samples.time_s[np.arange(len(samples)) // 2 * 2])


def gap(samples: Samples, rng: np.random.Generator) -> Samples:
    at = int(rng.uniform(0.1, 0.25) * len(samples))
    return samples.with_time(samples.time_s + np.where(np.arange(len(samples)) >= at, rng.uniform(2.0, 9.0), 0.0))


def two_sessions(samples: Samples, rng: np.random.Generator) -> Samples:
    at = int(rng.uniform(0.1, 0.25) * len(samples))
    return samples.with_time(samples.time_s - np.where(np.arange(len(samples)) >= at, samples.time_s[at], 0.0))


def repeated_rows(samples: Samples, rng: np.random.Generator) -> Samples:
    kept = np.sort(np.concatenate([np.arange(len(samples)), rng.integers(0, len(samples), len(samples) // 20)]))
    return samples.rows(kept)


def clipped(samples: Samples, _: np.random.Generator) -> Samples:
    """At 0.6 of the largest reading."""
    most = 0.6 * np.max(np.abs(samples.gyr_dps))
    return replace(samples, gyr_dps=np.clip(samples.gyr_dps, -most, most))


def wrapped(samples: Samples, _: np.random.Generator) -> Samples:
    """Counts of a range of 0.6 of the largest reading."""
    unit = 0.6 * np.max(np.abs(samples.gyr_dps)) / 32768
    counts = np.rint(samples.gyr_dps / unit).astype(np.int64)
    return replace(samples, gyr_dps=((counts + 32768) % 65536 - 32768) * unit)


def held_gyro(samples: Samples, _: np.random.Generator) -> Samples:
    return replace(samples, gyr_dps=samples.gyr_dps[np.arange(len(samples)) // 3 * 3])


def _reference(mend: str) -> Spoil:
    def spoil(samples: Samples, _: np.random.Generator) -> Samples:
        q = samples.ref_quat
        if q is None:
            return samples
        return replace(samples, ref_quat=q[:, [1, 2, 3, 0]] if mend == "ref:wxyz" else mends.reference(q, mend))

    return spoil


FAULTS: dict[str, tuple[str, str, Spoil]] = {
    "gyro-radps": ("gyro unit", "gyro-units", _scaled("gyr_dps", np.pi / 180.0)),
    "gyro-dps": ("gyro unit", "gyro-units", _scaled("gyr_dps", 180.0 / np.pi)),
    "gyro-16.4": ("gyro unit", "gyro-units", _scaled("gyr_dps", 16.4)),
    "gyro-131": ("gyro unit", "gyro-units", _scaled("gyr_dps", 131.0)),
    "acc-mps2": ("acc unit", "accelerometer-units", _scaled("acc_g", 9.80665)),
    "acc-g": ("acc unit", "accelerometer-units", _scaled("acc_g", 1.0 / 9.80665)),
    "acc-counts": ("acc unit", "accelerometer-units", _scaled("acc_g", 16384.0)),
    "gyro-swapped": ("axes", "axes", _named("gyr_dps", "+y+x+z")),
    "gyro-turned": ("axes", "axes", _named("gyr_dps", "+y+z+x")),
    "gyro-mirrored": ("axes", "axes", _named("gyr_dps", "+x-y+z")),
    "acc-turned": ("axes", "axes", _named("acc_g", "-y+x+z")),
    "acc-mirrored": ("axes", "axes", _named("acc_g", "-x+y+z")),
    "left-handed": ("axes", "axes", left_handed),
    "acc-sign": ("up", "accelerometer-sign", _scaled("acc_g", -1.0)),
    "gyro-late": ("gyro lag", "gyro-lag", late_gyro),
    "ref-late": ("ref lag", "reference-lag", late_reference),
    "ms": ("clock unit", "clock-unit", _scaled("time_s", 1e3)),
    "shared-stamps": ("stamps", "shared-stamps", shared_stamps),
    "gap": ("parts", "gap", gap),
    "sessions": ("parts", "sessions", two_sessions),
    "repeated": ("rows", "repeated-rows", repeated_rows),
    "clipped": ("limit", "gyro-clip", clipped),
    "wrapped": ("limit", "gyro-wrap", wrapped),
    "held": ("held", "gyro-held", held_gyro),
    "ref-w-last": ("ref order", "reference-order", _reference("ref:wxyz")),
    "ref-back": ("ref direction", "reference-direction", _reference("ref:turned")),
    "ref-ned": ("up", "accelerometer-sign", _reference("ref:ned")),
}
"""Name -> what it spoils (two of the same cancel or mix), the kind of finding that names it, the spoil itself."""
OF_AXES = {"gyro-axes", "accelerometer-axes", "axes"}
ORDER = (
    "limit", "held", "axes", "gyro lag", "ref lag", "up", "ref direction", "ref order", "gyro unit", "acc unit", "rows",
    "stamps", "parts", "clock unit",
)  # fmt: skip
"""In which faults are put in: those of the sensor first, those of the file last."""


def spoilt(samples: Samples, names: tuple[str, ...], seed: int) -> Samples:
    rng = np.random.default_rng([seed, 7])
    for name in sorted(names, key=lambda one: ORDER.index(FAULTS[one][0])):
        samples = FAULTS[name][2](samples, rng)
    return samples


def names(kinds: set[str], fault: str) -> bool:
    """Whether findings of these kinds name the fault."""
    wanted = FAULTS[fault][1]
    return bool(kinds & OF_AXES) if wanted == "axes" else wanted in kinds
