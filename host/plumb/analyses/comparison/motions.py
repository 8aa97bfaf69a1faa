"""Prescribed motions that no recording has: bodies that accelerate for long, and that vibrate.

A run takes 60 s: 10 s at rest, the motion, and rest from END_S on. The samples between are scored. Between the points
of a profile speed, yaw rate and bank are linear in time. The body goes where its nose points, heading drawn; the
sensors are mounted aslant by N(10 deg) about two axes.

    arm-N           at the end of an arm of 1 m that turns by N deg/s about the vertical: up within 4 s, and down
    dash-N          to and fro at 3 m/s^2: up to N m/s, on for 6 s, braked to rest, 2 s of rest
    roundabout-R    to 10 m/s within 5 s, 2 s into a circle of R m that lasts until 50 s, 2 s out of it, braked; level
    bank-turn       to 20 m/s within 5 s, within 2 s to a bank of 45 deg in a coordinated turn until 48 s, out, braked
    merry-go-round  at the rim of a platform of 2 m that turns by 60 deg/s about the vertical: up within 4 s, and down
    bias-step       in the hand, turned by 40 deg rms (0.05 to 0.8 Hz) about each axis and shifted by 5 cm rms (0.2 to 2
                    Hz); the bias of the gyro steps, and is scored from there on: when (15 to 25 s), by how much (0.5 to
                    10 deg/s, log-uniform) and whether on one axis or on three is drawn
    bias-step-rest  the same at rest
    vibration-F     in its place but for an acceleration of 5 g at F Hz in a drawn direction, and a rate of 50 deg/s at
                    that frequency about a drawn axis, whose phase is drawn

The sensors, every 2.5 ms, give the mean of what they felt since the sample before, in 16 bits at +-2000 deg/s and
+-16 g: bias 1 deg/s an axis, its sign drawn, scale N(0.5 %), misalignment N(1 mrad), noise 0.005 deg/s/sqrt(Hz);
accelerometer offset N(2 mg) an axis, noise 200 ug/sqrt(Hz). The bias is within the limit of VQF (2 deg/s), but for
most of the steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.samples import SIXTEEN_BITS, Motion, sampled
from plumb.analyses.comparison.table import Input, Trial
from plumb.physics import rotation
from plumb.physics.sensors import band_noise
from plumb.readers.recording import G_MPS2, block_means

FloatArray = npt.NDArray[np.float64]
Generator = np.random.Generator
Course = tuple[FloatArray, FloatArray]
"""Attitudes (4, n) and accelerations in earth axes, m/s^2, (3, n), on the fine grid."""

FIRST_SEED, SEEDS = 1000, 4
PERIOD_S, STEPS_OF_A_PERIOD = 0.0025, 10
GRID_S = PERIOD_S / STEPS_OF_A_PERIOD
SECONDS, BEGIN_S, END_S = 60.0, 10.0, 56.0
LEAN_RAD = np.radians(10.0)
ARM_M, SPIN_UP_S = 1.0, 4.0
DASH_MPS2, CRUISE_S, PAUSE_S = 3.0, 6.0, 2.0
ROUND_MPS, ROUND_UP_S, ROUND_ENTRY_S, ROUND_UNTIL_S = 10.0, 5.0, 2.0, 50.0
BANK_MPS, BANK_DEG, BANK_UP_S, BANK_ENTRY_S, BANK_UNTIL_S = 20.0, 45.0, 5.0, 2.0, 48.0
SHAKE_G, SHAKE_DPS = 5.0, 50.0
MERRY_M, MERRY_DPS = 2.0, 60.0
HAND_DEG, HAND_HZ, SHIFT_M, SHIFT_HZ, FADE_S = 40.0, (0.05, 0.8), 0.05, (0.2, 2.0), 2.0
STEP_S, STEP_DPS = (15.0, 25.0), (0.5, 10.0)
BIAS_DPS = 1.0

TIME_S = np.arange(round(SECONDS / GRID_S), dtype=np.float64) * GRID_S


def _profile(*points: tuple[float, float]) -> FloatArray:
    """Linear between points of time in s and value."""
    times, values = zip(*points, strict=True)
    return np.asarray(np.interp(TIME_S, times, values), np.float64)


def driven(speed_mps: FloatArray, yaw_radps: FloatArray, bank_rad: FloatArray, heading_rad: float) -> Course:
    """A body that goes where its nose (x) points, level but for its bank to the right."""
    yaw = heading_rad + np.cumsum(yaw_radps) * GRID_S
    rises = np.gradient(speed_mps, GRID_S)
    zero = np.zeros_like(yaw)
    along, across = np.stack([np.cos(yaw), np.sin(yaw), zero]), np.stack([-np.sin(yaw), np.cos(yaw), zero])
    turned = rotation.quaternions(np.stack([zero, zero, yaw]))
    banked = rotation.quaternions(np.stack([bank_rad, zero, zero]))
    return rotation.product(turned, banked), rises * along + speed_mps * yaw_radps * across


def arm(dps: float, rng: Generator) -> Course:
    return _spun(ARM_M, dps, rng)


def merry_go_round(_: float, rng: Generator) -> Course:
    return _spun(MERRY_M, MERRY_DPS, rng)


def _spun(radius_m: float, dps: float, rng: Generator) -> Course:
    turn = _profile((BEGIN_S, 0.0), (BEGIN_S + SPIN_UP_S, 1.0), (END_S - SPIN_UP_S, 1.0), (END_S, 0.0))
    rate = np.radians(dps) * turn
    return driven(radius_m * rate, rate, np.zeros_like(rate), _heading(rng))


def hand(_: float, rng: Generator) -> Course:
    into = np.clip(np.minimum(TIME_S - BEGIN_S, END_S - TIME_S) / FADE_S, 0.0, 1.0)
    shown = 0.5 - 0.5 * np.cos(np.pi * into)
    white = rng.standard_normal((6, len(TIME_S)))
    turn_rad, shift_m = (
        shown * rms * np.stack([band_noise(one, *band_hz, GRID_S) for one in part])
        for rms, band_hz, part in ((np.radians(HAND_DEG), HAND_HZ, white[:3]), (SHIFT_M, SHIFT_HZ, white[3:]))
    )
    accel_mps2 = np.gradient(np.gradient(shift_m, GRID_S, axis=1), GRID_S, axis=1)
    return rotation.quaternions(turn_rad), accel_mps2


def still(_: float, _rng: Generator) -> Course:
    return rotation.quaternions(np.zeros((3, len(TIME_S)))), np.zeros((3, len(TIME_S)))


def dash(mps: float, rng: Generator) -> Course:
    ramp_s, points, sign, at_s = mps / DASH_MPS2, [(BEGIN_S, 0.0)], 1.0, BEGIN_S
    while at_s + 2.0 * ramp_s + CRUISE_S <= END_S:
        for later_s, value in ((ramp_s, sign * mps), (CRUISE_S, sign * mps), (ramp_s, 0.0), (PAUSE_S, 0.0)):
            at_s += later_s
            points.append((at_s, value))
        sign = -sign
    zero = np.zeros_like(TIME_S)
    return driven(_profile(*points), zero, zero, _heading(rng))


def roundabout(radius_m: float, rng: Generator) -> Course:
    speed = _profile((BEGIN_S, 0.0), (BEGIN_S + ROUND_UP_S, ROUND_MPS), (END_S - 4.0, ROUND_MPS), (END_S, 0.0))
    entry_s = BEGIN_S + ROUND_UP_S
    rate = (
        ROUND_MPS
        / radius_m
        * _profile(
            (entry_s, 0.0), (entry_s + ROUND_ENTRY_S, 1.0), (ROUND_UNTIL_S, 1.0), (ROUND_UNTIL_S + ROUND_ENTRY_S, 0.0)
        )
    )
    return driven(speed, rate, np.zeros_like(rate), _heading(rng))


def bank_turn(_: float, rng: Generator) -> Course:
    speed = _profile((BEGIN_S, 0.0), (BEGIN_S + BANK_UP_S, BANK_MPS), (END_S - 5.0, BANK_MPS), (END_S, 0.0))
    entry_s = BEGIN_S + BANK_UP_S
    bank = np.radians(BANK_DEG) * _profile(
        (entry_s, 0.0), (entry_s + BANK_ENTRY_S, 1.0), (BANK_UNTIL_S, 1.0), (BANK_UNTIL_S + BANK_ENTRY_S, 0.0)
    )
    # To the right, which is a turn of negative sign about the upward axis.
    rate = -G_MPS2 * np.tan(bank) / np.maximum(speed, 1.0)
    return driven(speed, rate, bank, _heading(rng))


def vibration(hz: float, rng: Generator) -> Course:
    on = np.where((TIME_S >= BEGIN_S) & (TIME_S < END_S), 1.0, 0.0)
    shaken, turned, phase = _direction(rng), _direction(rng), rng.uniform(0.0, 2.0 * np.pi)
    angle = 2.0 * np.pi * hz * (TIME_S - BEGIN_S)
    swing = np.radians(SHAKE_DPS) / (2.0 * np.pi * hz) * on * (np.sin(angle + phase) - np.sin(phase))
    return rotation.quaternions(turned[:, None] * swing), SHAKE_G * G_MPS2 * shaken[:, None] * (on * np.cos(angle))


def _heading(rng: Generator) -> float:
    return float(rng.uniform(0.0, 2.0 * np.pi))


def _direction(rng: Generator) -> FloatArray:
    drawn = rng.standard_normal(3)
    return np.asarray(drawn / np.linalg.norm(drawn), np.float64)


KINDS: dict[str, tuple[Callable[[float, Generator], Course], tuple[float, ...], str]] = {
    "arm": (arm, (170.0, 200.0, 230.0), f"arm of {ARM_M:g} m that turns by {{:g}} deg/s, {{speed:.1f}} m/s"),
    "dash": (dash, (5.0, 12.0, 20.0), f"dashes to {{:g}} m/s at {DASH_MPS2:g} m/s^2"),
    "roundabout": (roundabout, (15.0, 40.0), f"roundabout of {{:g}} m at {ROUND_MPS:g} m/s"),
    "bank-turn": (bank_turn, (), f"bank turn of {BANK_DEG:g} deg at {BANK_MPS:g} m/s"),
    "merry-go-round": (merry_go_round, (), f"merry-go-round of {MERRY_M:g} m at {MERRY_DPS:g} deg/s"),
    "bias-step": (hand, (), f"in the hand, the bias steps by {STEP_DPS[0]:g} to {STEP_DPS[1]:g} deg/s"),
    "bias-step-rest": (still, (), f"at rest, the bias steps by {STEP_DPS[0]:g} to {STEP_DPS[1]:g} deg/s"),
    "vibration": (vibration, (100.0, 200.0, 300.0, 400.0, 500.0), f"vibration of {SHAKE_G:g} g at {{:g}} Hz"),
}
"""Kind -> its course, its sizes, its title."""
STEPPED = ("bias-step", "bias-step-rest")
MOTIONS: dict[str, tuple[Callable[[float, Generator], Course], float, str]] = {
    f"{kind}-{size:g}" if sizes else kind: (
        course,
        size,
        title.format(size, speed=np.radians(size) * ARM_M),
    )
    for kind, (course, sizes, title) in KINDS.items()
    for size in sizes or (0.0,)
}
"""Name -> course, size, title, in the order of the table."""


def prescribed(name: str, seed: int) -> Motion:
    """The readings of an ideal sensor, every PERIOD_S."""
    course, size, _ = MOTIONS[name]
    rng = np.random.default_rng(seed)
    lean = rotation.quaternions(np.array([*(LEAN_RAD * rng.standard_normal(2)), 0.0])[:, None])
    attitude, accel_mps2 = course(size, rng)
    attitude = rotation.product(attitude, np.broadcast_to(lean, attitude.shape))
    up_g = np.array([[0.0], [0.0], [1.0]])
    felt_g = rotation.to_body(attitude, accel_mps2 / G_MPS2 + up_g)
    rate_dps = np.degrees(rotation.rates_radps(attitude, GRID_S))
    gyr, acc = (block_means(values.T, STEPS_OF_A_PERIOD) for values in (rate_dps, felt_g))
    ends = np.arange(len(gyr)) * STEPS_OF_A_PERIOD + STEPS_OF_A_PERIOD - 1
    up = rotation.to_body(attitude[:, ends], np.broadcast_to(up_g, (3, len(ends)))).T
    at_s = TIME_S[ends]
    return Motion(name, PERIOD_S, gyr, acc, up, (at_s >= BEGIN_S) & (at_s < END_S))


def worsened(motion: Motion, rng: Generator) -> Motion:
    """With the errors of the sensors that the head of this file states."""
    matrix = np.eye(3) + 0.001 * rng.standard_normal((3, 3))
    np.fill_diagonal(matrix, 1.0 + 0.005 * rng.standard_normal(3))
    per_sample, shape = np.sqrt(0.5 / motion.period_s), motion.gyr_dps.shape
    gyr_dps = (
        motion.gyr_dps @ matrix.T
        + BIAS_DPS * rng.choice([-1.0, 1.0], 3)
        + 0.005 * per_sample * rng.standard_normal(shape)
    )
    acc_g = motion.acc_g + 0.002 * rng.standard_normal(3) + 200e-6 * per_sample * rng.standard_normal(shape)
    return replace(motion, gyr_dps=gyr_dps, acc_g=acc_g)


def stepped(motion: Motion, rng: Generator) -> Motion:
    """With a step of the gyro's bias, scored from there on."""
    begin_s = rng.uniform(*STEP_S)
    size_dps = np.exp(rng.uniform(*np.log(STEP_DPS)))
    signs, axis = rng.choice([-1.0, 1.0], 3), rng.integers(3)
    axes = np.ones(3) if rng.random() < 0.5 else np.eye(3)[axis]
    since = motion.time_s >= begin_s
    return replace(
        motion,
        gyr_dps=motion.gyr_dps + np.where(since[:, None], size_dps * signs * axes, 0.0),
        movement=motion.movement & since,
    )


def of_motion(name: str, seeds: Sequence[int]) -> Input:
    """An input of the table: a motion, a trial for every seed."""

    def trials() -> Iterable[Trial]:
        for seed in seeds:
            motion = worsened(prescribed(name, seed), np.random.default_rng([seed, 1]))
            if name in STEPPED:
                motion = stepped(motion, np.random.default_rng([seed, 2]))
            yield Trial(name, seed, (sampled(motion, SIXTEEN_BITS, 1),))

    bias_dps = BIAS_DPS + (STEP_DPS[1] if name in STEPPED else 0.0)
    return Input(name, MOTIONS[name][2], "prescribed", 1, trials, len(seeds), bias_dps)
