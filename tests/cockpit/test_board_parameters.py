"""Parameters of the board under the cockpit: in units, live gains, what an armed board takes, refusals."""

from __future__ import annotations

import pytest

from support.cockpit_bench import HOLDER, CockpitBench, colour, run_number


def described(bench: CockpitBench, name: str) -> dict[str, object]:
    said = bench.answer("describe", name=name)
    assert said["good"], said
    about = said["parameter"]
    assert isinstance(about, dict)
    return about


def test_parameters_are_read_and_described_in_units(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    listed = {row["name"]: row for row in bench.answer("parameters")["parameters"]}  # type: ignore[attr-defined]
    about = described(bench, "pid.kp_per_deg")
    assert about["value"] == listed["pid.kp_per_deg"]["value"] and about["unit"] == "1/deg" and not about["locked"]
    live = {name for name, row in listed.items() if row["live"]}
    assert live == {"pid.kp_per_deg", "pid.ki_per_deg_s", "pid.kd_per_dps"}
    assert not bench.answer("describe", name="pid.no_such")["good"]


def test_a_write_of_what_is_not_live_begins_a_new_run(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    assert bench.answer("set", name="kalman.q_angle", value=0.004)["good"]
    bench.turn(0.5)
    assert run_number(bench) == 2 and colour(bench) == "green"
    assert described(bench, "kalman.q_angle")["value"] == pytest.approx(0.004, rel=1e-3)
    assert bench.answer("set", name="tilt", choice="arcsine")["good"]
    bench.turn(0.2)
    assert run_number(bench) == 3


@pytest.mark.parametrize("armed", [False, True])
def test_a_live_gain_changes_while_the_run_goes_on_and_the_light_stays_green(bench: CockpitBench, armed: bool) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    if armed:
        bench.arm()
    bench.turn(0.5)
    before = float(described(bench, "pid.kp_per_deg")["value"])  # type: ignore[arg-type]
    for factor in (1.5, 0.75):
        assert bench.answer("set", name="pid.kp", value=factor * before)["good"]
        bench.turn(0.5)
        assert run_number(bench) == 1 and colour(bench) == "green" and bench.armed is armed
        now = described(bench, "pid.kp_per_deg")
        assert now["value"] == pytest.approx(factor * before, rel=1e-3)
    words = bench.board.session.read_parameters()
    assert list(words) == list(bench.loop._words), "the pages get the table of the board"


def test_an_armed_board_takes_a_live_gain_to_half_or_twice_and_nothing_else(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    about = described(bench, "pid.kp")
    value, limits = about["value"], about["limits"]
    assert isinstance(value, float) and isinstance(limits, list)
    low, high = limits
    assert (low, high) == pytest.approx((value / 2, value * 2))
    for wrong in (0.45 * value, 2.1 * value, 0.0, -value):
        said = bench.answer("set", name="pid.kp", value=wrong)
        assert not said["good"] and "half or twice" in str(said["text"])
    for edge in (high, low):
        assert bench.answer("set", name="pid.kp", value=edge)["good"]
        assert described(bench, "pid.kp")["limits"] == limits, "of the value at arming, whatever was written since"
        assert bench.answer("set", name="pid.kp", value=value)["good"]
    for name, verb in (("kalman.q_angle", "set"), ("kalman.q_bias", "set"), ("", "save"), ("", "run")):
        said = bench.answer(verb, name=name, value=1.0)
        assert not said["good"] and "armed" in str(said["text"]), verb
    assert "Locked" in str(described(bench, "kalman.q_angle")["locked"])
    bench.turn(0.3)
    assert bench.armed and run_number(bench) == 1 and colour(bench) == "green"


def test_a_gain_of_0_stays_0_while_armed(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    assert bench.answer("set", name="pid.ki", value=0.0)["good"]
    bench.arm()
    assert "0" in str(described(bench, "pid.ki")["locked"])
    assert not bench.answer("set", name="pid.ki", value=0.1)["good"]
    bench.turn(0.2)
    assert bench.armed


@pytest.mark.parametrize(
    "order",
    [
        {"name": "pid.kp_per_deg", "value": 1e6},
        {"name": "pid.no_such", "value": 1.0},
        {"name": "tilt", "choice": "sideways"},
        {"name": "pid.kp_per_deg", "choice": "fast"},
        {"name": "calibration.gyro.min_counts", "value": 0.5},
    ],
)
def test_a_value_that_cannot_be_is_refused_and_the_run_goes_on(
    bench: CockpitBench, order: dict[str, float | str]
) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    said = bench.ask("set", HOLDER, **order)
    bench.turn(0.3)
    assert said[0]["good"] is False and said[0]["text"]
    assert bench.loop.state["light"]["colour"] == "green"  # type: ignore[index]
