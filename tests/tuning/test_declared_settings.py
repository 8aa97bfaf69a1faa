"""Settings that a declaration converts: the integers at their limits, and one sentence for each that cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from plumb.contract.parameters import dequantise, quantise
from plumb.errors import SettingError, UsageError
from plumb.spec import declarations
from plumb.spec.settings import Setting, read, read_group
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.quadrotor.scenarios import TUNINGS
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.turntable import scenarios as turntable
from plumb.systems.turntable.tuning import TurntableTuning
from plumb.tuning.quantities import with_value

SHIPPED = TUNINGS["hummingbird"]
DECLARED = [row["name"] for row in declarations.system("quadrotor").parameters]
DT = SHIPPED.period_us * 1e-6


def changed(name: str, value: float) -> QuadrotorTuning:
    tuning: QuadrotorTuning = with_value(SHIPPED, name, value)
    return tuning


@pytest.mark.parametrize(
    ("name", "value", "word", "integer"),
    [
        ("level.lean_max_deg", 30.0, "quadrotor.tilt_max_q30", 1 << 29),
        ("level.lean_max_deg", math.degrees(math.asin(644245094 / 2**30)), "quadrotor.tilt_max_q30", 644245094),
        ("level.gain_per_s", 2 * math.pi, "quadrotor.tilt_gain_q28", 1 << 28),
        ("rates.yaw_max_dps", 180.0, "quadrotor.yaw_rate_max_q28", 1 << 27),
        ("rates.roll.kp_per_dps", 1 / 360, "rate_roll.kp_q29", 1 << 29),
        ("rates.roll.ki_per_deg", 1 / 360, "rate_roll.ki_dt_q35", round(2**35 * DT)),
        ("rates.d_tau_s", 0.0, "quadrotor.d_alpha_q31", (1 << 31) - 1),
        ("rates.d_tau_s", DT / math.log(2.0), "quadrotor.d_alpha_q31", 1 << 30),
        ("receiver.land_mps", 9.80665 / 4, "quadrotor.land_gs_q28", 1 << 26),
        ("receiver.lost_s", 65535 * DT, "quadrotor.lost_steps", 65535),
        ("receiver.lands", 1, "quadrotor.lost_action", 1),
    ],
)
def test_a_setting_is_its_integer_and_comes_back(name: str, value: float, word: str, integer: int) -> None:
    params = quantise(changed(name, value))
    assert params[word] == integer
    again = quantise(dequantise(params))  # at the period as its integer has it, for the settings that it scales
    assert {name: again[name] for name in DECLARED} == {
        name: pytest.approx(params[name], rel=1e-7, abs=1) for name in DECLARED
    }


@pytest.mark.parametrize(
    ("name", "value", "said", "most"),
    [
        ("level.lean_max_deg", 37.0, "0 to 36.87 deg", 36.87),
        ("level.lean_max_deg", -1.0, "it cannot be negative", math.inf),
        ("rates.yaw_max_dps", 1000.0, "too large for its integer, the most is 990", 990.0),
        ("rates.d_tau_s", -0.001, "it cannot be negative", math.inf),
        ("rates.d_tau_s", 1e5, "0 to 1.074e+04 s", 10737.4),
        ("receiver.lost_s", 0.0, "1 to 65535 steps", 65535 * DT),
        ("receiver.land_s", 65535 * DT, "1 to 65534 steps", 65534 * DT),
        ("mixer.airmode", 2, "0 or 1", 1.0),
        ("mixer.idle", 1e-9, "too fine for its integer", 0.25),
        ("stops.idle_s", math.inf, "give a finite number", math.inf),
    ],
)
def test_a_setting_that_cannot_be_is_refused(name: str, value: float, said: str, most: float) -> None:
    with pytest.raises(SettingError, match=name) as caught:
        quantise(changed(name, value))
    assert said in str(caught.value)
    assert caught.value.most == pytest.approx(most, rel=1e-4)


def test_the_gain_of_the_derivative_follows_its_filter() -> None:
    """Twice the share of a new rate is twice the gain on the change of a step."""
    slow, fast = (
        quantise(replace(SHIPPED, rates=replace(SHIPPED.rates, d_tau_s=-DT / math.log1p(-share))))
        for share in (0.25, 0.5)
    )
    assert fast["rate_roll.kd_q28"] == pytest.approx(2 * slow["rate_roll.kd_q28"], abs=2)


GIVEN = {"name": "level.lean_deg", "unit": "deg", "conversion": "/ turn", "doc": "lean"}


def test_a_declared_setting() -> None:
    assert read(GIVEN) == Setting("level.lean_deg", "deg", "lean", "/ turn")
    assert read({**GIVEN, "conversion": "* turn * dt"}).type == "float"
    assert read({**GIVEN, "conversion": "choice", "default": 1}).type == "int"
    assert read({"name": "wheel.edges", "unit": "edge", "doc": "edges", "default": 0}).type == "int"
    assert read({**GIVEN, "low": 1}).limits(0, 9) == (1, 9)


@pytest.mark.parametrize(
    ("name", "value", "word", "integer"),
    [
        ("speed.lean_slew_dps", 1600.0, "speed.slew_q22", 1 << 23),
        ("speed.lean_slew_dps", 1e4, "speed.slew_q22", 1 << 23),  # saturates
        ("speed.lean_slew_dps", 800.0, "speed.slew_q22", 1 << 22),
        ("wheel.edge_m", 0.15, "wheel.edge_mps_q26", 15 << 26),  # its high, 15 m/s, is less than that of the parameter
    ],
)
def test_a_setting_of_balancer_is_its_integer(name: str, value: float, word: str, integer: int) -> None:
    tuned = with_value(balancer.TUNINGS["tuned"], "wheel.accel_share", 0.0)
    assert quantise(with_value(tuned, name, value))[word] == integer


def test_a_setting_that_is_squared_and_one_that_is_a_word() -> None:
    """(3.6 deg/s)^2 is 10^-4 (turn/s)^2, Q40."""
    tuned = with_value(turntable.TUNINGS["data"], "fusion.start_gyro_dps", 3.6)
    assert quantise(tuned)["fusion.p_gyro_bias_q40"] == round(1e-4 * 2**40)
    again = dequantise(quantise(with_value(tuned, "fusion.layer", "printed")))
    assert isinstance(again, TurntableTuning)
    assert again.fusion.layer == "printed"
    assert again.fusion.start_gyro_dps == pytest.approx(3.6, rel=1e-7)
    with pytest.raises(SettingError, match=r"the most is 22\.5") as caught:
        quantise(with_value(tuned, "fusion.start_gyro_dps", 22.6))
    assert caught.value.most == pytest.approx(360 / 16, rel=1e-7)


def test_a_setting_ends_where_its_own_limit_is() -> None:
    with pytest.raises(SettingError, match=r"wheel\.edge_m = 0\.155: too large for its integer, the most is 0\.15"):
        quantise(with_value(balancer.TUNINGS["tuned"], "wheel.edge_m", 0.155))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "lean"}, "its name is that of its group"),
        ({"name": 3}, "its name is that of its group"),
        ({"unit": ""}, "unit is a line of text"),
        ({"doc": 'a "lean"'}, "doc is a line of text without quotes"),
        ({"conversion": "turn"}, "conversion is a formula such as"),
        ({"conversion": "* turn *"}, "conversion is a formula such as"),
        ({"default": "35"}, "default is a number"),
        ({"default": True}, "default is a number"),
        ({"low": 0.5}, "low is a limit of its integer"),
        ({"high": True}, "high is a limit of its integer"),
        ({"saturates": 1}, "saturates is true or false"),
        ({"choices": ["data"]}, "conversion 'word' has choices"),
        ({"conversion": "word"}, "conversion 'word' has choices"),
        ({"conversion": "word", "choices": "data"}, "choices is a list of names"),
        ({"conversion": "word", "choices": ["data", "rate"], "default": "rates"}, "default is one of its choices"),
        ({"conversion": "* turn squared *"}, "conversion is a formula such as"),
        ({"most": 3}, "most is unknown"),
    ],
)
def test_a_setting_that_is_declared_wrongly(change: dict[str, Any], said: str) -> None:  # Any: values as TOML has them
    with pytest.raises(UsageError, match="setting") as caught:
        read({**GIVEN, **change})
    assert said in str(caught.value)


@pytest.mark.parametrize("given", ["Level", {"type": "Level"}, {"type": "level", "doc": "d"}, {"type": 3, "doc": "d"}])
def test_a_group_that_is_declared_wrongly(given: object) -> None:
    with pytest.raises(UsageError, match="settings: "):
        read_group("level", given)
