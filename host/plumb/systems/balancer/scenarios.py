"""`balancer`: a two-wheel self-balancing vehicle (Zhang and He 2013, Kalman filtering in the attitude detection of a
two-wheel self-balancing vehicle): ADXL345 accelerometer, ITG-3205 gyro and the motor's Hall sensors, every 10 ms.

Channels, in the order of the raw counts: gyro about the axle, acceleration forward, acceleration up, Hall edges.
Upright is tilt 0; positive tilt leans forward, a positive rate increases it, positive edges roll forward. Standing and
leaning forward, the forward axis reads -sin(tilt): its calibration turns the sign, so that the core sees sin(tilt).

Prescribed with the figures: 0.1 or 0.02 g of white vibration, gyro bias +-3 deg/s with a warm-up of 1 deg/s (60 s) and
a walk of 0.003 deg/s/sqrt(s), scale error 1 %, g-sensitivity 0.1 deg/s/g, accelerometer offset 2 mg, commands, pushes
and disturbances. When commands and pushes come, each run draws; `rocked` is moved as in the paper's figures, at their
times. plumb.systems.balancer.vehicle lists the values that the source does not give and that are assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from plumb.contract.disturbance import Request
from plumb.contract.scenario import Plant
from plumb.physics.sensors import FAULT_NOTES, Fault, Push, faults_of
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Calibration, Kalman, Pid, Start, Trust
from plumb.systems.balancer.drawn_run import ACCELEROMETER, CHANNELS, GYRO, Ride, Scenario
from plumb.systems.balancer.plant import BalancerPlant
from plumb.systems.balancer.settings import Drive, SpeedLoop, Wheel
from plumb.systems.balancer.tuning import BalancerTuning
from plumb.systems.balancer.vehicle import EDGE_M, GRID_S, Vehicle
from plumb.systems.run_length import length_s

PERIOD_US = 10_000
LINK = {"pins": 1, "accel_rate": 13, "gyro_filter": 1}
"""Board settings: pins of bridge and Hall sensors; the chips sample at 800 Hz and 1 kHz, so a sample is about 1 ms
old."""
VIBRATION_G = {"rough": 0.1, "smooth": 0.02, "endure": 0.1, "rocked": 0.06}
BIAS_DPS, DRIFT_DPS, DRIFT_TAU_S, WALK_DPS_PER_RTS = 3.0, 1.0, 60.0, 0.003
SCALE_ERROR, OFFSET_G, GYRO_NOISE_DPS = 0.01, 0.002, 0.38
REST_S, DISTURBED_S = 3.0, 5.0
COMMANDS, COMMAND_MPS = 14, 0.6
PUSHES, PUSH_S, PUSH_MPS2 = 8, 0.15, 6.0
"""Commands and pushes of 120 s; longer runs have as many per second."""

SCENARIOS = {
    "rough": "velocity commands and pushes, 0.1 g of vibration",
    "smooth": "the same ride with 0.02 g of vibration",
    "endure": "commands and pushes, 0.1 g of vibration",
    "rocked": "held and rocked by hand (the paper's figures 5 and 6)",
}
PUSHED = ("rough", "push:6@40-40.15")
"""Scenario and push that the system's page shows."""
DEFAULT_SCENARIO, DEFAULT_TUNING = "rough", "tuned"
FAULT_CHANNELS = ("gyro", "accel_x", "accel_z", "hall")
FAULTS = {**FAULT_NOTES, "push": "an acceleration of the axle in m/s^2 more, closed loop, for example push:6@15-15.15"}
SECONDS = {"rough": 120.0, "smooth": 120.0, "endure": 600.0, "rocked": 20.0}

CALIBRATION = Calibration(
    gyro=GYRO.channel(), accel=ACCELEROMETER.channel(forward=False), accel_up=ACCELEROMETER.channel()
)

TUNED = BalancerTuning(
    period_us=PERIOD_US,
    calibration=CALIBRATION,
    wheel=Wheel(edge_m=EDGE_M, tau_s=0.2),
    trust=Trust(r_deg2=14.0),
    kalman=Kalman(q_angle_deg2_per_s=1e-3, q_bias_dps2_per_s=3.5e-4),
    start=Start(p00_deg2=1.0, p11_dps2=9.0),
    speed=SpeedLoop(lean_deg_per_mps=5.0, lean_deg_per_m=0.5, lean_max_deg=8.0, speed_max_mps=1.0),
    pid=Pid(kp_per_deg=0.08, ki_per_deg_s=0.2, kd_per_dps=0.0072),
    drive=Drive(),
)
"""Q of the angle is the gyro's noise. R and Q of the bias are fitted on seeds 0-159: with them the error's spread is
0.5 to 1.4 of the filter's sigma on rough and on smooth roads (examples/studies/balancer_sigma.toml)."""

VIBRATION = Trust(r_deg2=33.0)
"""R of the opponents: the variance of 0.1 g of vibration as an angle."""

# As in the source: the arctangent of the two axes without compensation.
ARCTAN = replace(
    TUNED,
    wheel=replace(TUNED.wheel, accel_share=0.0),
    trust=VIBRATION,
    kalman=Kalman(q_angle_deg2_per_s=1e-3, q_bias_dps2_per_s=1e-3),
)

TUNINGS = {
    "tuned": TUNED,
    "arctan": ARCTAN,
    # Fitted separately on seeds 0-19: the uncompensated acceleration acts as noise, so R is larger and the bias slower.
    "arctan_fitted": replace(
        ARCTAN, trust=Trust(r_deg2=36.0), kalman=Kalman(q_angle_deg2_per_s=1e-3, q_bias_dps2_per_s=5e-4)
    ),
    # The paper's rule: Q of the bias three orders of magnitude below Q of the angle, each added at every step.
    "paper_rule": replace(ARCTAN, kalman=Kalman.per_step(1e-3, 1e-6, PERIOD_US)),
    "paper_rule_wheel": replace(TUNED, trust=VIBRATION, kalman=Kalman.per_step(1e-3, 1e-6, PERIOD_US)),
}
TUNING_NOTES = {
    "tuned": "the axle's acceleration, from the Hall edges, taken off before the arctangent",
    "arctan": "the arctangent of the two axes as the source has it",
    "arctan_fitted": "the same with the R and the Q of the bias that suit it best",
    "paper_rule": "arctan, Q of the bias three orders of magnitude below Q of the angle",
    "paper_rule_wheel": "the same, the axle's acceleration taken off",
}


def faults(requests: Sequence[Request]) -> tuple[Fault | Push, ...]:
    """Faults and pushes for `scenario`; a push is in m/s^2."""
    return faults_of(requests, FAULT_CHANNELS, "m/s^2")


@lru_cache(maxsize=64)
def _ride(name: str, seed: int, seconds: float, period_us: int) -> Ride:
    """The motion of a scenario, cached: scenarios that only differ in their sensors share it."""
    drawn = scenario(name, seed, seconds=seconds, period_us=period_us)
    vehicle = Vehicle(drawn, open_loop=True)
    rows = []
    for time_s in drawn.time_s.tolist():
        while vehicle.step < int(time_s / GRID_S + 1e-6):
            vehicle.advance(0.0)
        rows.append(
            (vehicle.tilt_rad, vehicle.rate_radps, vehicle.velocity_mps, *vehicle.force_g(), vehicle.hall_edges())
        )
    columns = np.array(rows, np.float64).T
    return Ride(
        np.degrees(columns[0]), np.degrees(columns[1]), columns[2], columns[3:5], np.rint(columns[5]).astype(np.int64)
    )


def plant(scenario: Scenario, *, open_loop: bool = False) -> Plant:
    """The vehicle under this run's commands and pushes."""
    return BalancerPlant(scenario, open_loop=open_loop)


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[Fault | Push, ...] = (),
) -> Scenario:
    """Draw a run. One generator per seed, in this order:

    command times, commands, push times, pushes, start bias, drift sign, scale, two offsets, disturbance (grid), bias
    walk (steps), vibration (2, steps), accelerometer noise (2, steps), gyro noise (steps), fault noise (4, steps).
    """
    seconds = length_s("balancer", name, SECONDS, seconds, period_us, (1000, 50_000), seed)
    rng = np.random.default_rng(seed)
    period_s = period_us * 1e-6
    steps, points = round(seconds / period_s), round(seconds / GRID_S)
    t, grid_s = np.arange(steps) * period_s, np.arange(points, dtype=np.float64) * GRID_S

    commands = max(0, round(COMMANDS * (seconds - 16.0) / 104.0))
    command_s = np.sort(rng.uniform(8.0, max(seconds - 8.0, 8.0), commands))
    command_mps = rng.uniform(-COMMAND_MPS, COMMAND_MPS, commands)
    command_mps[3::4] = 0.0
    pushes = max(0, round(PUSHES * (seconds - 15.0) / 105.0))
    push_s = rng.uniform(10.0, max(seconds - 5.0, 10.0), pushes)
    push_mps2 = rng.uniform(-PUSH_MPS2, PUSH_MPS2, pushes)
    start_bias_dps = rng.uniform(-BIAS_DPS, BIAS_DPS)
    drift_dps = rng.choice([-DRIFT_DPS, DRIFT_DPS])
    scale = 1.0 + SCALE_ERROR * rng.standard_normal()
    offset_g = OFFSET_G * rng.standard_normal(2)
    disturbance = rng.standard_normal(points) * (grid_s >= DISTURBED_S)
    walk_dps = np.cumsum(WALK_DPS_PER_RTS * np.sqrt(period_s) * rng.standard_normal(steps))
    vibration_g = VIBRATION_G[name] * rng.standard_normal((2, steps)) * (t >= REST_S)
    accel_noise_lsb = np.array(ACCELEROMETER.noise_lsb)[:, None] * rng.standard_normal((2, steps))
    gyro_noise_dps = GYRO_NOISE_DPS * rng.standard_normal(steps)
    fault_noise = rng.standard_normal((CHANNELS, steps))

    push = np.zeros(points)
    for at_s, size in zip(push_s, push_mps2, strict=True):
        push += size * ((grid_s >= at_s) & (grid_s < at_s + PUSH_S))
    for more in faults:
        if isinstance(more, Push):
            push += more.size * ((grid_s >= more.start_s) & (grid_s < more.stop_s))
    latest = np.searchsorted(command_s, grid_s, side="right")
    by_hand = name == "rocked"
    return Scenario(
        name,
        seed,
        period_us,
        _rocking(grid_s) if by_hand else np.zeros(points),
        np.full(points, True) if by_hand else grid_s < REST_S,
        np.concatenate([[0.0], command_mps])[latest] * (not by_hand),
        push,
        disturbance,
        scale,
        offset_g,
        start_bias_dps + drift_dps * (1.0 - np.exp(-t / DRIFT_TAU_S)) + walk_dps,
        vibration_g,
        accel_noise_lsb,
        gyro_noise_dps,
        fault_noise,
        partial(_ride, name if by_hand else DEFAULT_SCENARIO, seed, points * GRID_S, period_us),
        tuple(fault for fault in faults if isinstance(fault, Fault)),
    )


def _rocking(t: FloatArray) -> FloatArray:
    """Tilt of `rocked` in rad: upright for 5 s, rocked by +-20 deg at 0.4 Hz, held at 10 deg, put upright. Read from
    the paper's figures."""
    ease = np.clip((t - 5.0) / 1.0, 0.0, 1.0) * np.clip((12.5 - t) / 1.0, 0.0, 1.0)
    swing = 20.0 * ease**2 * (3.0 - 2.0 * ease) * np.sin(2.0 * np.pi * 0.4 * (t - 5.0))
    rise, fall = np.clip(t - 13.0, 0.0, 1.0), np.clip(t - 17.0, 0.0, 1.0)
    rest = 10.0 * (rise**2 * (3.0 - 2.0 * rise) - fall**2 * (3.0 - 2.0 * fall))
    return np.asarray(np.radians(swing + rest), np.float64)
