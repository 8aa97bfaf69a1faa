"""`quadrotor` flown by hand: its vehicle on an airfield, what may happen to it, and how it is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from plumb.physics import pilots
from plumb.physics.airframe import command_for
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import courses, scenarios
from plumb.systems.quadrotor.plant import QuadrotorPlant, command_of
from plumb.systems.quadrotor.scenarios import FRAME
from plumb.systems.steered import Controls, Drawing, Event, Quaternion, Reading, Seen, Shape

TUNING = replace(scenarios.HUMMINGBIRD, receiver=replace(scenarios.HUMMINGBIRD.receiver, lands=1))
"""As shipped, but a vehicle that has lost its receiver lands."""
FRAMES = ("QUADROTOR_ROTOR_0", "QUADROTOR_ROTOR_1", "QUADROTOR_ROTOR_2", "QUADROTOR_ROTOR_3", "QUADROTOR_STATE")
ESTIMATED = ("w", "x", "y", "z")
SETTLED_S = courses.REST_S
BREEZE_MPS = 2.0
AIRFIELD = courses.Course("flown by hand", pilots.centred, wind_mps=BREEZE_MPS, lands=True)
IMU = AIRFIELD.grade
NOISE_S = 60.0
"""The noise of sensors and gusts repeats after this time."""
GUST, WEAK, STUCK = "gust", "weak", "stuck"
EVENTS = {
    GUST: Event("Gust", f"{courses.GUST_MPS:g} m/s more wind for 3 s", 3.0),
    WEAK: Event("Weak motor", f"the front right rotor has {courses.WEAK_SHARE:.0%} of its thrust for 5 s", 5.0),
    STUCK: Event("Stuck sensor", "the gyro repeats its last counts for 0.2 s", 0.2),
}
HAPPENINGS = {
    GUST: courses.Happening(courses.GUST, 0.0, size=courses.GUST_MPS),
    WEAK: courses.Happening(courses.WEAK, 0.0, size=1.0 - courses.WEAK_SHARE),
}
"""What an event does as long as it is on."""
STUCK_COUNTS = 3
STILL_MPS, STILL_RADPS = 0.05, 0.05
PHASES = ("flown", "no receiver: held level", "no receiver: landing", "stopped: switch the rotors off")
"""By the word `phase`."""

BODY, SPAR, MOTOR, FRONT, REAR = "#dfe5ec", "#47535f", "#2b333c", "#f0902c", "#7f93a8"
LEG_M = 0.06


def _shapes() -> tuple[Shape, ...]:
    low = -FRAME.leg_down_m / 2.0
    found = [
        Shape("box", (0.14, 0.09, 0.035), (0.0, 0.0, 0.0), BODY),
        Shape("box", (0.04, 0.06, 0.014), (0.055, 0.0, 0.022), FRONT),
    ]
    for motor, ((x, y, z), spin) in enumerate(zip(FRAME.rotors_m, FRAME.spin, strict=True)):
        out, turn = float(np.hypot(x, y)), float(np.arctan2(y, x))
        colour = FRONT if x > 0.0 else REAR
        found += [
            Shape("box", (out, 0.018, 0.012), (x / 2.0, y / 2.0, 0.0), SPAR, turn),
            Shape("cylinder", (0.017, 0.034), (x, y, 0.005), MOTOR),
            Shape("propeller", (0.1, 0.016), (x, y, z + 0.018), colour, motor=motor, spin=spin),
            Shape("cylinder", (0.005, FRAME.leg_down_m), (LEG_M * np.sign(x), LEG_M * np.sign(y), low), SPAR),
        ]
    return tuple(found)


DRAWING = Drawing(
    _shapes(),
    ("front right", "front left", "rear left", "rear right"),
    (Reading("height", "m"), Reading("climb", "m/s"), Reading("speed", "m/s")),
    "The ghost has the estimated attitude. Its heading is the gyro's alone: it begins with the true one when the "
    "rotors are switched on.",
    away_m=1.75,
)
CONTROLS = Controls(
    "flight",
    "rotors",
    "Hold W to climb",
    hover=float(command_for(np.array(FRAME.weight_n / FRAME.thrust_max_n))),
    modes=("level", "rate"),
)


class Vehicle(QuadrotorPlant):
    """The vehicle of one flight."""

    def __init__(self, seed: int, period_us: int) -> None:
        drawn = scenarios.scenario("take-off", seed, seconds=NOISE_S, period_us=period_us)
        super().__init__(replace(drawn, course=AIRFIELD))
        self._ends_s: dict[str, float] = {}
        self._motors: tuple[float, ...] = (0.0,) * len(DRAWING.motors)
        self._held: tuple[int, ...] = ()

    def happen(self, event: str) -> None:
        self._ends_s[event] = self.vehicles.time_s + EVENTS[event].seconds

    def happening(self) -> tuple[str, ...]:
        return tuple(event for event, end_s in self._ends_s.items() if self.vehicles.time_s < end_s)

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        happenings = tuple(HAPPENINGS[event] for event in self.happening() if event in HAPPENINGS)
        if self.vehicles.course.happenings != happenings:
            self.vehicles.course = replace(AIRFIELD, happenings=happenings)
        super().follow(time_s, outputs)
        pulses = np.array(list(outputs.values()) or [0] * len(self._motors))
        self._motors = tuple(command_of(pulses).tolist())

    def counts(self, time_s: float) -> tuple[int, ...]:
        row = super().counts(time_s)
        self._held = (self._held or row[:STUCK_COUNTS]) if STUCK in self.happening() else ()
        return (*self._held, *row[len(self._held) :])

    def seen(self) -> Seen:
        body = self.vehicles.body
        x, y, z = body.position_m[:, 0].tolist()
        vx, vy, vz = body.velocity_mps[:, 0].tolist()
        qw, qx, qy, qz = body.attitude[:, 0].tolist()
        wx, wy, wz = self.vehicles.wind_mps()[:, 0].tolist()
        readings = z, vz, float(np.hypot(vx, vy))
        return Seen((x, y, z), (vx, vy, vz), (qw, qx, qy, qz), (wx, wy, wz), self._motors, (), readings)

    def at_rest(self) -> bool:
        body = self.vehicles.body
        still = np.linalg.norm(body.velocity_mps) < STILL_MPS and np.linalg.norm(body.rate_radps) < STILL_RADPS
        return bool(still) and not any(self._motors)

    def sample_of(self, taken: Sequence[int]) -> Sequence[int]:
        return taken[:6]


class Estimate:
    """The attitude of the newest whole step."""

    def __init__(self) -> None:
        self._newest: Quaternion | None = None

    def follow(self, values: FloatArray) -> Quaternion | None:
        whole = values[np.isfinite(values).all(1)]
        if len(whole):
            w, x, y, z = whole[-1].tolist()
            self._newest = w, x, y, z
        return self._newest


def estimate(_period_s: float) -> Estimate:
    return Estimate()


def vehicle(seed: int, /, *, period_us: int = TUNING.period_us) -> Vehicle:
    return Vehicle(seed, period_us)


def said(newest: Mapping[str, float], _receiving: bool) -> str:
    phase = int(newest.get("phase", 0))
    return PHASES[phase] if 0 <= phase < len(PHASES) else f"phase {phase}"
