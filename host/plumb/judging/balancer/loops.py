"""The closed loops of `balancer` as frequency responses: the vehicle about upright, its filter and both controllers.

The vehicle is that of plumb.systems.balancer.vehicle with small angles, in the same steps of GRID_S. Its dry friction
has no slope while the wheels roll. While they hardly turn it is a steep one: loops that swing so little rock on it.

    balance   broken at the command of the bridge, the speed loop closed around it
    speed     broken at the lean that it asks for, the balance loop closed
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import FloatArray
from plumb.systems.balancer import vehicle
from plumb.systems.balancer.scenarios import TUNED
from plumb.systems.balancer.tuning import BalancerTuning
from plumb.tuning.loop_model import LOWEST_HZ, Controller, Margins, Response, nearest_margins

TUNING = "tuned"
GRID_POINTS = 1500
AT_REST_PER_RADPS = vehicle.FRICTION_NM / 0.5
"""Slope of the dry friction at standstill, Nm per rad/s."""
TILT, RATE, VELOCITY, ROLLED = range(4)
DEG = 180.0 / math.pi


@dataclass(frozen=True)
class Linear:
    """One step of GRID_S about upright: state (tilt rad, rate rad/s, velocity m/s, way rolled m) and duty to the next
    state; accelerations of that step: angular in rad/s^2, of the axle in m/s^2."""

    state: FloatArray
    duty: FloatArray
    turning: tuple[FloatArray, float]
    axle: tuple[FloatArray, float]

    @classmethod
    def of(cls, friction_per_radps: float) -> Linear:
        v = vehicle
        moment = v.BODY_KG * v.BODY_CENTRE_M
        inertia = moment * v.PENDULUM_M
        mass = v.WHEELS_KG + v.WHEELS_KGM2 / v.WHEEL_RADIUS_M**2 + v.BODY_KG
        determinant = mass * inertia - moment * moment
        slope = v.STALL_NM / v.NO_LOAD_RADPS + friction_per_radps
        torque = np.array([0.0, slope, -slope / v.WHEEL_RADIUS_M, 0.0])
        gravity = np.array([moment * v.GRAVITY_MPS2, 0.0, 0.0, 0.0])

        def accelerations(torque_nm: FloatArray, about: FloatArray) -> tuple[FloatArray, FloatArray]:
            along = torque_nm / v.WHEEL_RADIUS_M
            turning = (mass * (about - torque_nm) - moment * along) / determinant
            return turning, (inertia * along - moment * (about - torque_nm)) / determinant

        turning, axle = accelerations(torque, gravity)
        turning_duty, axle_duty = accelerations(np.array([v.STALL_NM]), np.zeros(1))
        step, state, duty = v.GRID_S, np.eye(4), np.zeros(4)
        state[RATE] += step * turning
        state[VELOCITY] += step * axle
        duty[RATE], duty[VELOCITY] = step * turning_duty[0], step * axle_duty[0]
        # rates of the end of the step move tilt and way, as in Vehicle.advance
        state[TILT] += step * state[RATE]
        duty[TILT] = step * duty[RATE]
        roll = state[VELOCITY] - v.WHEEL_RADIUS_M * state[RATE]
        state[ROLLED] += step * roll
        duty[ROLLED] = step * (duty[VELOCITY] - v.WHEEL_RADIUS_M * duty[RATE])
        return cls(state, duty, (turning, float(turning_duty[0])), (axle, float(axle_duty[0])))


@dataclass(frozen=True)
class Sampled:
    """Responses of a period's samples to a held command: rate in deg/s, tilt as the acceleration shows it without the
    axle's in deg, speed of the wheels in m/s."""

    rate: Response
    tilt: Response
    speed: Response


def sampled(linear: Linear, tuning: BalancerTuning, hz: FloatArray) -> Sampled:
    """The vehicle's response to the PID's command, which the drive's span turns into a duty."""
    steps = round(tuning.period_us * 1e-6 / vehicle.GRID_S)
    over, held = np.eye(4), np.zeros(4)
    for _ in range(steps - 1):
        over, held = linear.state @ over, linear.state @ held + linear.duty
    last, last_held = over, held  # before the last step, whose accelerations the sensors feel
    over, held = linear.state @ over, linear.state @ held + linear.duty
    z = np.exp(2j * math.pi * hz * tuning.period_s)
    moved = np.stack([np.linalg.solve(one * np.eye(4) - over, tuning.drive.span * held) for one in z])
    duty = tuning.drive.span

    def felt(of: tuple[FloatArray, float]) -> Response:
        row, direct = of
        before = moved @ (row @ last)  # of the state one period ago
        return np.asarray((before + duty * (row @ last_held + direct)) / z)

    forward_mps2 = felt(linear.axle) + vehicle.SENSOR_HEIGHT_M * felt(linear.turning)
    tilt_deg = DEG * (moved[:, TILT] - forward_mps2 / vehicle.GRAVITY_MPS2)
    speed = moved[:, ROLLED] * (1.0 - 1.0 / z) / tuning.period_s
    return Sampled(np.asarray(DEG * moved[:, RATE]), np.asarray(tilt_deg), np.asarray(speed))


def loop_gains(
    friction_per_radps: float, tuning: BalancerTuning = TUNED, hz: FloatArray | None = None
) -> tuple[FloatArray, dict[str, Response]]:
    """Frequencies, and the gain of each loop."""
    grid: FloatArray = np.geomspace(LOWEST_HZ, 0.499 / tuning.period_s, GRID_POINTS) if hz is None else hz
    vehicle_moves = sampled(Linear.of(friction_per_radps), tuning, grid)
    controller = Controller(tuning, tuning.trust.r_deg2)
    ts, back = tuning.period_s, np.exp(-2j * math.pi * grid * tuning.period_s)
    share = 1.0 - math.exp(-ts / tuning.wheel.tau_s) if tuning.wheel.tau_s else 1.0
    velocity = vehicle_moves.speed * share / (1.0 - (1.0 - share) * back)
    slope = share * (vehicle_moves.speed - velocity * back) / ts
    wheel_g = tuning.wheel.accel_share * slope / vehicle.GRAVITY_MPS2
    measured = vehicle_moves.tilt + DEG * wheel_g
    estimated, corrected = controller.estimate(grid, vehicle_moves.rate, measured)
    speed = tuning.speed
    damping = 1.0 - math.exp(-ts / speed.accel_tau_s) if speed.accel_tau_s else 1.0
    lean = (speed.lean_deg_per_mps + speed.lean_deg_per_m * ts * back / (1.0 - back)) * velocity
    lean = lean + speed.lean_deg_per_g * damping / (1.0 - (1.0 - damping) * back) * wheel_g
    inner = controller.command(grid, estimated, corrected, tuning.pid)
    none: npt.NDArray[np.complex128] = np.zeros(len(grid), np.complex128)
    from_lean = controller.command(grid, lean, none, tuning.pid)
    return grid, {"balance": np.asarray(inner + from_lean), "speed": np.asarray(from_lean / (1.0 + inner))}


def margins(friction_per_radps: float = 0.0) -> Mapping[str, Margins]:
    """Margins of both loops, by name. They are stable, as the closed-loop runs show."""
    hz, gains = loop_gains(friction_per_radps)
    return {name: nearest_margins(hz, gain) for name, gain in gains.items()}
