"""`quadrotor`: a hummingbird flown as an X, with an MPU-6050, every 2.5 ms, and a pilot with a receiver.

Channels, in the order of the raw counts: gyro x, y, z, acceleration x, y, z, in body axes; then the commands. The
physics and its numbers are those of `plumb.physics.quadrotor`, `airframe`, `imu`, `wind` and `ground`; the flights are
in `courses`. Open loop, an ideal controller flies on the truth, and the words of the rotors move nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from plumb.contract.disturbance import Request
from plumb.contract.scenario import Plant
from plumb.physics.airframe import HUMMINGBIRD_X
from plumb.physics.imu import DRAWS, MPU6050, TWO_CHIPS
from plumb.physics.sensors import DIGITAL_FAULT_KINDS, DIGITAL_FAULT_NOTES, Fault, fault_of
from plumb.systems.attitude.scenarios import TUNINGS as ESTIMATORS
from plumb.systems.quadrotor import courses, random_flights
from plumb.systems.quadrotor.drawn_run import Scenario
from plumb.systems.quadrotor.frame_tuning import rates_of
from plumb.systems.quadrotor.plant import QuadrotorPlant
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import sub_step_us
from plumb.systems.random_events import EVENTS_ALL, EVENTS_NOTE, RANDOM, check_conditions
from plumb.systems.run_length import length_s

PERIOD_US = 2_500
PERIODS_US = (1_000, 5_000)
FRAME = HUMMINGBIRD_X
UNSURE_DEG = 10.0
"""Beyond this standard deviation of the tilt the error of the vertical asks for slow rates alone."""
NOISES, STICKS = 9, 1200

SCENARIOS = {
    **{name: course.title for name, course in courses.COURSES.items()},
    RANDOM: "any frame, pilot, wind and events, drawn from the seed",
}
SECONDS = {**{name: course.seconds for name, course in courses.COURSES.items()}, RANDOM: random_flights.SECONDS}
CONDITIONS = {
    "events": EVENTS_NOTE,
    "plain_frame": "of random: 1 for the hummingbird instead of the drawn frame (default 0)",
}
DEFAULT_SCENARIO, DEFAULT_TUNING = "calm", "hummingbird"
FAULT_CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
FAULTS = DIGITAL_FAULT_NOTES
ESC_PERIOD_US = 2_500
LINK = {"pins": 2, "esc_period_us": ESC_PERIOD_US}

ROLL_ACCEL_RADPS2, YAW_ACCEL_RADPS2 = 383.0, 29.8
"""Angular acceleration by a command of 1, in a hover, as the bring-up page has them: four rotors of 5.58 N each, by the
slope of the thrust curve, on arms of 0.12 m, and their moment of 0.016 m; inertia 0.007 and 0.012 kg m^2."""
SCALE = 0.0069
"""Scale error of the gyro that the filter of `two-chips` expects, as that of `attitude` for those chips."""
REST_DPS = 2.5
"""What counts as rest for `two-chips`: every 2.5 ms an ITG-3205 has a noise of 0.42 deg/s, and at 1.15 deg/s, less than
three times that, no second of 400 samples would be at rest: the bias would be unknown when it takes off."""


ESTIMATOR = replace(
    ESTIMATORS["vehicle"],
    period_us=PERIOD_US,
    gyro=MPU6050.gyro,
    accel=MPU6050.accel,
    motion=replace(ESTIMATORS["vehicle"].motion, unsure_deg=UNSURE_DEG),
    aid=replace(ESTIMATORS["vehicle"].aid, hover=HUMMINGBIRD_X.hover_command),
)
HUMMINGBIRD = QuadrotorTuning(
    period_us=PERIOD_US,
    attitude=ESTIMATOR,
    rates=rates_of(HUMMINGBIRD_X, (ROLL_ACCEL_RADPS2, ROLL_ACCEL_RADPS2, YAW_ACCEL_RADPS2)),
)
TWO_CHIPS_NAME = "two-chips"
TUNINGS = {
    "hummingbird": HUMMINGBIRD,
    TWO_CHIPS_NAME: replace(
        HUMMINGBIRD,
        attitude=replace(
            ESTIMATOR,
            gyro=TWO_CHIPS.gyro,
            accel=TWO_CHIPS.accel,
            errors=replace(ESTIMATOR.errors, scale=SCALE, noise_dps=TWO_CHIPS.gyro_noise_dps),
            rest=replace(ESTIMATOR.rest, gyro_dps=REST_DPS),
        ),
    ),
}
TUNING_NOTES = {
    "hummingbird": "RotorS hummingbird, 0.716 kg, with an MPU-6050",
    TWO_CHIPS_NAME: "the same with an ADXL345 and an ITG-3205",
}
SENSOR_LINKS = {"hummingbird": courses.MPU6050_LINK, TWO_CHIPS_NAME: courses.TWO_CHIPS_LINK}
TUNING_FOR = {TWO_CHIPS_NAME: TWO_CHIPS_NAME}


def faults(requests: Sequence[Request]) -> tuple[Fault, ...]:
    """Faults for `scenario`; raises UsageError for an unknown kind or channel."""
    return tuple(fault_of(asked, FAULT_CHANNELS, DIGITAL_FAULT_KINDS) for asked in requests)


def plant(scenario: Scenario, *, open_loop: bool = False) -> Plant:
    """The vehicle of a run."""
    return QuadrotorPlant(scenario, open_loop=open_loop)


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[Fault, ...] = (),
    events: float = EVENTS_ALL,
    plain_frame: float = 0.0,
) -> Scenario:
    """Draw a run. One generator per seed, in this order:

    errors of the sensors (18), headings of nose and wind (2), phases of the rotors (4), gusts at the start (5), sticks
    (1200, 2), noise (steps, 9), fault noise (6, steps). When the events come: plumb.systems.random_events.later_s.
    """
    sub_step_us(period_us)
    seconds = length_s("quadrotor", name, SECONDS, seconds, period_us, PERIODS_US, seed)
    flown = _drawn(name, seed, round(seconds * 1e6 / period_us), period_us, faults)
    check_conditions(name, events, plain_frame)
    if name != RANDOM:
        return flown
    flight = random_flights.drawn(seed)
    course, lying = random_flights.kept(flight, int(events))
    frame = FRAME if plain_frame else flight.frame
    return replace(
        flown, course=course, frame=frame, faults=(*lying, *faults), lands=flight.lands, events=len(flight.events)
    )


@lru_cache(maxsize=64)
def _drawn(name: str, seed: int, steps: int, period_us: int, faults: tuple[Fault, ...]) -> Scenario:
    """Cached: the prescribed flight of a run is part of it."""
    course = courses.CALM if name == RANDOM else courses.drawn(name, seed)
    rng = np.random.default_rng(seed)
    imu = rng.standard_normal(DRAWS)
    heading, wind = rng.uniform(0.0, 2.0 * np.pi, 2)
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    gusts = rng.standard_normal(5)
    sticks = rng.uniform(-1.0, 1.0, (STICKS, 2))
    noise = rng.standard_normal((steps, NOISES))
    fault_noise = rng.standard_normal((len(FAULT_CHANNELS), steps))
    return Scenario(
        name, seed, period_us, course, FRAME, imu, np.array(heading), np.array(wind), phase, gusts, sticks, noise,
        fault_noise, faults,
    )  # fmt: skip
