"""Runs of a quadrotor with words at the edges of the table and inputs of any value; they reach every phase and flag."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plumb.spec import parameters
from support.quadrotor_by_hand import GROUND_STEPS, ON_GROUND, TAKE_OFF_STEPS, WORDS

Integers = npt.NDArray[np.int64]
RUNS, STEPS = 24, 480


def wild_words(rng: np.random.Generator) -> dict[str, int]:
    """Anything within the ranges of the table, with times that a short run reaches."""
    rows = [row for row in parameters.table() if row.group.startswith(("quadrotor", "rate_"))]
    ends = {row.name: (row.min, row.max, int(rng.integers(row.min, row.max, endpoint=True))) for row in rows}
    any_of = {name: values[rng.integers(3)] for name, values in ends.items()}
    times = {"lost": 6, "held": 20, "back": 20, "land": 40, "blind": 30}
    short = {f"quadrotor.{name}_steps": int(rng.integers(1, most)) for name, most in times.items()}
    limits = {"quadrotor.idle_limit": 60, "quadrotor.lying_limit": 8}
    limits["quadrotor.runaway_limit"] = int(rng.choice([1, 65535, 65535, 65535]))
    limits["quadrotor.upturned_limit"] = int(rng.choice([14, 65535]))
    limits["quadrotor.low_q15"] = int(rng.choice([1, ON_GROUND]))
    sensors = {"gyro.raw_max": 30000, "attitude.unsure": int(rng.choice([0, WORDS["attitude.unsure"]]))}
    return {**WORDS, **any_of, **short, **limits, **sensors}


def wild_inputs(rng: np.random.Generator) -> tuple[Integers, Integers]:
    """Rest, switched on when sure (one run before that, one from the first step on) and take-off, then anything; some
    runs wait on the ground with the throttle low, the last two on their back; throttle of any value. Inputs (steps, 12,
    runs), throttle (steps, runs)."""
    steps, runs = np.arange(STEPS)[:, None], np.arange(RUNS)
    quiet = steps < GROUND_STEPS + TAKE_OFF_STEPS + rng.integers(0, 60, RUNS)
    raw = rng.integers(-32768, 32768, (STEPS, 12, RUNS))
    raw[:, :6] //= np.where(quiet, 2000, rng.choice([1, 30, 3000], RUNS))[:, None]
    raw[:, 5] += np.where(runs < RUNS - 2, 2048, -2048)
    raw[:, :6] = np.clip(raw[:, :6], -32768, 32767)
    raw[:, 0] = np.where(~quiet & (rng.random((STEPS, RUNS)) < 0.1), -32768, raw[:, 0])
    raw[:, 0] = np.where((steps // 20 % 4 == 3) & ~quiet & (runs == 0), -32768, raw[:, 0])
    rates = rng.random((STEPS, RUNS)) < 0.1
    on_from = np.where(runs == 2, 0, np.where(runs == 3, 1, GROUND_STEPS - 1))
    raw[:, 9] = ((steps >= on_from) & (quiet | (rng.random((STEPS, RUNS)) < 0.99))) + 2 * np.where(
        quiet, runs == 1, rates
    )
    still = ~quiet & (rng.random(RUNS) < 0.7) & (steps // 30 % 2 == 0)
    raw[:, 10] = np.where(still, 7, steps % 255 + 1) + 256 * (~quiet & (rng.random((STEPS, RUNS)) < 0.01))
    raw[:, 11] = 0
    lifts = np.where(runs < RUNS - 4, np.where(steps < GROUND_STEPS, ON_GROUND, 20000), 0)
    throttle = rng.choice([0, 20000, 1 << 30, -5], (STEPS // 40, RUNS)).repeat(40, axis=0)
    return raw, np.where(quiet, lifts, throttle)
