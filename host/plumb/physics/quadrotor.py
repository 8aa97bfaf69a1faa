"""A quadrotor in six degrees of freedom, many runs at once: every array has the runs as its last axis.

Earth axes: z up. The accelerometer measures thrust, drag, contact and vibration divided by mass, but not gravity. Steps
are semi-implicit; the attitude turns exactly by the rate of a step.

Assumed in addition to the numbers of the airframe: ESCs that act after a delay which the caller applies, full thrust
that sags with the battery (`supply`), and an unbalance of each rotor that shakes the body in the plane of the rotors at
the rotor's speed, by vibration_g in a hover and with the square of the speed.
"""

from __future__ import annotations

import math

import numpy as np

from plumb.physics.airframe import AIR_KGPM3, G_MPS2, Airframe, thrust_share
from plumb.physics.elementary import cosine, sine
from plumb.physics.ground import Ground
from plumb.physics.vectors import cross, length, to_body, to_earth, total
from plumb.spec.arrays import FloatArray

TINY_RAD = 1e-9


def matrix_of(q: FloatArray) -> FloatArray:
    """Rotation matrices of quaternions (4, runs), from body to earth, (3, 3, runs)."""
    w, x, y, z = q
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    found = np.empty((3, 3, q.shape[1]))
    found[0, 0], found[0, 1], found[0, 2] = 1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)
    found[1, 0], found[1, 1], found[1, 2] = 2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)
    found[2, 0], found[2, 1], found[2, 2] = 2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)
    return found


class Quadrotor:
    """The bodies of all runs. position_m, velocity_mps: earth axes; attitude: quaternions; rate_radps: body axes;
    rotor_radps: (4, runs); vibration_g: of each rotor in a hover; pressed_n: force of the ground along its normal in
    the last step, (runs,)."""

    def __init__(self, frame: Airframe, attitude: FloatArray, position_m: FloatArray, vibration_g: float = 0.3) -> None:
        runs = attitude.shape[1]
        self.frame, self.attitude, self.position_m = frame, attitude.copy(), position_m.copy()
        self.velocity_mps, self.rate_radps = np.zeros((3, runs)), np.zeros((3, runs))
        self.rotor_radps, self._phase = np.zeros((4, runs)), np.zeros((4, runs))
        self.matrix = matrix_of(self.attitude)
        self.thrust_factor = np.ones((4, 1))
        self.vibration_g, self.pressed_n = vibration_g, np.zeros(runs)
        self._torques, self._inertia = frame.allocation()[1:], np.array(frame.inertia_kgm2)[:, None]

    def spin_up(self, radps: float, phase_rad: FloatArray | float = 0.0) -> None:
        """Set the speed of all rotors at once. phase_rad: angle of their unbalance, (4, runs)."""
        self.rotor_radps[:] = radps
        self._phase[:] = phase_rad

    def target_radps(self, command: FloatArray, supply: FloatArray | float = 1.0) -> FloatArray:
        """Steady speed of the rotors with commands of 0 to 1, (4, runs); supply: share of the full thrust."""
        share = thrust_share(np.clip(command, 0.0, 1.0)) * supply
        return np.asarray(self.frame.speed_max_radps * np.sqrt(share))

    def advance(
        self, target_radps: FloatArray, wind_mps: FloatArray | float, step_s: float, ground: Ground | None = None
    ) -> FloatArray:
        """One step; returns the mean reading of an accelerometer in the centre, m/s^2, body axes."""
        frame, rotor, matrix = self.frame, self.rotor_radps, self.matrix
        rises, falls = (-math.expm1(-step_s / lag_s) for lag_s in (frame.lag_up_s, frame.lag_down_s))
        rotor += (target_radps - rotor) * np.where(target_radps > rotor, rises, falls)
        thrust_n = frame.thrust_ns2 * self.thrust_factor * rotor * rotor
        spun = total(rotor)
        air_mps = to_body(matrix, self.velocity_mps - wind_mps)
        speed = length(air_mps)
        force = (-0.5 * AIR_KGPM3 * frame.drag_area_m2) * speed * air_mps
        torque = np.stack([total(arms[:, None] * thrust_n) for arms in self._torques])
        torque[0] -= frame.drag_above_m * force[1]
        torque[1] += frame.drag_above_m * force[0]
        torque[:2] -= frame.rolling_moment_kgm * spun * air_mps[:2]
        force[:2] -= frame.rotor_drag_kg * spun * air_mps[:2]
        force[2] += total(thrust_n)
        if ground is not None:
            pushed, turned = ground.contact(self.position_m, self.velocity_mps, matrix, self.rate_radps)
            force += to_body(matrix, pushed)
            torque += turned
            self.pressed_n = total(ground.normal[:, None] * pushed)
        felt = force / frame.mass_kg
        momentum = self._inertia * self.rate_radps
        self.rate_radps += step_s / self._inertia * (torque - cross(self.rate_radps, momentum))
        gained = to_earth(matrix, felt)
        gained[2] -= G_MPS2
        self.velocity_mps += step_s * gained
        self.position_m += step_s * self.velocity_mps
        self._turn(step_s)
        return np.asarray(felt + self._shaken(step_s))

    def _turn(self, step_s: float) -> None:
        half = self.rate_radps * (step_s / 2.0)
        angle = length(half) + TINY_RAD
        (x, y, z), c = half * (sine(angle) / angle), cosine(angle)
        w, i, j, k = self.attitude
        turned = np.stack([
            w * c - i * x - j * y - k * z,
            w * x + i * c + j * z - k * y,
            w * y - i * z + j * c + k * x,
            w * z + i * y - j * x + k * c,
        ])  # fmt: skip
        self.attitude = turned / length(turned)
        self.matrix = matrix_of(self.attitude)

    def _shaken(self, step_s: float) -> FloatArray:
        """Mean of the vibration over a step, m/s^2."""
        turned = self.rotor_radps * step_s
        begin, self._phase = self._phase, np.mod(self._phase + turned, 2.0 * np.pi)
        half = turned / 2.0
        mean = np.where(half == 0.0, 1.0, sine(half) / np.where(half == 0.0, 1.0, half))
        size = self.vibration_g * G_MPS2 / self.frame.hover_radps**2 * (self.rotor_radps * self.rotor_radps) * mean
        middle = begin + half
        zero = np.zeros(turned.shape[1])
        return np.stack([total(size * cosine(middle)), total(size * sine(middle)), zero])
