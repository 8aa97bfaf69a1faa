"""Dynamics of the vehicle: a body with a rider on two wheels that may slip, on a plane that may slope.

theta: tilt forward, from the vertical; v: speed of the axle along the plane; omega: turn rate; w: spin of a wheel; F:
force of the ground on it; beta: slope along the heading; c = theta + angle of the shifted centre of mass.

    M v' + m l cos(c + beta) theta'' = F_l + F_r - M g sin beta + m l sin(c + beta) theta'^2
    m l cos(c + beta) v' + I theta'' = m l g sin c - torque_l - torque_r + I (pushes) + I omega^2 sin c cos c
    I_z omega' = (F_r - F_l) track / 2,   I_w w' = torque - r F of each wheel
    torque = stall limited(supply duty - (w - theta') / no_load) - friction tanh((w - theta') / 0.5)

F is what lets the wheel roll at the end of a step, at most friction times load: Coulomb's law, solved for both wheels
together. The load moves to the outer wheel in a turn. Sideways the wheels hold; a slope is driven up and down.

The vehicle without its parts is that of `balancer` (plumb.systems.balancer.vehicle). Assumed: rider 0.4 kg at 0.18 m
above the axle, body 0.8 kg at 0.09 m, which together are the mass, centre and inertia of `balancer`; track 0.20 m,
inertia about the vertical 0.006 kg m^2; friction 0.8 (rubber on dry concrete, 0.6 to 0.85); encoders of 11 pulses and
four edges behind a gear of 30; a driver that does nothing below 2 % of duty and limits its current to 3 A (TB6612: peak
3.2 A) of the motor's 3.25 A at standstill and 7.4 V.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from plumb.systems.balancer import vehicle as one_motor

GRID_S = one_motor.GRID_S
G_MPS2, RADIUS_M = one_motor.GRAVITY_MPS2, one_motor.WHEEL_RADIUS_M
SENSOR_M, LIE_RAD = one_motor.SENSOR_HEIGHT_M, one_motor.LIE_RAD
WHEEL_KGM2 = one_motor.WHEELS_KGM2 / 2.0
TRACK_M, UPRIGHT_KGM2 = 0.20, 0.006
RIDER_KG, RIDER_M, BODY_KG, BODY_M = 0.4, 0.18, 0.8, 0.09
BODY_KGM2 = one_motor.BODY_KG * one_motor.BODY_CENTRE_M * one_motor.PENDULUM_M - RIDER_KG * RIDER_M**2
"""Of the body about the axle, without its rider."""
STALL_NM, NO_LOAD_RADPS, FRICTION_NM = one_motor.STALL_NM / 2.0, one_motor.NO_LOAD_RADPS, one_motor.FRICTION_NM / 2.0
"""Of each motor."""
DEAD, CURRENT_SHARE = 0.02, 3.0 / 3.25
"""Duty below which the driver does nothing; limit of its current by the motor's at standstill."""
GRIP = 0.8
KERB_NPM, KERB_NSPM = 4e4, 250.0
"""Tyre against a kerb: a stop takes some 20 ms, and hardly bounces."""
CARRY_PER_S2, CARRY_PER_S = 100.0, 20.0
"""Hands that hold the body: within some 0.2 s."""
COUNTS_PER_TURN = 11 * 4 * 30
COUNT_M = 2.0 * math.pi * RADIUS_M / COUNTS_PER_TURN
IDEAL_TURN = 0.004
"""Duty by error of the turn rate in deg/s, of the ideal controller."""


class Load(NamedTuple):
    """Body with or without its rider: mass, moment and inertia about the axle, angle of its centre."""

    kg: float
    kgm: float
    kgm2: float
    ahead_rad: float


def load(shift_m: float, *, ridden: bool) -> Load:
    """shift_m: of the centre of rider and body together."""
    body_kgm = BODY_KG * BODY_M
    if not ridden:
        return Load(BODY_KG, body_kgm, BODY_KGM2, 0.0)
    kg, kgm = BODY_KG + RIDER_KG, body_kgm + RIDER_KG * RIDER_M
    ahead = kg * shift_m
    more_kgm2 = RIDER_KG * (ahead / RIDER_KG) ** 2
    return Load(kg, math.hypot(kgm, ahead), BODY_KGM2 + RIDER_KG * RIDER_M**2 + more_kgm2, math.atan2(ahead, kgm))


class Kerb(NamedTuple):
    """A kerb in the way: where, and on which side of the vehicle, 1 ahead or -1 behind."""

    way_m: float
    side: float


class Outside(NamedTuple):
    """What acts on the vehicle in a step of GRID_S. push_radps2: pushes and rough ground; grip: of each wheel;
    lifted_deg: tilt at which hands hold it in the air."""

    push_radps2: float
    grip: tuple[float, float]
    ridden: bool
    held: bool
    kerb: Kerb | None = None
    lifted_deg: float | None = None


def motor_nm(duty: float | None, spin_radps: float, supply: float) -> float:
    """Torque of one motor on its wheel; None: the driver is off, the motor coasts."""
    pull = 0.0
    if duty is not None:
        share = (supply * duty if abs(duty) >= DEAD else 0.0) - spin_radps / NO_LOAD_RADPS
        pull = STALL_NM * min(max(share, -CURRENT_SHARE), CURRENT_SHARE)
    return pull - FRICTION_NM * math.tanh(spin_radps / 0.5)


class Vehicle:
    """One vehicle in steps of GRID_S; accelerations are those of the last step. supply: battery by its nominal voltage.
    rolled_rad: of the wheels against the body, left and right."""

    def __init__(self, slope_deg: float, shift_m: float, supply: float) -> None:
        self._slope_rad, self._supply = math.radians(slope_deg), supply
        self._loads = {ridden: load(shift_m, ridden=ridden) for ridden in (False, True)}
        self.tilt_rad = self.rate_radps = self.turning_radps2 = 0.0
        self.velocity_mps = self.accel_mps2 = self.turn_radps = self.heading_rad = 0.0
        self.spin_radps, self.rolled_rad = [0.0, 0.0], [0.0, 0.0]
        self.way_m, self.place_m = 0.0, [0.0, 0.0]

    def slope_rad(self) -> float:
        """Of the plane, along the heading."""
        return math.asin(math.sin(self._slope_rad) * math.cos(self.heading_rad)) if self._slope_rad else 0.0

    def advance(self, duties: tuple[float | None, float | None], now: Outside) -> None:
        """One step with these duties, -1..1 each."""
        if now.held:
            self.tilt_rad = self.rate_radps = self.turning_radps2 = 0.0
            self.velocity_mps = self.accel_mps2 = self.turn_radps = 0.0
            self.spin_radps = [0.0, 0.0]
            return
        torque = [
            motor_nm(duty, w - self.rate_radps, self._supply) for duty, w in zip(duties, self.spin_radps, strict=True)
        ]
        if now.lifted_deg is not None:
            self._carry(torque, math.radians(now.lifted_deg))
            return
        along, about, coupling, mass, inertia = self._forces(torque, now)
        force = self._grip(torque, (along, about, coupling, mass, inertia), now)
        along += force[0] + force[1]
        determinant = mass * inertia - coupling * coupling
        self.accel_mps2 = (inertia * along - coupling * about) / determinant
        self.turning_radps2 = (mass * about - coupling * along) / determinant
        self._move(torque, force)

    def _forces(self, torque: list[float], now: Outside) -> tuple[float, float, float, float, float]:
        """Right sides of both equations without the ground's forces, coupling, mass and inertia."""
        body = self._loads[now.ridden]
        centre = self.tilt_rad + body.ahead_rad
        slope = self.slope_rad()
        mass = one_motor.WHEELS_KG + body.kg
        whirled = self.rate_radps * self.rate_radps
        along = body.kgm * math.sin(centre + slope) * whirled - mass * G_MPS2 * math.sin(slope)
        about = body.kgm * G_MPS2 * math.sin(centre) - torque[0] - torque[1] + body.kgm2 * (
            now.push_radps2 + self.turn_radps * self.turn_radps * math.sin(centre) * math.cos(centre)
        )  # fmt: skip
        if now.kerb is not None:
            along += self._kerb_n(now.kerb)
        return along, about, body.kgm * math.cos(centre + slope), mass, body.kgm2

    def _kerb_n(self, kerb: Kerb) -> float:
        """Force of a kerb on the axle, along the way: it pushes, and never pulls."""
        depth_m = (self.way_m - kerb.way_m) * kerb.side
        if depth_m <= 0.0:
            return 0.0
        pressed = KERB_NPM * depth_m + KERB_NSPM * (self.velocity_mps * kerb.side)
        return -kerb.side * max(pressed, 0.0)

    def _carry(self, torque: list[float], lifted_rad: float) -> None:
        """One step in the air: hands hold the body, the wheels turn freely."""
        self.turning_radps2 = CARRY_PER_S2 * (lifted_rad - self.tilt_rad) - CARRY_PER_S * self.rate_radps
        self.accel_mps2 = -CARRY_PER_S * self.velocity_mps
        self.turn_radps -= CARRY_PER_S * self.turn_radps * GRID_S
        self._move(torque, (0.0, 0.0))

    def _grip(
        self, torque: list[float], terms: tuple[float, float, float, float, float], now: Outside
    ) -> tuple[float, float]:
        """Forces of the ground that let both wheels roll after the step, or as much as the ground gives."""
        along, about, coupling, mass, inertia = terms
        determinant = mass * inertia - coupling * coupling
        free, given = (inertia * along - coupling * about) / determinant, inertia / determinant
        half = TRACK_M / 2.0
        turned = half * half / UPRIGHT_KGM2
        own, other = RADIUS_M * RADIUS_M / WHEEL_KGM2 + given + turned, given - turned
        slip = [
            RADIUS_M * w - self.velocity_mps - side * half * self.turn_radps
            for w, side in zip(self.spin_radps, (-1.0, 1.0), strict=True)
        ]
        left, right = (s / GRID_S + RADIUS_M * t / WHEEL_KGM2 - free for s, t in zip(slip, torque, strict=True))
        weight = mass * G_MPS2 * math.cos(self.slope_rad()) / 2.0
        moved = mass * self.velocity_mps * self.turn_radps * (RADIUS_M + coupling / mass) / TRACK_M
        most_left, most_right = (
            grip * max(weight + side * moved, 0.0) for grip, side in zip(now.grip, (-1.0, 1.0), strict=True)
        )
        square = own * own - other * other
        force_left, force_right = (own * left - other * right) / square, (own * right - other * left) / square
        if abs(force_left) > most_left:
            force_left = math.copysign(most_left, force_left)
            force_right = (right - other * force_left) / own
        if abs(force_right) > most_right:
            force_right = math.copysign(most_right, force_right)
            force_left = (left - other * force_right) / own
        return min(max(force_left, -most_left), most_left), min(max(force_right, -most_right), most_right)

    def _move(self, torque: list[float], force: tuple[float, float]) -> None:
        self.rate_radps += self.turning_radps2 * GRID_S
        self.tilt_rad += self.rate_radps * GRID_S
        self.velocity_mps += self.accel_mps2 * GRID_S
        self.turn_radps += (force[1] - force[0]) * TRACK_M / 2.0 / UPRIGHT_KGM2 * GRID_S
        self.heading_rad += self.turn_radps * GRID_S
        for side in (0, 1):
            self.spin_radps[side] += (torque[side] - RADIUS_M * force[side]) / WHEEL_KGM2 * GRID_S
            self.rolled_rad[side] += (self.spin_radps[side] - self.rate_radps) * GRID_S
        self.way_m += self.velocity_mps * GRID_S
        self.place_m[0] += math.cos(self.heading_rad) * self.velocity_mps * GRID_S
        self.place_m[1] += math.sin(self.heading_rad) * self.velocity_mps * GRID_S
        if abs(self.tilt_rad) > LIE_RAD:  # the body lies, and drags
            self.tilt_rad, self.rate_radps = math.copysign(LIE_RAD, self.tilt_rad), 0.0
            self.velocity_mps *= 0.99
            self.turn_radps *= 0.99

    def ideal(self, asked_mps: float, asked_dps: float) -> tuple[float, float]:
        """Duties of a controller that knows the state: the acceleration of balancer's, and a share of the turn rate."""
        wanted = (
            one_motor.IDEAL_PER_RAD * self.tilt_rad
            + one_motor.IDEAL_PER_RADPS * self.rate_radps
            + one_motor.IDEAL_PER_MPS * (self.velocity_mps - asked_mps)
        )
        accel = min(max(wanted, -one_motor.IDEAL_LIMIT_MPS2), one_motor.IDEAL_LIMIT_MPS2)
        along, about, coupling, mass, inertia = self._forces([0.0, 0.0], Outside(0.0, (GRIP, GRIP), True, False))
        rolling = mass + 2.0 * WHEEL_KGM2 / RADIUS_M**2
        torque = (rolling * accel + coupling * (about - coupling * accel) / inertia - along) / (
            1.0 / RADIUS_M + coupling / inertia
        )
        spin = self.velocity_mps / RADIUS_M - self.rate_radps
        duty = torque / 2.0 / STALL_NM + spin / NO_LOAD_RADPS
        turn = IDEAL_TURN * (asked_dps - math.degrees(self.turn_radps))
        return min(max(duty - turn, -1.0), 1.0), min(max(duty + turn, -1.0), 1.0)

    def force_g(self) -> tuple[float, float, float]:
        """Specific force at the sensors, in body axes: forward, to the left, up."""
        sine, cosine, square = math.sin(self.tilt_rad), math.cos(self.tilt_rad), self.rate_radps * self.rate_radps
        slope = self.slope_rad()
        along = self.accel_mps2 * math.cos(slope) + SENSOR_M * (self.turning_radps2 * cosine - square * sine)
        along -= self.turn_radps * self.turn_radps * SENSOR_M * sine
        up = G_MPS2 + self.accel_mps2 * math.sin(slope) - SENSOR_M * (self.turning_radps2 * sine + square * cosine)
        return (
            (along * cosine - up * sine) / G_MPS2,
            self.velocity_mps * self.turn_radps / G_MPS2,
            (along * sine + up * cosine) / G_MPS2,
        )

    def rates_dps(self) -> tuple[float, float, float]:
        """Rates in body axes."""
        return (
            math.degrees(-self.turn_radps * math.sin(self.tilt_rad)),
            math.degrees(self.rate_radps),
            math.degrees(self.turn_radps * math.cos(self.tilt_rad)),
        )

    def counts(self) -> tuple[int, int]:
        """Counts of the encoders so far, left and right."""
        left, right = (math.floor(angle / (2.0 * math.pi) * COUNTS_PER_TURN) for angle in self.rolled_rad)
        return left, right
