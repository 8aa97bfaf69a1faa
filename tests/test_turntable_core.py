"""The step of `turntable`: every bit on both hands, close to float64, and what it does when samples are wrong."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from plumb import fixed, native
from plumb.compare import first_divergence
from plumb.quantise import ControlParams, quantise
from plumb.systems import turntable
from plumb.tuning import TurntableTuning
from plumb.words import TURNTABLE, Words, names_of
from wild_params import wild_turntable_params

RUNS, STEPS = 200, 400
NONE = turntable.NO_SAMPLE
GYRO_SATURATED, ANGULAR_SATURATED, GYRO, ANGULAR, GYRO_SPIKE, ANGULAR_SPIKE, SHOCK, REST, GYRO_LOST = (
    1 << bit for bit in range(9)
)
BIAS_DPS, BIAS_DPS2 = 360.0 / 2**34, 360.0 / 2**42 / 0.004


@lru_cache(maxsize=1)
def wild_runs() -> tuple[tuple[ControlParams, ...], npt.NDArray[np.int16]]:
    """Counts of any value, in some runs only the extremes, in some held for a while, in some small; in most of them
    each sensor is missing from some of the steps."""
    rng = np.random.default_rng(50)
    params = tuple(wild_turntable_params(rng) for _ in range(RUNS))
    raw = rng.integers(-32768, 32768, (STEPS, 6, RUNS)).astype(np.int16)
    part = RUNS // 5
    raw[:, :, :part] = rng.choice(np.array([-32768, -32767, 0, 1, 32767], np.int16), (STEPS, 6, part), p=PROBABLE)
    raw[:, :, part : 2 * part] = raw[np.arange(STEPS) // 40 * 40][:, :, part : 2 * part]
    raw[:, :, 2 * part : 3 * part] //= 500
    for sensor in (slice(0, 3), slice(3, 6)):
        missing = rng.random((STEPS, 1, RUNS)) < rng.choice([0.0, 0.3, 0.8], RUNS)
        raw[:, sensor] = np.where(missing, NONE, raw[:, sensor])
    return params, raw


PROBABLE = (0.04, 0.24, 0.24, 0.24, 0.24)


def run(tuning: TurntableTuning, raw: npt.ArrayLike) -> Words:
    counts = np.asarray(raw, np.int16)
    return native.run_control(quantise(tuning), counts, np.zeros((len(counts), *counts.shape[2:]), np.int32))


def test_wild_parameters_are_valid() -> None:
    assert all(native.params_valid(params) for params in wild_runs()[0])


def test_wild_runs_agree_in_every_bit() -> None:
    params, raw = wild_runs()
    setpoint = np.random.default_rng(51).integers(-(1 << 31), 1 << 31, (STEPS, RUNS)).astype(np.int32)
    model = fixed.run_control(params, raw, setpoint)
    assert first_divergence(model, native.run_control(params, raw, setpoint)) is None
    assert np.bitwise_or.reduce(model["flags"], axis=None) == 511
    one_sided = ["p00_q64", "p11_q64", "p22_q64", "p33_q64", "p30_q64"] + [f"lag_step_q24_{i}" for i in range(3)]
    one_sided += [f"{name}_variance_q60_{i}" for name in ("scale", "lag") for i in range(3)]
    for name in names_of("turntable"):
        if TURNTABLE[name].kind == "i" and name not in one_sided:
            assert model[name].min() < 0 < model[name].max(), name


def test_one_run_and_many_runs_are_the_same_code() -> None:
    """Ints without a limit against int64: nothing in the step overflows."""
    params, raw = wild_runs()
    setpoint = np.zeros((STEPS, 40), np.int32)
    chosen = [*range(0, RUNS, 5)]
    many = fixed.run_control([params[i] for i in chosen], raw[:, :, chosen], setpoint)
    for column, i in enumerate(chosen):
        alone = fixed.run_control(params[i], raw[:, :, i], setpoint[:, column])
        assert first_divergence(Words(many.record[:, column]), alone) is None
