"""Dynamics of the vehicle: an inverted pendulum on two wheels, with its motor, pushes and disturbances.

Two equations of motion, one for each use. x: position of the axle, forward; v = x'; theta: tilt forward; M: pushes and
d: disturbances, as angular accelerations; h: height of the sensors; u: duty of the bridge in -1..1.

    open loop (the axle's acceleration a is given, by an ideal controller that knows the true state):
        theta'' = (g sin theta - a cos theta) / L + M + d,   v' = a

    closed loop (the motor turns the wheels against the body; r wheel radius, l height of the body's centre):
        torque = stall * (u - (v / r - theta') / no_load) - friction * tanh((v / r - theta') / 0.5)
        (m_w + I_w / r^2 + m) v' + m l cos theta theta'' = m l sin theta theta'^2 + torque / r
        m l cos theta v' + m l L theta'' = m g l sin theta - torque + m l L (M + d)

    specific force at the sensors, along the body's axes:
        a_X = v' + h (theta'' cos theta - theta'^2 sin theta),  a_Z = -h (theta'' sin theta + theta'^2 cos theta)
        f_x = (a_X cos theta - (a_Z + g) sin theta) / g,  f_z = (a_X sin theta + (a_Z + g) cos theta) / g

L, h, the ideal controller, pushes and disturbances are specified with the figures; every other number is assumed,
because the source gives none. Time is simulated in steps of GRID_S; counts are constant within a control period.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import FloatArray

GRID_S = 0.001
GRAVITY_MPS2 = 9.80665
PENDULUM_M = 0.15
"""Equivalent length of the body as a pendulum about its axle: (I + m l^2) / (m l)."""
SENSOR_HEIGHT_M = 0.10
BODY_KG, BODY_CENTRE_M = 1.2, 0.12
WHEELS_KG, WHEEL_RADIUS_M = 0.3, 0.05
WHEELS_KGM2 = 0.5 * WHEELS_KG * WHEEL_RADIUS_M**2
STALL_NM, NO_LOAD_RADPS, FRICTION_NM = 0.8, 60.0, 0.02
"""Motors of both wheels together: stall torque at full duty, no-load speed at full duty (3 m/s), dry friction."""
POLE_PAIRS = 14
EDGES_PER_TURN = 6 * POLE_PAIRS
"""Three Hall sensors give six edges per electrical turn; the motor is in the wheel, without a gear."""
EDGE_M = 2.0 * math.pi * WHEEL_RADIUS_M / EDGES_PER_TURN

IDEAL_PER_RAD, IDEAL_PER_RADPS, IDEAL_PER_MPS, IDEAL_LIMIT_MPS2 = 60.0, 12.0, 6.0, 8.0
PUSH_RADPS2_PER_MPS2 = 0.3 / PENDULUM_M
DISTURBANCE_TAU_S, DISTURBANCE_RADPS2_PER_RTS = 0.3, 0.8
LIE_RAD = math.radians(85.0)
"""Tilt at which the body lies on the ground."""


class Outside(Protocol):
    """External inputs of the vehicle, one value per GRID_S each, as in the scenario."""

    @property
    def hand_rad(self) -> FloatArray: ...
    @property
    def held(self) -> npt.NDArray[np.bool_]: ...
    @property
    def command_mps(self) -> FloatArray: ...
    @property
    def push_mps2(self) -> FloatArray: ...
    @property
    def disturbance(self) -> FloatArray: ...


class Vehicle:
    """One run of the vehicle in steps of GRID_S; accelerations are those of the last step.

    After the end of the scenario, commands, pushes and disturbances repeat.
    """

    def __init__(self, scenario: Outside, *, open_loop: bool) -> None:
        self._ideal = open_loop
        self._hand = scenario.hand_rad.tolist()
        self._held = scenario.held.tolist()
        self._command = scenario.command_mps.tolist()
        self._push = scenario.push_mps2.tolist()
        self._noise = scenario.disturbance.tolist()
        self._disturbance = 0.0
        self.step = 0
        self.tilt_rad, self.rate_radps, self.turning_radps2 = self._hand[0], 0.0, 0.0
        self.way_m, self.velocity_mps, self.accel_mps2 = 0.0, 0.0, 0.0

    def advance(self, duty: float | None) -> None:
        """One step of GRID_S at this duty, -1..1, or with the bridge open (None), with the scenario's pushes."""
        at = self.step % len(self._noise)
        self.step += 1
        keep = 1.0 - GRID_S / DISTURBANCE_TAU_S
        self._disturbance = keep * self._disturbance + DISTURBANCE_RADPS2_PER_RTS * math.sqrt(GRID_S) * self._noise[at]
        if self._held[at]:
            self._follow_hand(at)
            return
        kick = PUSH_RADPS2_PER_MPS2 * self._push[at] + self._disturbance
        if self._ideal:
            self._prescribe(self._command[at], kick)
        else:
            self._drive(duty, kick)
        self.rate_radps += self.turning_radps2 * GRID_S
        self.tilt_rad += self.rate_radps * GRID_S
        self.velocity_mps += self.accel_mps2 * GRID_S
        self.way_m += self.velocity_mps * GRID_S
        if abs(self.tilt_rad) > LIE_RAD:
            self.tilt_rad, self.rate_radps = math.copysign(LIE_RAD, self.tilt_rad), 0.0

    def force_g(self) -> tuple[float, float]:
        """Specific force at the sensors, forward and up along the body."""
        sine, cosine = math.sin(self.tilt_rad), math.cos(self.tilt_rad)
        square = self.rate_radps * self.rate_radps
        along = self.accel_mps2 + SENSOR_HEIGHT_M * (self.turning_radps2 * cosine - square * sine)
        up = GRAVITY_MPS2 - SENSOR_HEIGHT_M * (self.turning_radps2 * sine + square * cosine)
        return (along * cosine - up * sine) / GRAVITY_MPS2, (along * sine + up * cosine) / GRAVITY_MPS2

    def rolled_edges(self) -> float:
        """Angle of the wheel against the body in Hall edges; a Hall sensor changes at every whole number."""
        return float(self.way_m - WHEEL_RADIUS_M * self.tilt_rad) / EDGE_M

    def hall_edges(self) -> int:
        """Edges so far, signed."""
        return math.floor(self.rolled_edges())

    def _follow_hand(self, at: int) -> None:
        """The hand forces the scenario's tilt; the wheels stand."""
        before, now, after = (self._hand[max(0, min(at + i, len(self._hand) - 1))] for i in (0, 1, 2))
        self.tilt_rad = now
        self.rate_radps = (after - before) / (2.0 * GRID_S)
        self.turning_radps2 = (after - 2.0 * now + before) / GRID_S**2
        self.velocity_mps = self.accel_mps2 = 0.0

    def _prescribe(self, command_mps: float, kick_radps2: float) -> None:
        wanted = (
            IDEAL_PER_RAD * self.tilt_rad
            + IDEAL_PER_RADPS * self.rate_radps
            + IDEAL_PER_MPS * (self.velocity_mps - command_mps)
        )
        accel = min(max(wanted, -IDEAL_LIMIT_MPS2), IDEAL_LIMIT_MPS2)
        fall = GRAVITY_MPS2 * math.sin(self.tilt_rad) - accel * math.cos(self.tilt_rad)
        self.accel_mps2, self.turning_radps2 = accel, fall / PENDULUM_M + kick_radps2

    def _drive(self, duty: float | None, kick_radps2: float) -> None:
        spin = self.velocity_mps / WHEEL_RADIUS_M - self.rate_radps
        pull = 0.0 if duty is None else STALL_NM * (duty - spin / NO_LOAD_RADPS)
        torque = pull - FRICTION_NM * math.tanh(spin / 0.5)
        sine, cosine = math.sin(self.tilt_rad), math.cos(self.tilt_rad)
        moment = BODY_KG * BODY_CENTRE_M
        inertia = moment * PENDULUM_M
        mass = WHEELS_KG + WHEELS_KGM2 / WHEEL_RADIUS_M**2 + BODY_KG
        coupling = moment * cosine
        along = moment * sine * self.rate_radps**2 + torque / WHEEL_RADIUS_M
        about = moment * GRAVITY_MPS2 * sine - torque + inertia * kick_radps2
        determinant = mass * inertia - coupling * coupling
        self.accel_mps2 = (inertia * along - coupling * about) / determinant
        self.turning_radps2 = (mass * about - coupling * along) / determinant
