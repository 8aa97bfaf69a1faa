"""A body in a hand, with the sensors of `attitude`: what the virtual board has on its pins while they are calibrated.

The errors are those of a new part, by its data sheet, and of one that was glued to the body any way round."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plumb.physics.hand import TurningHand
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.scenarios import PERIOD_US, TWO_CHIPS, Sensors, scenario

ACCEL_ZERO_G, ACCEL_SCALE, SQUARE_RAD, LEAN_RAD = 0.02, 0.01, 0.005, 0.02
"""Standard deviations: zero and scale of the accelerometer's axes, their angles, and how aslant the board is glued."""
PERIOD_S = PERIOD_US * 1e-6
Axes = tuple[float, float, float]
NOISE_SAMPLES = 4096
"""Noise of so many samples is drawn; then it begins again."""


@dataclass(frozen=True)
class SensorErrors:
    """matrices (3, 3): body values to those of the sensor's axes; zeros in deg/s and g, (3,)."""

    gyro: FloatArray
    gyro_zero_dps: FloatArray
    accel: FloatArray
    accel_zero_g: FloatArray


def drawn_errors(sensors: Sensors, rng: np.random.Generator) -> SensorErrors:
    """Both sensors on one board, which is mounted one of the 24 ways round and a little aslant."""
    mounting = rotations()[int(rng.integers(24))] @ _leaning(LEAN_RAD * rng.standard_normal(3))

    def bent(scale: float, square: float) -> FloatArray:
        return np.asarray(np.diag(1.0 + scale * rng.standard_normal(3)) + square * rng.standard_normal((3, 3)))

    return SensorErrors(
        bent(sensors.scale, sensors.square_rad) @ mounting,
        sensors.bias_dps * rng.standard_normal(3),
        bent(ACCEL_SCALE, SQUARE_RAD) @ mounting,
        ACCEL_ZERO_G * rng.standard_normal(3),
    )


def rotations() -> list[FloatArray]:
    """The 24 ways to mount a sensor: matrices of 0 and +-1 that turn and do not mirror."""
    found = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.zeros((3, 3))
            matrix[np.arange(3), order] = 1.0 - 2.0 * np.array(signs)
            if np.linalg.det(matrix) > 0.0:
                found.append(matrix)
    return found


def _leaning(angles_rad: FloatArray) -> FloatArray:
    """The rotation nearest to these small angles."""
    x, y, z = angles_rad
    left, _, right = np.linalg.svd(np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]]))
    return np.asarray(left @ right)


class HeldBody:
    """The body with its sensors, held by a hand; their noise comes from the seed, and their errors, unless given. part:
    the scenario that names the sensors."""

    def __init__(self, hand: TurningHand, seed: int, errors: SensorErrors | None = None, part: str = TWO_CHIPS) -> None:
        self.scenario = scenario(part, seed, seconds=2.0)
        self.hand = hand
        rng = np.random.default_rng(seed)
        self.errors = errors or drawn_errors(self.scenario.sensors, rng)
        sensors, per_sample = self.scenario.sensors, np.sqrt(0.5 / PERIOD_S)
        self._gyro_noise = sensors.noise_dps * per_sample * rng.standard_normal((NOISE_SAMPLES, 3))
        self._latest: tuple[int, tuple[int, ...]] = -1, ()
        self._accel_noise = sensors.accel_noise_g * per_sample * rng.standard_normal((NOISE_SAMPLES, 3))

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Does nothing: the outputs have no effect."""

    def rate_dps(self, time_s: float) -> Axes:
        """What the gyro puts out, with its errors."""
        rates = self.hand.at(time_s)[1]
        x, y, z = self.errors.gyro @ rates + self.errors.gyro_zero_dps + self._gyro_noise[_sample(time_s)]
        return x, y, z

    def force_g(self, time_s: float) -> Axes:
        """What the accelerometer puts out, with its errors."""
        vertical = self.hand.at(time_s)[0]
        x, y, z = self.errors.accel @ vertical + self.errors.accel_zero_g + self._accel_noise[_sample(time_s)]
        return x, y, z

    def counts(self, time_s: float) -> tuple[int, ...]:
        """The six raw counts of the sample at time_s; they change every period."""
        if _sample(time_s) != self._latest[0]:
            self._latest = _sample(time_s), self._sensed(time_s)
        return self._latest[1]

    def _sensed(self, time_s: float) -> tuple[int, ...]:
        sensors = self.scenario.sensors
        parts = ((self.rate_dps(time_s), sensors.gyro), (self.force_g(time_s), sensors.accel))
        felt = [
            np.clip(np.rint(np.array(values) / channel.unit_per_count), channel.min_counts, channel.max_counts)
            for values, channel in parts
        ]
        return tuple(np.concatenate(felt).astype(int).tolist())

    def truth(self, time_s: float) -> dict[str, float]:
        """The true vertical in body axes, and the biases of the gyro in deg/s, in its own axes."""
        up = {f"up_{axis}": float(one) for axis, one in zip("xyz", self.hand.at(time_s)[0], strict=True)}
        bias = self.errors.gyro_zero_dps
        return {**up, **{f"bias_{axis}_dps": float(one) for axis, one in zip("xyz", bias, strict=True)}}

    def setpoint(self, time_s: float) -> int:
        return 0


def _sample(time_s: float) -> int:
    return int(time_s / PERIOD_S) % NOISE_SAMPLES
