"""`wheels`: a two-wheeled vehicle that steers, with an MPU-6050 and two encoders, every 5 ms.

Channels, in the order of the raw counts: gyro about the axle, acceleration forward and up, gyro up, counts of the left
and the right encoder, the rider's switch; then the commands. The physics and its numbers are in `vehicle`, the rides in
`rides`. Pushes and rough ground are those that `balancer` prescribes. Open loop, an ideal controller drives on the
truth, and the words of the duties move nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from plumb.contract.disturbance import Request
from plumb.contract.scenario import Plant
from plumb.physics.imu import DRAWS, MPU6050
from plumb.physics.sensors import FAULT_NOTES, Fault, fault_of
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Calibration, Channel, Kalman, Pid, Start, Trust
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer import vehicle as one_motor
from plumb.systems.balancer.settings import Drive, SpeedLoop, Wheel
from plumb.systems.balancer.tuning import BalancerTuning
from plumb.systems.random_events import EVENTS_ALL, EVENTS_NOTE, RANDOM, check_conditions
from plumb.systems.run_length import length_s
from plumb.systems.wheels import random_rides, rides
from plumb.systems.wheels.drawn_run import Scenario
from plumb.systems.wheels.plant import SPEED_MAX_MPS, TURN_MAX_DPS, WheelsPlant, prescribed
from plumb.systems.wheels.settings import Turning
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.systems.wheels.vehicle import COUNT_M, GRID_S, TRACK_M

PERIOD_US = 5_000
LINK = {"pins": 3, "accel_bus": 2}
"""Drivers and encoders of two wheels; an MPU-6050."""
PERIODS_US = (2_000, 10_000)
SCENARIOS = {
    **{name: ride.title for name, ride in rides.RIDES.items()},
    RANDOM: "any speeds, turns, slope and events, drawn from the seed",
}
SECONDS = {**{name: ride.seconds for name, ride in rides.RIDES.items()}, RANDOM: random_rides.SECONDS}
RANDOM_BASE = replace(rides.LEVEL, pushes=False)
"""What random changes."""
CONDITIONS = {
    "events": EVENTS_NOTE,
    "plain_frame": "of random: 1 for level ground and a rider in the middle (default 0)",
}
DEFAULT_SCENARIO, DEFAULT_TUNING = "level", "steered"
FAULT_CHANNELS = ("gyro", "accel_x", "accel_z", "gyro_up", "left", "right", "rider")
FAULTS = FAULT_NOTES
VIBRATION_G = 0.1
BATTERY = (0.9, 1.1)
"""Supply by the nominal 7.4 V: two cells from almost empty to almost full (assumed)."""
SPEED_EVERY_S, PUSH_EVERY_S, TOPPLE_RADPS2 = 7.0, 13.0, 150.0

BACKWARD = Channel(0.0, -MPU6050.accel.unit_per_count, MPU6050.accel.min_counts, MPU6050.accel.max_counts)
STEERED = WheelsTuning(
    period_us=PERIOD_US,
    balance=BalancerTuning(
        period_us=PERIOD_US,
        calibration=Calibration(gyro=MPU6050.gyro, accel=BACKWARD, accel_up=MPU6050.accel),
        wheel=Wheel(edge_m=COUNT_M / 2.0, tau_s=0.1),
        trust=Trust(r_deg2=20.0),
        kalman=Kalman(q_angle_deg2_per_s=0.05, q_bias_dps2_per_s=1e-3),
        start=Start(p00_deg2=1.0, p11_dps2=4.0),
        speed=SpeedLoop(lean_deg_per_mps=10.0, lean_deg_per_m=2.0, lean_max_deg=15.0, speed_max_mps=SPEED_MAX_MPS),
        pid=Pid(kp_per_deg=0.08, ki_per_deg_s=0.2, kd_per_dps=0.0044),
        drive=Drive(),
    ),
    turning=Turning(
        count_m=COUNT_M, track_m=TRACK_M, rate_max_dps=TURN_MAX_DPS, kp_per_dps=0.005, ki_per_deg=0.03,
        ff_per_dps=0.0007,
    ),
)  # fmt: skip
TUNINGS = {"steered": STEERED}
TUNING_NOTES = {"steered": "the shipped one"}


def faults(requests: Sequence[Request]) -> tuple[Fault, ...]:
    """Faults for `scenario`; raises UsageError for an unknown kind or channel."""
    return tuple(fault_of(asked, FAULT_CHANNELS) for asked in requests)


def plant(scenario: Scenario, *, open_loop: bool = False) -> Plant:
    """The vehicle of a run."""
    return WheelsPlant(scenario, open_loop=open_loop)


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

    errors of the sensors (18), battery, times of speeds and speeds, times of pushes and pushes, push on
    ice, rough ground (grid), noise of the sensors (steps, 6), vibration (steps, 3), fault noise (7, steps).
    When what else happens comes: plumb.systems.random_events.later_s.
    """
    seconds = length_s("wheels", name, SECONDS, seconds, period_us, PERIODS_US, seed)
    run = _drawn(name, seed, round(seconds * 1e6 / period_us), period_us, faults)
    check_conditions(name, events, plain_frame)
    if name != RANDOM:
        return run
    random = random_rides.drawn(seed)
    ride, lying = random.kept(int(events))
    if plain_frame:
        ride = replace(ride, slope_deg=0.0, shift_m=0.0)
    asked_mps, asked_dps = random.asked(run.time_s)
    return replace(
        run, ride=ride, faults=(*lying, *faults), asked_mps=asked_mps, asked_dps=asked_dps, events=len(random.events)
    )


@lru_cache(maxsize=64)
def _drawn(name: str, seed: int, steps: int, period_us: int, faults: tuple[Fault, ...]) -> Scenario:
    """Cached: the prescribed ride of a run is part of it."""
    ride = RANDOM_BASE if name == RANDOM else rides.drawn(name, seed)
    rng, period_s = np.random.default_rng(seed), period_us * 1e-6
    seconds = steps * period_s
    t, grid_s = np.arange(steps) * period_s, np.arange(round(seconds / GRID_S)) * GRID_S
    imu = rng.standard_normal(DRAWS)
    supply = float(rng.uniform(*BATTERY))
    last_s = max(seconds - 2.0, rides.BEGINS_S)
    speeds, pushes = round(seconds / SPEED_EVERY_S), round(seconds / PUSH_EVERY_S)
    speed_s = np.sort(rng.uniform(rides.BEGINS_S, last_s, speeds))
    speed_mps = np.concatenate([[0.0], rng.uniform(-rides.SPEED_MPS, rides.SPEED_MPS, speeds)])
    push_s = rng.uniform(rides.BEGINS_S + 2.0, max(last_s, rides.BEGINS_S + 2.0), pushes)
    push_mps2 = rng.uniform(-balancer.PUSH_MPS2, balancer.PUSH_MPS2, pushes) * ride.pushes
    ice_mps2 = float(rng.uniform(-rides.ON_ICE_MPS2, rides.ON_ICE_MPS2))
    push = _rough(rng.standard_normal(len(grid_s)) * (grid_s >= balancer.DISTURBED_S))
    for at_s, size in zip(push_s, push_mps2, strict=True):
        push += one_motor.PUSH_RADPS2_PER_MPS2 * size * ((grid_s >= at_s) & (grid_s < at_s + balancer.PUSH_S))
    happens_s, slips_s = ride.happens_s, ride.happens_s + ride.slips_s
    if ride.ice_s:
        slid = one_motor.PUSH_RADPS2_PER_MPS2 * ice_mps2
        push += slid * ((grid_s >= slips_s) & (grid_s < slips_s + balancer.PUSH_S))
    if ride.topples:
        push += TOPPLE_RADPS2 * ((grid_s >= happens_s) & (grid_s < happens_s + balancer.PUSH_S))
    asked_mps = speed_mps[np.searchsorted(speed_s, t, side="right")]
    if ride.speed_mps is not None:
        asked_mps = np.where(t < slips_s, ride.speed_mps, ride.then_mps) * (t >= rides.BEGINS_S)
    turning = np.floor((t - rides.BEGINS_S) / rides.TURN_S) % 4
    asked_dps = rides.TURN_DPS * ((turning == 0).astype(float) - (turning == 2)) * (t >= rides.BEGINS_S) * ride.turns
    white = rng.standard_normal((steps, 6))
    vibration_g = VIBRATION_G * rng.standard_normal((steps, 3)) * (t >= rides.HELD_S)[:, None]
    fault_noise = rng.standard_normal((len(FAULT_CHANNELS), steps))
    return Scenario(
        name, seed, period_us, ride, imu, supply, push, asked_mps, asked_dps, white, vibration_g, fault_noise,
        prescribed, faults,
    )  # fmt: skip


def _rough(white: FloatArray) -> FloatArray:
    """Rough ground as an angular acceleration: white noise behind a first-order lag, as `balancer` has it."""
    keep, new = 1.0 - GRID_S / one_motor.DISTURBANCE_TAU_S, one_motor.DISTURBANCE_RADPS2_PER_RTS * np.sqrt(GRID_S)
    now, found = 0.0, []
    for value in (new * white).tolist():
        now = keep * now + value
        found.append(now)
    return np.array(found)
