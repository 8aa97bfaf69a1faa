"""Turntable parameters: the core's check, the table of parameters and the quantiser refuse the same words."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.systems.turntable import scenarios as turntable

GROUPS = ("gyro_filter", "angular_filter", "fusion")
ROWS = [row for row in parameters.table() if row.group in GROUPS]
LONGEST = {"fusion.gyro_period_step_q24": 1 << 28}
"""So that the largest age of a gyro sample is below its period."""


def ends(row: parameters.Parameter) -> list[tuple[int, int]]:
    """(last good value, first bad one) of both ends of the range, where the word has room for a bad one."""
    low, high = (-(1 << 31), (1 << 31) - 1) if row.type == "int32" else (0, (1 << 32) - 1)
    return [(good, bad) for good, bad in ((row.min, row.min - 1), (row.max, row.max + 1)) if low <= bad <= high]


def with_words(**words: int) -> ControlParams:
    params = quantise(turntable.DATA)
    return replace(params, values={**params.values, **words})


@pytest.mark.parametrize(("name", "good", "bad"), [(row.name, *end) for row in ROWS for end in ends(row)])
def test_the_core_accepts_the_range_of_the_table_and_no_more(name: str, good: int, bad: int) -> None:
    others = {} if name.startswith("fusion.gyro_period") else LONGEST
    if name == "fusion.gyro_period_step_q24":
        others = {"fusion.gyro_age_step_q24": 0}
    assert native_core.params_valid(with_words(**others, **{name: good}))
    assert not native_core.params_valid(with_words(**others, **{name: bad}))


def test_every_word_with_a_limit_was_tried() -> None:
    tried = {row.name for row in ROWS if ends(row)}
    assert len(tried) == 15 and "fusion.lag_alpha_q31" in tried and "fusion.share_q30" in tried


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rest_s": 1e9}, "fusion.rest_s"),
        ({"start_lag_s": 1.0}, r"fusion\.start_lag_s = 1: too large for its integer, the most is 0\.004"),
        ({"gyro_dps": 0.0}, "fusion.gyro_dps"),
    ],
)
def test_a_setting_without_a_valid_word_is_refused_by_name(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        quantise(turntable.with_fusion(turntable.DATA, **change))


def test_a_count_worth_nothing_is_refused_by_name() -> None:
    dead = replace(turntable.DATA.gyro, unit_per_count=0.0)
    with pytest.raises(UsageError, match=r"gyro\.unit_per_count = 0"):
        quantise(replace(turntable.DATA, gyro=dead))


def test_words_outside_the_table_are_no_parameters() -> None:
    own = quantise(turntable.DATA).own()
    with pytest.raises(UsageError, match=r"fusion\.share_q30 = -1 is outside 0 to 1073741824"):
        ControlParams.of("turntable", {**own, "fusion.share_q30": -1})


def disturbed(part: Any, rng: np.random.Generator) -> Any:
    """The settings with one number in eight another one, of any size, either sign, or 0."""
    changes: dict[str, Any] = {}
    for entry in fields(part):
        value = getattr(part, entry.name)
        if is_dataclass(value):
            changes[entry.name] = disturbed(value, rng)
        elif isinstance(value, int | float) and entry.name != "exact_period_s" and rng.random() < 0.125:
            size = float(10.0 ** rng.uniform(-12, 12)) * float(rng.choice([-1.0, 1.0, 1.0, 1.0]))
            changes[entry.name] = float(rng.choice([0.0, size, value * 10.0 ** rng.uniform(-2, 2)]))
    return replace(part, **changes)


def test_what_the_quantiser_makes_is_valid_or_refused_in_a_sentence() -> None:
    rng = np.random.default_rng(11)
    made = 0
    for _ in range(3000):
        try:
            params = quantise(disturbed(turntable.DATA, rng))
        except UsageError:
            continue
        assert native_core.params_valid(params), params.own()
        made += 1
    # Of 3000 drawn tunings one in twenty at least is made: the claim is tried.
    assert made > 150
