"""The designs in C give the words of the tunings in Python, to one unit, and refuse what Python refuses.

Drawn: every shipped tuning, then tunings around the shipped ones, of which some settings are far away, at a limit or
wrong. A sample in every run, ten times as many with PLUMB_LONG=1.
"""

from __future__ import annotations

import importlib
import math
import re
import subprocess
import sys
from collections import Counter
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb.contract.parameters import ControlParams, groups_of, quantise
from plumb.errors import SettingError, UsageError
from plumb.systems.attitude.tuning import Mounting
from plumb.systems.balancer.tuning import most_edges
from plumb.tuning.variances import lsb_of
from support import c_design
from support.campaigns import campaign
from support.declared_systems import of_declared

ROOT = Path(__file__).resolve().parents[2]
SYSTEMS = tuple(of_declared(["quad", "balancer", "turntable", "phone", "attitude", "quadrotor", "wheels"]))
SAME_DOUBLES = ("attitude",)
"""Systems whose C and Python calculate in the same doubles: equal in every bit."""
STANDS_ON = {"quadrotor": "attitude", "wheels": "balance"}
"""System -> group of settings that are those of the system that it stands on."""
WIDE = re.compile(r"(.*)_hi$")


def tunings(system: str) -> dict[str, Any]:
    found: dict[str, Any] = importlib.import_module(f"plumb.systems.{system}.scenarios").TUNINGS
    return found


def integers(system: str, words: dict[str, int]) -> dict[str, int]:
    """The words of the groups that the system reads; two words of one integer, and integer and fraction, as one."""
    groups = groups_of(system)
    own = {name: value for name, value in words.items() if name.rpartition(".")[0] in groups}
    for name in list(own):
        if match := WIDE.match(name):
            own[match[1]] = own.pop(name) * (1 << 32) + own.pop(f"{match[1]}_lo")
        elif name.endswith(".qb"):
            own[name] = (own[name] << 30) + own.pop(f"{name}_frac_q30")
    return own


def named(system: str, sentence: str) -> str:
    """The setting that Python's refusal names, as the C names it."""
    axis = re.match(r"(pitch|roll): ", sentence)
    name = re.split(r" |:", sentence[axis.end() :] if axis else sentence)[0]
    if axis:
        name = name.replace("kalman.bias_max_dps", "bias_max_dps").replace("trust.r_max_deg2", "r_left_out_deg2")
        name = "rate" if name == "kalman.rate" else re.sub("^(kalman|trust)", axis[1], name)
        return re.sub("^start", f"{axis[1]}.start", name)
    if system not in ("quad", "balancer", "wheels"):
        return name
    return re.sub("^(gyro|accel|accel_up)\\.", r"calibration.\1.", name)


def compare(tuning: Any) -> Counter[str]:
    """How many integers were equal and one unit apart, or that both refused the same setting; all else fails."""
    got = c_design.design(tuning)
    if tuning.system == "turntable" and got.field == "fusion.gyro_phase_s" and tuning.fusion.gyro_phase_s > 1e9:
        return Counter(phase_beyond_the_c=1)  # plumb/design.h: the C takes a phase up to 30 years
    try:
        asked = quantise(tuning)
    except UsageError as error:
        name = named(tuning.system, str(error))
        assert got.error and got.field == name, (str(error), got.field, tuning)
        if isinstance(error, SettingError) and abs(error.asked) > 1e-99:  # R has a least in C alone
            assert [within(got.least), within(got.most)] == pytest.approx([error.least, error.most], rel=1e-9), (
                str(error),
                got,
                tuning,
            )
            return Counter(refused=1, cured=cured(tuning, got))
        return Counter(refused=1)
    assert not got.error, (got.field, tuning)
    if tuning.system not in ("turntable", "attitude", "quadrotor"):
        assert got.lsb_deg2 == pytest.approx(lsb_of(asked), rel=1e-15)
    return difference(asked, got.words, tuning)


def within(limit: float) -> float:
    """A limit of the C, with its stand-ins for "none" and "above 0" as Python says them."""
    return math.copysign(math.inf if abs(limit) >= 1e100 else 0.0, limit) if not 1e-99 < abs(limit) < 1e99 else limit


def put(tuning: Any, path: list[str], value: float) -> Any:
    inner = put(getattr(tuning, path[0]), path[1:], value) if path[1:] else value
    return replace(tuning, **{path[0]: inner})


def between(least: float, most: float) -> float:
    """A value between limits, other than 0."""
    if most < 1e99 and least > -1e99:
        return 0.25 * least + 0.75 * most
    if most < 1e99:
        return 2.0 * most if most < 0.0 else -1.0
    return 2.0 * least if least > 0.0 else 1.0


def cured(tuning: Any, refusal: c_design.Answer) -> bool:
    """Whether a setting that is moved between the limits of its refusal, and of those that follow, is refused no more:
    it must be, unless they leave nothing (or it is a choice): then another setting has to change."""
    field, path = refusal.field, refusal.field.split(".")
    if not hasattr(tuning, path[0]):  # of the system that this one stands on
        path.insert(0, STANDS_ON[tuning.system])
    least, most = -math.inf, math.inf
    for _ in range(4):
        if refusal.field != field:
            return True
        least, most = max(least, refusal.least), min(most, refusal.most)
        if least > most or path[-1] in c_design.CHOICES:
            return False
        old: Any = tuning
        for name in path:
            old = getattr(old, name)
        value = between(least, most)
        tuning = put(tuning, path, int(value) if isinstance(old, int) else value)
        refusal = c_design.design(tuning)
    raise AssertionError((least, most, refusal, tuning))


def difference(asked: ControlParams, words: dict[str, int], tuning: Any) -> Counter[str]:
    a, b = integers(tuning.system, asked.values), integers(tuning.system, words)
    apart = {name: b[name] - a[name] for name in a if a[name] != b[name]}
    assert all(abs(value) == 1 for value in apart.values()), (apart, tuning)
    return Counter(accepted=1, equal=len(a) - len(apart), one_apart=len(apart))


def drawn(rng: np.random.Generator, tuning: Any, share: float) -> Any:
    """The tuning with each setting changed with this chance."""
    changed: dict[str, Any] = {}
    for entry in fields(tuning):
        value = getattr(tuning, entry.name)
        if is_dataclass(value):
            nine = isinstance(value, Mounting)  # entries of one matrix, of which one draw in three is refused
            changed[entry.name] = drawn(rng, value, share / 9 if nine else share)
        elif entry.name == "exact_period_s" or rng.random() >= share:
            continue
        elif entry.name in c_design.CHOICES:
            changed[entry.name] = str(rng.choice([*c_design.CHOICES[entry.name], "neither"], p=None))
        elif entry.name == "period_us":
            changed[entry.name] = int(rng.choice([499, 500, 1000, 2000, 4000, 7001, 10_000, 20_000, 100_000, 100_001]))
        elif entry.type in ("int", int):
            changed[entry.name] = int(rng.choice([value, value + 1, -32769, -1, 0, 1, 7, 4095, 32767]))
        else:
            changed[entry.name] = float(another(rng, value))
    return replace(tuning, **changed)


def another(rng: np.random.Generator, value: float) -> float:
    """Another value of a setting: near, far, or one that is often a limit."""
    near = (value or rng.choice([1e-3, 1.0, 50.0])) * math.exp(rng.normal(0.0, 0.3))
    kind = rng.random()
    if kind < 0.75:
        return float(near)
    if kind < 0.92:
        return float(near * 10.0 ** rng.uniform(-4.0, 4.0))
    return float(
        rng.choice([0.0, -near, 1.0, 360.0, 180.0, -180.0, 1e-9, 1e9, 1e-30, 1e30, 1e-310, math.inf, math.nan])
    )


@pytest.mark.parametrize("system", SYSTEMS)
def test_shipped_tunings_have_the_words_of_python(system: str) -> None:
    counts = sum((compare(tuning) for tuning in tunings(system).values()), Counter())
    assert counts["accepted"] == len(tunings(system)) and counts["one_apart"] == 0


@pytest.mark.parametrize("block", range(campaign(1, 10)))
@pytest.mark.parametrize("system", SYSTEMS)
def test_drawn_tunings_have_the_words_of_python_or_are_refused_alike(system: str, block: int) -> None:
    """1000 tunings; pytest -s prints how many integers were equal, how many one unit apart."""
    rng, counts = np.random.default_rng([SYSTEMS.index(system), block]), Counter[str]()
    shipped, many = list(tunings(system).values()), 3.0 if system in STANDS_ON else 1.0  # twice as many settings
    for i in range(1000):
        counts += compare(drawn(rng, shipped[i % len(shipped)], float(rng.choice([0.05, 0.2, 0.6])) / many))
    print(f"{system}: {dict(counts)}")
    assert system not in SAME_DOUBLES or counts["one_apart"] == 0
    # Of 1000 at least a seventh each, so that both claims are tried. Most refusals are of one setting alone, which
    # its own limits cure; the others want a second one, too.
    assert counts["accepted"] > 150 and counts["refused"] > 150
    assert counts["cured"] > 0.6 * counts["refused"]


@pytest.mark.parametrize("system", SYSTEMS)
def test_accepted_designs_are_valid_for_the_step(system: str) -> None:
    from plumb.boards.native import core as native_core

    for tuning in tunings(system).values():
        words = c_design.design(tuning).words
        assert native_core.params_valid(ControlParams(words))


@pytest.mark.parametrize("system", SYSTEMS)
def test_shipped_constants_are_the_tunings_of_python(system: str) -> None:
    for name, tuning in tunings(system).items():
        of_python = c_design.structure(tuning)
        of_c = type(of_python).from_buffer_copy(c_design.constant(tuning, name))
        assert members(of_c) == members(of_python), name


def members(structure: Any) -> dict[str, Any]:
    values = {name: getattr(structure, name) for name, _ in structure._fields_}
    return {name: members(value) if hasattr(value, "_fields_") else value for name, value in values.items()}


def test_generated_tunings_are_fresh() -> None:
    run = subprocess.run([sys.executable, "tools/gen_tunings.py", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout


def exponential_share(x: Fraction) -> Fraction:
    """1 - exp(-x) within 2^-100 of itself: the series of exp(-x / 2^n), squared n times, in fractions of 2^-400."""
    n, one = max(0, math.ceil(math.log2(max(float(x), 1e-300))) + 8), 1 << 400
    y = x / (1 << n)
    term, total = Fraction(1), Fraction(0)
    for k in range(1, 60):
        term *= -y / k
        total -= term
    share = Fraction(round(total * one), one)
    for _ in range(n):
        share = Fraction(round(share * (2 - share) * one), one)
    return share


def test_share_of_a_filter_is_within_its_bound() -> None:
    rng, bound = np.random.default_rng(5), Fraction(1, 1 << 48)
    xs = [0.125, math.nextafter(0.125, 1.0), 39.999, 40.0, 40.1, 1e-9, *10.0 ** rng.uniform(-9.0, 1.7, 500)]
    for x in map(float, xs):
        exact = exponential_share(Fraction(x))
        got = Fraction(c_design.library().plumb_design_share(x))
        assert abs(got - exact) <= exact * bound, x


def test_a_refused_design_names_the_setting_and_keeps_the_parameters() -> None:
    tuning = tunings("quad")["adaptive"]
    bad = replace(tuning, kalman=replace(tuning.kalman, bias_max_dps=360.0))
    answer = c_design.design(bad)
    assert (answer.field, answer.words) == ("kalman.bias_max_dps", {})


@pytest.mark.parametrize(("period_us", "edges"), [(10_000, 40), (2_000, 8), (100_000, 401)])
def test_most_edges_of_the_balancer_follow_the_period(period_us: int, edges: int) -> None:
    tuning = replace(tunings("balancer")["tuned"], period_us=period_us)
    assert c_design.design(tuning).words["wheel.edges_max"] == edges == most_edges(tuning.wheel, period_us * 1e-6)
    fixed = replace(tuning, wheel=replace(tuning.wheel, edges_max=40))
    refusal = c_design.design(fixed)
    assert (refusal.field, refusal.most) == ("", 0.0) if edges >= 40 else ("wheel.edges_max", edges)
    compare(tuning), compare(fixed)


@pytest.mark.parametrize(("neutral_us", "field"), [(900.0, ""), (1050.0, ""), (1050.5, "esc.neutral_us")])
def test_a_neutral_pulse_ends_below_where_motors_start(neutral_us: float, field: str) -> None:
    """Both hands; the table takes up to 1100 us, for what older versions saved."""
    tuning = tunings("quad")["adaptive"]
    changed = replace(tuning, esc=replace(tuning.esc, neutral_us=neutral_us, min_us=1100.0))
    assert compare(changed)["refused"] == bool(field)
    assert (c_design.design(changed).field or "") == field


def test_an_integer_just_below_2_to_62_keeps_its_last_bits() -> None:
    """Process noise of the bias of 2^62 - 96: its double is 2^62."""
    tuning = tunings("quad")["paper"]
    kalman = replace(tuning.kalman, q_angle_deg2_per_s=0.5, q_bias_dps2_per_s=0.25)
    trust = replace(tuning.trust, r_deg2=0.056, r_max_deg2=0.056)
    edge = replace(tuning, period_us=100_000, kalman=kalman, trust=trust)
    words = quantise(edge).values
    assert (words["kalman.qb"] << 30) + words["kalman.qb_frac_q30"] == 2**62 - 96
    assert compare(edge)["one_apart"] == 0
