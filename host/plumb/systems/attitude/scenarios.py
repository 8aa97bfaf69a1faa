"""`attitude`: a body in the hand, with a three-axis gyro and accelerometer, every 5 ms.

Channels, in the order of the raw counts: gyro x, y, z, acceleration x, y, z, in body axes. At rest and level z reads
1 g. Both sensors give the mean of what they felt since the sample before, as a sensor with its low-pass does; the
truth is that at the end. A step without a sample has counts of -32768.

Assumed of every sensor: a bias that a factory leaves and that grows while the gyro warms up, scale error, axes that
are not quite square, and white noise. An offset of the accelerometer looks like a tilt; it is left small, as
after a calibration of six sides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from plumb.contract.disturbance import Request
from plumb.physics import rotation
from plumb.physics.sensors import FAULT_NOTES, Fault, fault_of
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel
from plumb.systems.attitude import motion
from plumb.systems.attitude.quantise import PERIODS_US
from plumb.systems.attitude.settings import Aid, Gyro
from plumb.systems.attitude.tuning import AttitudeTuning
from plumb.systems.prescribed import Playback, Steps, put_faults
from plumb.systems.run_length import length_s
from plumb.tuning.channels import NO_SAMPLE

PERIOD_US = 5_000
TWO_CHIPS, ONE_CHIP = "adxl345_itg3205", "mpu6050"
"""Scenarios, and the tunings for their sensors."""


@dataclass(frozen=True)
class Sensors:
    """A gyro and an accelerometer: their channels, and their errors, standard deviations of each axis.

    warm_up_dps: bias that comes within WARM_UP_S; square: angle by which an axis is not square, rad; noise in unit per
    root Hz. link: their parameters on the board.
    """

    gyro: Channel
    accel: Channel
    bias_dps: float = 1.0
    warm_up_dps: float = 0.3
    scale: float = 0.005
    square_rad: float = 0.001
    noise_dps: float = 0.005
    accel_noise_g: float = 200e-6
    accel_offset_g: float = 0.002
    link: Mapping[str, int] = field(default_factory=dict)


def _sixteen_bits(lsb_per_dps: float, lsb_per_g: float) -> tuple[Channel, Channel]:
    """The last count of each side is a sensor at its rail: beyond the limits, and so flagged."""
    return Channel(0.0, 1.0 / lsb_per_dps, -32767, 32766), Channel(0.0, 1.0 / lsb_per_g, -32767, 32766)


STANDARD = Sensors(*_sixteen_bits(16.4, 2048.0))
"""16 bits at +-2000 deg/s and +-16 g."""
SENSORS = {
    TWO_CHIPS: Sensors(
        Channel(0.0, 1.0 / 14.375, -28750, 28750),
        Channel(0.0, 1.0 / 256.0, -4095, 4094),
        bias_dps=2.0,
        warm_up_dps=0.5,
        scale=0.01,
        noise_dps=0.03,
        accel_noise_g=290e-6,
    ),
    ONE_CHIP: Sensors(
        *_sixteen_bits(16.4, 2048.0),
        bias_dps=2.0,
        warm_up_dps=0.5,
        scale=0.01,
        square_rad=0.007,
        accel_noise_g=400e-6,
        link={"accel_bus": 2},
    ),
}
"""Of the scenarios that name their sensors, from the data sheets; the others have STANDARD."""
SENSOR_LINKS = {name: {"accel_bus": 0, **sensors.link} for name, sensors in SENSORS.items()}
WARM_UP_S = 30.0
GAPS_EVERY_S, GAPS_S = 3.0, (0.02, 0.1)
"""`gaps`: one in such a time, and the shortest and longest."""

SCENARIOS = {
    "hand": "turned and moved in the hand",
    "static": "at rest, inclined",
    "fast": "shaken and turned as fast as an arm does it, up to the range of the gyro",
    "centrifuge": "on an arm of 0.4 m that turns once a second: 1.6 g that never ends",
    "fall": "in the hand, thrown up and caught every 8 s",
    "gaps": "in the hand, with gaps of 20 to 100 ms in the samples",
    TWO_CHIPS: "in the hand, with ADXL345 and ITG-3205",
    ONE_CHIP: "in the hand, with an MPU-6050",
}
SECONDS = dict.fromkeys(SCENARIOS, 60.0)
DEFAULT_SCENARIO = "hand"
MOVES = {"static": "still", "fast": "fast", "centrifuge": "centrifuge", "fall": "fall"}
"""Scenario -> its motion; of all others `hand`."""

DEFAULT = AttitudeTuning(period_us=PERIOD_US, gyro=STANDARD.gyro, accel=STANDARD.accel)
VEHICLE_DRAG_PER_S, VEHICLE_WALK_DPS = 0.28, 0.03
"""Of the tuning `vehicle`: the drag set for a hummingbird (`plumb.physics.airframe`); and the walk of a gyro that warms
up in flight, by 0.5 deg/s with a time constant of 30 s: in 3 s such a walk strays as far as that warming."""
TUNINGS = {
    "standard": DEFAULT,
    "vehicle": replace(DEFAULT, errors=Gyro(bias_walk_dps=VEHICLE_WALK_DPS), aid=Aid(drag_per_s=VEHICLE_DRAG_PER_S)),
    TWO_CHIPS: replace(
        DEFAULT,
        gyro=SENSORS[TWO_CHIPS].gyro,
        accel=SENSORS[TWO_CHIPS].accel,
        errors=Gyro(scale=0.0069, noise_dps=0.03),
    ),
    ONE_CHIP: replace(DEFAULT, gyro=SENSORS[ONE_CHIP].gyro, accel=SENSORS[ONE_CHIP].accel, errors=Gyro(scale=0.0069)),
}
TUNING_NOTES = {
    "standard": "16 bits at +-2000 deg/s and +-16 g; the one for every recording",
    "vehicle": "the same with the drag of a quadrotor's rotors as an aid, for a gyro that warms up in flight",
    TWO_CHIPS: "ADXL345 at 256 counts per g, ITG-3205 at 14.375 counts per deg/s",
    ONE_CHIP: "MPU-6050 at 16.4 counts per deg/s and 2048 counts per g",
}
DEFAULT_TUNING = "standard"
FAULT_CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
FAULTS = FAULT_NOTES


def faults(requests: Sequence[Request]) -> tuple[Fault, ...]:
    """Faults for `scenario`; raises UsageError for an unknown kind or channel."""
    return tuple(fault_of(asked, FAULT_CHANNELS) for asked in requests)


def apart_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle between two verticals (3, ...) of any length: the error of the tilt."""
    across = np.linalg.norm(np.cross(a, b, axis=0), axis=0)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(a * b, axis=0))))


@dataclass(frozen=True)
class Scenario(Steps):
    """One run: its motion and the sensor outputs at the sampling instants.

    (3, steps) each: vertical, bias_dps: true values; sensed_dps, sensed_g: sensor outputs before faults. lost: steps
    without a sample, (steps,). fault_noise: (6, steps).
    """

    name: str
    seed: int
    period_us: int
    sensors: Sensors
    vertical: FloatArray
    bias_dps: FloatArray
    sensed_dps: FloatArray
    sensed_g: FloatArray
    lost: npt.NDArray[np.bool_]
    fault_noise: FloatArray
    faults: tuple[Fault, ...] = ()

    @property
    def steps(self) -> int:
        return len(self.lost)

    @property
    def link(self) -> Mapping[str, int]:
        """The parameters of the sensors on the board."""
        return self.sensors.link

    def fit(self, tuning: AttitudeTuning) -> AttitudeTuning:
        """The tuning, with the calibration of these sensors."""
        return replace(tuning, period_us=self.period_us, gyro=self.sensors.gyro, accel=self.sensors.accel)

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts, (steps, 6)."""
        parts = ((self.sensed_dps, self.sensors.gyro), (self.sensed_g, self.sensors.accel))
        felt = [
            np.clip(np.rint(sensed / channel.unit_per_count), channel.min_counts, channel.max_counts)
            for sensed, channel in parts
        ]
        raw = np.concatenate(felt).astype(np.int16).T
        put_faults(raw, self.faults, self.time_s, self.fault_noise)
        raw[self.lost] = NO_SAMPLE
        return np.asarray(raw)

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Zeros, (steps,): the system has no controller."""
        return np.zeros(self.steps, np.int32)

    def truth(self) -> dict[str, FloatArray]:
        """The true vertical in body axes, and the biases of the gyro in deg/s, (steps,) each."""
        up = {f"up_{axis}": row for axis, row in zip("xyz", self.vertical, strict=True)}
        return {**up, **{f"bias_{axis}_dps": row for axis, row in zip("xyz", self.bias_dps, strict=True)}}


@dataclass(frozen=True)
class AttitudePlant(Playback):
    """Plays the prescribed motion, and what the sensors put out before they count it."""

    scenario: Scenario

    def rate_dps(self, time_s: float) -> tuple[float, float, float]:
        """What the gyro puts out, with its errors."""
        x, y, z = self.scenario.sensed_dps[:, self.step_at(time_s)].tolist()
        return x, y, z

    def force_g(self, time_s: float) -> tuple[float, float, float]:
        """What the accelerometer puts out, with its errors."""
        x, y, z = self.scenario.sensed_g[:, self.step_at(time_s)].tolist()
        return x, y, z


def plant(run: Scenario, *, open_loop: bool = True) -> AttitudePlant:
    """The plant of a run, which plays its samples, open loop or not."""
    return AttitudePlant(run.period_us, run.counts(), run.truth(), run)


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[Fault, ...] = (),
) -> Scenario:
    """Draw a run. One generator per seed, in this order:

    attitude at the start (2), gyro bias (3), warm-up (3), scale (3), squareness (3, 3), accelerometer offset (3),
    motion (6, grid), gyro noise, accelerometer noise (3, steps each), gaps (steps, 2), fault noise (6, steps). A
    scenario that does not use a value draws it nevertheless, so that seeds are comparable.
    """
    seconds = length_s("attitude", name, SECONDS, seconds, period_us, PERIODS_US, seed)
    rng, period_s, sensors = np.random.default_rng(seed), period_us * 1e-6, SENSORS.get(name, STANDARD)
    steps, points = round(seconds / period_s), round(seconds / motion.GRID_S) + 1
    inclined = np.radians(30.0) * rng.standard_normal(2)
    bias = sensors.bias_dps * rng.standard_normal(3)
    warm_up = sensors.warm_up_dps * rng.standard_normal(3)
    matrix = np.diag(1.0 + sensors.scale * rng.standard_normal(3)) + sensors.square_rad * rng.standard_normal((3, 3))
    offset = sensors.accel_offset_g * rng.standard_normal(3)
    white = rng.standard_normal((6, points))
    gyro_noise = sensors.noise_dps * np.sqrt(0.5 / period_s) * rng.standard_normal((3, steps))
    accel_noise = sensors.accel_noise_g * np.sqrt(0.5 / period_s) * rng.standard_normal((3, steps))
    dropped = rng.random((steps, 2))
    fault_noise = rng.standard_normal((6, steps))

    grid_s = np.arange(points, dtype=np.float64) * motion.GRID_S
    turn, accel_g = motion.MOTIONS[MOVES.get(name, "hand")](grid_s, white)
    begun = rotation.quaternions(np.array([[inclined[0]], [inclined[1]], [0.0]]))
    attitude = rotation.product(rotation.quaternions(turn), np.broadcast_to(begun, (4, points)))
    rate = rotation.rates_radps(attitude, motion.GRID_S)
    force = rotation.to_body(attitude, accel_g + np.array([[0.0], [0.0], [1.0]]))
    at_s: FloatArray = np.arange(steps, dtype=np.float64) * period_s
    at = np.minimum(np.rint(at_s / motion.GRID_S).astype(np.int64), points - 1)
    up = rotation.to_body(attitude[:, at], np.tile([[0.0], [0.0], [1.0]], steps))
    drifting = bias[:, None] + warm_up[:, None] * (1.0 - np.exp(-at_s / WARM_UP_S))
    return Scenario(
        name,
        seed,
        period_us,
        sensors,
        up,
        drifting,
        sensed_dps=matrix @ np.degrees(_means(rate, at)) + drifting + gyro_noise,
        sensed_g=_means(force, at) + offset[:, None] + accel_noise,
        lost=_gaps(at_s, dropped) if name == "gaps" else np.zeros(steps, bool),
        fault_noise=fault_noise,
        faults=faults,
    )


def _means(values: FloatArray, at: npt.NDArray[np.int64]) -> FloatArray:
    """Mean of values (3, grid) over the grid points after the sample before, up to each sample's own, (3, steps)."""
    sums = np.concatenate([np.zeros((3, 1)), np.cumsum(values, axis=1)], axis=1)
    before = np.concatenate([[-1], at[:-1]])
    count = np.maximum(at - before, 1)
    found = (sums[:, at + 1] - sums[:, before + 1]) / count
    found[:, at == before] = values[:, at[at == before]]
    return np.asarray(found)


def _gaps(time_s: FloatArray, drawn: FloatArray) -> npt.NDArray[np.bool_]:
    """The steps without a sample: of every few seconds one gap, its length and place drawn."""
    lost = np.zeros(len(time_s), bool)
    for number in range(int(time_s[-1] / GAPS_EVERY_S) + 1):
        shorter, longer = GAPS_S
        length_s = shorter + (longer - shorter) * drawn[number, 0]
        begin_s = (number + drawn[number, 1]) * GAPS_EVERY_S
        lost |= (time_s >= max(begin_s, 1.0)) & (time_s < begin_s + length_s)
    return lost
