"""Tunings of `attitude` at and beyond their limits: one sentence with the true limit, or integers that are valid.

Then rows of NaN in the arrays of `plumb.Estimator`."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import plumb
from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.systems.attitude import scenarios as attitude
from plumb.systems.attitude.quantise import dequantise
from plumb.systems.attitude.tuning import AttitudeTuning

SQUARED = {
    "errors.bias_dps": 6.40586,
    "errors.scale": 0.00698771,
    "errors.turn_noise": 0.0176777,
    "motion.velocity_mps": 35.0853,
    "motion.travel_mps": 55.4748,
    "aid.velocity_mps": 35.0853,
    "motion.start_tilt_deg": 25.6235,
    "motion.start_velocity_mps": 8.77133,
    "motion.unsure_deg": 40.5142,
    "rest.noise_dps": 6.40586,
}
"""Setting whose integer is its square -> the largest, in its own unit: the root of the integer's limit."""
GROUPS = ("errors", "motion", "rest", "aid")
WILD = (0.0, -1.0, -1e-9, 1e-300, 1e-9, 1e3, 1e30, 1e300, float("inf"), float("nan"))


def with_setting(name: str, value: float) -> AttitudeTuning:
    group, _, field = name.rpartition(".")
    if name == "block_s":
        return replace(attitude.DEFAULT, block_s=value)
    return replace(attitude.DEFAULT, **{group: replace(getattr(attitude.DEFAULT, group), **{field: value})})


SETTINGS = [
    *(f"{group}.{one.name}" for group in GROUPS for one in fields(getattr(attitude.DEFAULT, group))),
    *(f"{group}.{axes}" for group in ("gyro_mounting", "accel_mounting") for axes in ("xx", "zy")),
    "block_s",
]


@pytest.mark.parametrize("name", SETTINGS)
def test_any_value_is_refused_by_name_or_valid_and_comes_back(name: str) -> None:
    for value in WILD:
        try:
            params = quantise(with_setting(name, value))
        except UsageError as refused:
            assert str(refused).startswith((name, name.split(".")[0])), str(refused)
            continue
        assert native_core.params_valid(params), value
        assert quantise(dequantise(params)).values == params.values, value


@pytest.mark.parametrize("name", SQUARED)
def test_the_limit_of_a_squared_setting_is_named_in_its_unit(name: str) -> None:
    with pytest.raises(UsageError, match=f"{name} = 100: too large for its integer, the most is {SQUARED[name]}$"):
        quantise(with_setting(name, 100.0))
    assert native_core.params_valid(quantise(with_setting(name, SQUARED[name])))


@pytest.mark.parametrize("name", ["rest.seconds"])
def test_a_time_that_is_not_positive_is_refused(name: str) -> None:
    for value in (0.0, -1.0):
        with pytest.raises(UsageError, match=f"{name} = .*: give more than 0"):
            quantise(with_setting(name, value))


def test_a_block_of_the_longest_time_is_refused_before_the_core_sees_it() -> None:
    longest = replace(attitude.DEFAULT, period_us=2544, block_s=0.318)
    with pytest.raises(UsageError, match=r"block_s = 0\.318: a block has at most 125 samples and less than 0\.318 s"):
        quantise(longest)
    for period_us in range(1_000, 21_001, 37):
        try:
            params = quantise(replace(longest, period_us=period_us))
        except UsageError:
            continue
        assert native_core.params_valid(params), period_us


def test_a_row_of_nan_is_a_missing_sample_only_in_both_arrays() -> None:
    gyr, acc = np.zeros((9, 3)), np.tile([0.0, 0.0, 9.80665], (9, 1))
    acc[5] = np.nan
    estimator = plumb.Estimator("attitude", period_s=0.005)
    with pytest.raises(UsageError, match="acc_mps2 of sample 5 is NaN and gyr_radps is not: a step without a sample"):
        estimator.run(gyr, acc)
    gyr[5] = np.nan
    assert estimator.run(gyr, acc)["missing_steps"][-1] == 1
