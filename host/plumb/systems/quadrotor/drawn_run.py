"""A run of `quadrotor` with all its random values, drawn from its seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plumb.physics.airframe import HUMMINGBIRD_X, Airframe
from plumb.physics.imu import MPU6050
from plumb.physics.sensors import Fault
from plumb.physics.vectors import length
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.systems.prescribed import Steps, put_faults
from plumb.systems.quadrotor.courses import HAPPENINGS, MPU6050_LINK, TWO_CHIPS_LINK, Course
from plumb.systems.quadrotor.frame_tuning import tuned
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import Vehicles

GYRO_LIES, ACCEL_LIES, BEGUN = (1 << len(HAPPENINGS) + place for place in range(3))


@dataclass(frozen=True)
class Prescribed:
    """A flight of the ideal controller: inputs of every step, and the truth by name."""

    raw: npt.NDArray[np.int16]
    throttle_q15: npt.NDArray[np.int32]
    truth: dict[str, FloatArray]


@dataclass(frozen=True)
class Scenario(Steps):
    """One run. imu: unit normal errors of the sensors; noise: (steps, 9): six of the sensors, three of the gusts;
    sticks: of the pilot that moves them at random; fault_noise: (6, steps). lands: what the board does without a
    receiver, None: as it is tuned. events: how many were drawn."""

    name: str
    seed: int
    period_us: int
    course: Course
    frame: Airframe
    imu: FloatArray
    heading_rad: FloatArray
    wind_rad: FloatArray
    phase_rad: FloatArray
    gusts: FloatArray
    sticks: FloatArray
    noise: FloatArray
    fault_noise: FloatArray
    faults: tuple[Fault, ...] = ()
    lands: bool | None = None
    events: int = 0

    @property
    def steps(self) -> int:
        return len(self.noise)

    @property
    def link(self) -> Mapping[str, int]:
        """Parameters of the board that its sensors need."""
        return MPU6050_LINK if self.course.grade is MPU6050 else TWO_CHIPS_LINK

    def fit(self, tuning: QuadrotorTuning) -> QuadrotorTuning:
        """The tuning, with the calibration of these sensors and, on another frame, the gains of that."""
        grade = self.course.grade
        if self.frame is not HUMMINGBIRD_X:
            tuning = tuned(tuning, self.frame)
        if self.lands is not None:
            tuning = replace(tuning, receiver=replace(tuning.receiver, lands=int(self.lands)))
        estimator = replace(tuning.attitude, gyro=grade.gyro, accel=grade.accel)
        return replace(tuning, period_us=self.period_us, attitude=estimator)

    @cached_property
    def prescribed(self) -> Prescribed:
        """The flight of the ideal controller."""
        vehicles, rows, throttle, raw = Vehicles([self], ideal=True), [], [], []
        declared = declarations.system("quadrotor")
        nothing = np.zeros((4, 1))
        for step in range(self.steps):
            if step:
                vehicles.advance(nothing)
            raw.append(declared.whole_inputs([*vehicles.counts()[0].tolist(), *vehicles.commands()[0].tolist()]))
            throttle.append(int(vehicles.throttle_q15()[0]))
            rows.append(truth_of(vehicles, self.faults))
        truth = {name: np.array([row[name] for row in rows], np.float64) for name in rows[0]}
        counts = np.array(raw, np.int16)
        put_faults(counts, self.faults, self.time_s, self.fault_noise)
        return Prescribed(counts, np.array(throttle, np.int32), truth)

    def counts(self) -> npt.NDArray[np.int16]:
        """All inputs of the prescribed flight, (steps, 12)."""
        return self.prescribed.raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Throttle of the prescribed flight, Q15, (steps,)."""
        return self.prescribed.throttle_q15

    def truth(self) -> dict[str, FloatArray]:
        """See `truth_of`."""
        return self.prescribed.truth


def truth_of(vehicles: Vehicles, faults: Sequence[Fault]) -> dict[str, float]:
    """Of a batch of one: vertical in body axes, rates, biases of the gyro, lean, what the pilot asks for, height; how
    far the legs are above the ground (without one: the height), what presses them, by the weight, climb and speed; and
    what happens now, as bits: those of courses.HAPPENINGS by their places, then GYRO_LIES and ACCEL_LIES,
    and BEGUN times how many have begun."""
    body = vehicles.body
    up, rate = body.matrix[2, :, 0], np.degrees(body.rate_radps[:, 0])
    bias = vehicles.bias_dps()[:, 0]
    roll, pitch = np.degrees(vehicles.lean_rad[:, 0])
    height_m, velocity = float(body.position_m[2, 0]), body.velocity_mps[:, 0]
    above_m = float(vehicles.ground.above_m(body.position_m)[0]) - vehicles.frame.leg_down_m
    return {
        **{f"up_{axis}": float(value) for axis, value in zip("xyz", up, strict=True)},
        **{f"rate_{axis}_dps": float(value) for axis, value in zip("xyz", rate, strict=True)},
        **{f"bias_{axis}_dps": float(value) for axis, value in zip("xyz", bias, strict=True)},
        "lean_deg": float(np.degrees(math.acos(min(max(float(up[2]), -1.0), 1.0)))),
        "asked_roll_deg": float(roll),
        "asked_pitch_deg": float(pitch),
        "height_m": height_m,
        "clear_m": above_m if vehicles.course.lands else height_m,
        "pressed": float(body.pressed_n[0]) / vehicles.frame.weight_n,
        "climb_mps": float(velocity[2]),
        "speed_mps": float(length(velocity)),
        "happening": float(_happening(vehicles, faults)),
    }


def _happening(vehicles: Vehicles, faults: Sequence[Fault]) -> int:
    course, now_s = vehicles.course, vehicles.time_s
    bits = [1 << place for place, what in enumerate(HAPPENINGS) if course.lasting(what, now_s) is not None]
    lying = [one.channel for one in faults if one.start_s <= now_s < one.stop_s]
    gyro, accel = any(channel < 3 for channel in lying), any(channel >= 3 for channel in lying)
    begun = sum(one.begun(now_s) for one in course.happenings)
    return sum(bits) + GYRO_LIES * gyro + ACCEL_LIES * accel + BEGUN * begun
