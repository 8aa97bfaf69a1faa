"""Every accepted tuning is within 0.1 % of what was asked; what cannot be is refused in one sentence that says why."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, dequantise, quantise
from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.tuning import QuadTuning
from plumb.systems.turntable import scenarios as turntable
from support.tuning_box import CORNERS, PAPER, corner


def deviations(asked: Any, got: Any, path: str = "") -> dict[str, float]:
    """Relative deviation of every number of a tuning; of the D filter's time constant, of what a step keeps of it."""
    found: dict[str, float] = {}
    for entry in fields(asked):
        a, b = getattr(asked, entry.name), getattr(got, entry.name)
        if entry.name == "derivative_tau_s":
            a, b = (1.0 - math.exp(-0.002 / tau) if tau else 1.0 for tau in (a, b))
        if is_dataclass(a):
            found |= deviations(a, b, f"{path}{entry.name}.")
        elif isinstance(a, int | float) and entry.name not in ("exact_period_s", "r_max_deg2"):
            found[path + entry.name] = abs(b - a) / abs(a) if a else abs(b)
    return found


def changed(tuning: QuadTuning, path: str, value: Any) -> QuadTuning:
    group, _, name = path.rpartition(".")
    return replace(tuning, **{group: replace(getattr(tuning, group), **{name: value})} if group else {name: value})


@pytest.mark.parametrize("name", quad.TUNINGS)
def test_shipped_tunings_are_within_a_thousandth(name: str) -> None:
    asked = quad.TUNINGS[name]
    got: Any = dequantise(quantise(asked))
    worst = {k: v for k, v in deviations(asked, got).items() if v > 1e-3}
    assert worst == {} and native_core.params_valid(quantise(asked))
    if asked.trust.gain_deg2:
        assert got.trust.r_max_deg2 == pytest.approx(asked.trust.r_max_deg2, rel=1e-3)


@pytest.mark.parametrize("box", CORNERS, ids=lambda box: "-".join(f"{v:g}" for v in box))
def test_corners_of_the_box_are_within_a_thousandth(box: tuple[float, ...]) -> None:
    asked = corner(int(box[0]), *box[1:])
    params = quantise(asked)
    worst = {k: v for k, v in deviations(asked, dequantise(params)).items() if v > 1e-3}
    assert worst == {} and native_core.params_valid(params)


def test_the_inside_of_the_box_is_within_a_thousandth() -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        low, high = np.log([500, 1e-6, 1e-8, 1e-3, 1e-3, 1e-3]), np.log([1e5, 10.0, 1.0, 1e3, 180.0**2, 500.0**2])
        period, *box = np.exp(rng.uniform(low, high)).tolist()
        asked = corner(int(period), *box)
        params = quantise(asked)
        worst = {k: v for k, v in deviations(asked, dequantise(params)).items() if v > 1e-3}
        assert worst == {} and native_core.params_valid(params), asked


def test_the_papers_constants_as_they_are() -> None:
    got: Any = dequantise(quantise(PAPER))
    step = got.period_s
    assert got.kalman.q_angle_deg2_per_s * step == pytest.approx(0.01, rel=1e-6)
    assert got.kalman.q_bias_dps2_per_s * step == pytest.approx(0.005, rel=1e-6)
    assert got.trust.r_deg2 == pytest.approx(0.056, rel=1e-6)
    assert (got.start.p00_deg2, got.start.p01_deg2_per_s, got.start.p11_dps2) == pytest.approx((0.005,) * 3, rel=1e-6)


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("period_us", 499, "period_us = 499"),
        ("period_us", 100_001, "period_us"),
        ("period_us", 1000.5, "whole"),
        ("calibration.gyro.unit_per_count", 0.0, ""),
        ("trust.r_deg2", 0.0, "more than 0"),
        ("trust.r_deg2", 1e-9, "too small beside"),
        ("trust.gain_deg2", -1.0, "negative"),
        ("trust.r_max_deg2", 0.1, "less than"),
        ("kalman.q_angle_deg2_per_s", -1.0, "negative"),
        ("kalman.q_bias_dps2_per_s", 1e9, "too small beside kalman.q_bias"),
        ("kalman.bias_max_dps", 360.0, "below 360"),
        ("kalman.rate", "next", "previous, current or trapezium"),
        ("start.p00_deg2", 1e12, "too small beside start.p00"),
        ("start.p01_deg2_per_s", 1e3, "no covariance"),
        ("start.bias_dps", 301.0, "bias_max"),
        ("start.tilt_deg", 181.0, "too large"),
        ("pid.kp_per_deg", 1.0, "too large"),
        ("pid.kp_per_deg", 1e-9, "too fine"),
        ("pid.kd_per_dps", -1.0, "too small"),
        ("pid.ki_per_deg_s", -0.1, "cannot be negative"),
        ("pid.slew_per_s", 0.0, "give more than 0"),
        ("pid.derivative_tau_s", -0.1, "negative"),
        ("pid.derivative_tau_s", 1e6, "0 to 8.59e+04 s"),
        ("esc.mid_us", 9000.0, "outside 900 to 2100 us; plumb drives one-way PWM controllers alone"),
        ("esc.max_us", 1400.0, "esc.mid_us = 1500: more than max_us"),
        ("esc.neutral_us", 1010.0, "more than min_us = 1000"),
        ("esc.neutral_us", 1051.0, "outside 900 to 1050 us; a neutral pulse of 1051 us may already turn a motor"),
        ("esc.neutral_us", 1500.0, "a neutral pulse of 1500 us is that of a two-way (3D) controller"),
        ("esc.max_us", 250.0, "250 us is a pulse of OneShot125"),
        ("esc.max_us", 84.0, "84 us is a pulse of OneShot42"),
        ("esc.max_us", 25.0, "25 us is a pulse of Multishot"),
        ("pid.derivative_tau_s", 1e9, "0 to 8.59e+04 s"),
        ("pid.kp_per_deg", "much", "give a number"),
        ("esc.mid_us", None, "give a number"),
        ("start.p00_deg2", 1e-20, "too fine"),
        ("tilt", "sine", "arcsine or atan2"),
    ],
)
def test_refused_with_a_reason(path: str, value: Any, reason: str) -> None:
    tuning = quad.TUNINGS["adaptive"]
    if path == "calibration.gyro.unit_per_count":
        gyro = replace(tuning.calibration.gyro, unit_per_count=100.0)
        tuning = replace(tuning, calibration=replace(tuning.calibration, gyro=gyro))
        reason = "gyro.unit_per_count = 100"
    else:
        tuning = changed(tuning, path, value)
    with pytest.raises(UsageError) as refused:
        quantise(tuning)
    sentence = str(refused.value)
    assert reason in sentence and "\n" not in sentence
    assert path.rpartition(".")[2] in sentence


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "path", ["period_us", "trust.r_deg2", "kalman.q_bias_dps2_per_s", "start.p00_deg2", "pid.ki_per_deg_s"]
)
def test_nan_and_infinity_are_refused_by_name(path: str, value: float) -> None:
    with pytest.raises(UsageError, match=path):
        quantise(changed(PAPER, path, value))


def test_words_go_and_come_back() -> None:
    params = quantise(quad.TUNINGS["adaptive"])
    rows = [row for row in parameters.table() if row.owner == "control"]
    assert [row.name for row in rows] == list(params.values)
    for row in rows:
        assert row.min <= params[row.name] <= row.max, row.name
    again = ControlParams.from_words([word & 0xFFFFFFFF for word in params.words()])
    assert again == params and again.crc32() == params.crc32()
    with pytest.raises(UsageError):
        ControlParams.from_words(params.words()[:-1])


def test_every_word_counts_in_the_crc() -> None:
    words = quantise(PAPER).words()
    seen = {parameters.crc32([w ^ (i == n) for i, w in enumerate(words)]) for n in range(-1, len(words))}
    assert len(seen) == len(words) + 1


def test_the_square_of_a_tiny_setting_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match=r"fusion\.angular_walk_dps2 = 1e-310: too fine"):
        quantise(turntable.with_fusion(turntable.DATA, angular_walk_dps2=1e-310))
