"""`wheels` ridden by hand: its vehicle on rough ground, what may happen to it, and how it is drawn.

A hand holds the vehicle upright while its motors rest, and lets go when they turn. One that falls lies where it fell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from plumb.physics import imu
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer import vehicle as one_motor
from plumb.systems.balancer.scenarios import PUSH_S
from plumb.systems.steered import Controls, Drawing, Event, Quaternion, Reading, Seen, Shape
from plumb.systems.wheels import rides, scenarios
from plumb.systems.wheels.fixed_state import RIDDEN, STOPPED, STOPPING
from plumb.systems.wheels.plant import TAKEN, Duties, WheelsPlant
from plumb.systems.wheels.vehicle import GRID_S, GRIP, RADIUS_M, TRACK_M, Outside

TUNING, IMU = scenarios.STEERED, imu.MPU6050
FRAMES = ("WHEELS_DRIVE", "WHEELS_TURN", "WHEELS_ANGLE", "WHEELS_LEAN")
ESTIMATED = ("tilt_deg", "turn_rate_dps")
SETTLED_S = 4.0
DRAWN, NOISE_S = "steps-off", 60.0
"""A ride without pushes of its own; its rough ground and the noise of its sensors repeat after this time."""
PUSH_MPS2, WEAK_SHARE = 5.0, 0.4
PUSH, RIDER, ICE, ICY, WEAK, STUCK = "push", "rider", "ice", "icy", "weak", "stuck"
EVENTS = {
    RIDER: Event("Rider off", "the rider has stepped off, and the switch under him is open", 0.0),
    PUSH: Event("Push", f"a push from behind, {PUSH_MPS2:g} m/s^2 for {PUSH_S:g} s", PUSH_S),
    ICE: Event("Ice, left", f"the left wheel is on ice for 2 s: friction {rides.ICE:g} instead of {GRIP:g}", 2.0),
    ICY: Event("Ice, both", f"both wheels are on ice for 1 s: friction {rides.ICE:g} instead of {GRIP:g}", 1.0),
    WEAK: Event("Weak motor", f"the left motor gets {WEAK_SHARE:.0%} of its voltage for 5 s", 5.0),
    STUCK: Event("Stuck sensor", "the gyro repeats its last counts for 0.1 s", 0.1),
}
RESTS_S, CAUGHT_RAD, CAUGHT_MPS = 0.1, math.radians(10.0), 0.2
"""A hand takes the vehicle when its motors have rested for this long, if it is that upright and that slow."""
STANDS_MPS, STANDS_RADPS = 0.3, 1.0
SAMPLES_KEPT = 256
PHASES = {
    STOPPED: "stopped: switched off, or without its rider",
    RIDDEN: "ridden",
    STOPPING: "the rider has left: it comes to rest",
}

BODY, PLATE, POLE, TYRE, SPOKE = "#dfe5ec", "#47535f", "#8794a1", "#2b333c", "#f0902c"
LEGS, COAT, SKIN, FROZEN = "#3d5a80", "#f0902c", "#e8c39e", "#bfe6f7"


def _wheel(motor: int, y_m: float) -> tuple[Shape, ...]:
    wide, hub = 0.024, 0.6 * RADIUS_M
    return (
        Shape("wheel", (RADIUS_M, wide), (0.0, y_m, 0.0), TYRE, motor=motor),
        Shape("box", (2.0 * hub, wide + 0.006, 0.012), (0.0, y_m, 0.0), SPOKE, motor=motor),
        Shape("box", (0.012, wide + 0.006, 2.0 * hub), (0.0, y_m, 0.0), BODY, motor=motor),
    )


def _patch(y_m: float, event: str) -> Shape:
    """The ice under a wheel."""
    return Shape("cylinder", (0.09, 0.002), (0.0, y_m, 0.006 - RADIUS_M), FROZEN, during=event)


def _shapes() -> tuple[Shape, ...]:
    """Plate and battery about the axle, a pole with its bar in front, and a rider whose centre is where the physics has
    it."""
    half = TRACK_M / 2.0
    rider = (
        *(Shape("box", (0.032, 0.032, 0.1), (-0.01, side * 0.028, 0.09), LEGS, without=RIDER) for side in (-1.0, 1.0)),
        Shape("box", (0.055, 0.1, 0.1), (-0.008, 0.0, 0.19), COAT, without=RIDER),
        *(Shape("box", (0.1, 0.022, 0.022), (0.045, side * 0.056, 0.215), COAT, without=RIDER) for side in (-1.0, 1.0)),
        Shape("box", (0.05, 0.05, 0.056), (-0.005, 0.0, 0.272), SKIN, without=RIDER),
        Shape("box", (0.058, 0.058, 0.02), (-0.005, 0.0, 0.302), SPOKE, without=RIDER),
    )
    return (
        Shape("box", (0.13, TRACK_M - 0.04, 0.018), (0.0, 0.0, 0.031), BODY),
        Shape("box", (0.09, TRACK_M - 0.06, 0.04), (0.0, 0.0, 0.0), PLATE),
        Shape("cylinder", (0.006, 0.19), (0.06, 0.0, 0.13), POLE),
        Shape("box", (0.014, 0.15, 0.014), (0.06, 0.0, 0.222), POLE),
        *_wheel(0, half),
        *_wheel(1, -half),
        *rider,
        *(_patch(side * half, event) for side, event in ((1.0, ICE), (1.0, ICY), (-1.0, ICY))),
    )


DRAWING = Drawing(
    _shapes(),
    ("left", "right"),
    (Reading("speed", "m/s"), Reading("turn", "deg/s"), Reading("tilt", "deg")),
    "The ghost leans by the estimated tilt. Its heading is the estimated turn rate, summed up since the motors were "
    "switched on: it drifts, and nothing corrects it. A lean to the side is not estimated, and not drawn.",
    away_m=1.15,
)
CONTROLS = Controls("ride", "motors", "Hold W to drive", event=RIDER)


class Vehicle(WheelsPlant):
    """The vehicle of one ride."""

    def __init__(self, seed: int, period_us: int) -> None:
        drawn = scenarios.scenario(DRAWN, seed, seconds=NOISE_S, period_us=period_us)
        super().__init__(replace(drawn, ride=replace(drawn.ride, leaves=False)))
        self._ends_s: dict[str, float] = {}
        self._share: Duties = (None, None)
        self._rested_s, self._held = math.inf, True
        self._stuck: dict[int, int] = {}
        self._taken: dict[tuple[int, ...], list[int]] = {}

    @property
    def _time_s(self) -> float:
        return self.step * GRID_S

    def happen(self, event: str) -> None:
        endless = EVENTS[event].seconds == 0.0
        if endless and event in self.happening():
            self._ends_s[event] = self._time_s
        else:
            self._ends_s[event] = math.inf if endless else self._time_s + EVENTS[event].seconds

    def happening(self) -> tuple[str, ...]:
        return tuple(event for event, end_s in self._ends_s.items() if self._time_s < end_s)

    def drive_to(self, time_s: float, duties: Duties) -> None:
        left, right = self._share = duties
        moves = bool(left or right)
        self._rested_s = 0.0 if moves else self._rested_s + time_s - self._time_s
        weak = WEAK in self.happening() and left is not None
        super().drive_to(time_s, (WEAK_SHARE * left if weak and left is not None else left, right))

    def outside(self, time_s: float) -> Outside:
        on, vehicle = self.happening(), self.vehicle
        caught = abs(vehicle.tilt_rad) < CAUGHT_RAD and abs(vehicle.velocity_mps) < CAUGHT_MPS
        self._held = self._rested_s > RESTS_S and (self._held or caught)
        push = one_motor.PUSH_RADPS2_PER_MPS2 * PUSH_MPS2 * (PUSH in on)
        slips = ICE in on or ICY in on, ICY in on
        grip = rides.ICE if slips[0] else GRIP, rides.ICE if slips[1] else GRIP
        return Outside(super().outside(time_s).push_radps2 + push, grip, RIDER not in on, self._held)

    def ridden(self, _time_s: float) -> bool:
        return RIDER not in self.happening()

    def six_counts(self, time_s: float) -> list[int]:
        six = super().six_counts(time_s)
        if STUCK in self.happening():
            self._stuck = self._stuck or dict(enumerate(six[:3]))
        else:
            self._stuck = {}
        six = [self._stuck.get(place, count) for place, count in enumerate(six)]
        self._taken[tuple(six[place] for place in TAKEN)] = six
        if len(self._taken) > SAMPLES_KEPT:
            del self._taken[next(iter(self._taken))]
        return six

    def sample_of(self, taken: Sequence[int]) -> Sequence[int] | None:
        return self._taken.get(tuple(taken[: len(TAKEN)]))

    def seen(self) -> Seen:
        vehicle = self.vehicle
        (x, y), heading = vehicle.place_m, vehicle.heading_rad
        along = vehicle.velocity_mps
        left, right = (share or 0.0 for share in self._share)
        return Seen(
            (x, y, RADIUS_M),
            (along * math.cos(heading), along * math.sin(heading), 0.0),
            _attitude(heading, vehicle.tilt_rad),
            None,
            (left, right),
            (vehicle.rolled_rad[0], vehicle.rolled_rad[1]),
            (along, math.degrees(vehicle.turn_radps), math.degrees(vehicle.tilt_rad)),
        )

    def at_rest(self) -> bool:
        """It stands, balanced, held or on the ground."""
        return abs(self.vehicle.velocity_mps) < STANDS_MPS and abs(self.vehicle.rate_radps) < STANDS_RADPS


def _attitude(heading_rad: float, tilt_rad: float) -> Quaternion:
    (cz, sz), (cy, sy) = ((math.cos(angle / 2.0), math.sin(angle / 2.0)) for angle in (heading_rad, tilt_rad))
    return cz * cy, -sz * sy, cz * sy, sz * cy


class Estimate:
    """The estimated tilt, and the turn rate summed up to a heading; a step whose frame is lost turns as the last."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._heading_rad, self._newest = period_s, 0.0, (math.nan, 0.0)

    def follow(self, values: FloatArray) -> Quaternion | None:
        for tilt_deg, turn_dps in values.tolist():
            before_deg, before_dps = self._newest
            self._newest = (
                tilt_deg if math.isfinite(tilt_deg) else before_deg,
                turn_dps if math.isfinite(turn_dps) else before_dps,
            )
            self._heading_rad += math.radians(self._newest[1]) * self._period_s
        tilt_deg = self._newest[0]
        return _attitude(self._heading_rad, math.radians(tilt_deg)) if math.isfinite(tilt_deg) else None


def estimate(period_s: float) -> Estimate:
    return Estimate(period_s)


def vehicle(seed: int, /, *, period_us: int = TUNING.period_us) -> Vehicle:
    return Vehicle(seed, period_us)


def said(newest: Mapping[str, float], receiving: bool) -> str:
    phase = int(newest.get("phase", STOPPED))
    text = PHASES.get(phase, f"phase {phase}")
    return text if receiving or phase != RIDDEN else "no receiver: it stands"
