"""Whatever a program hands to the public functions, a mistake is one sentence of a PlumbError."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import plumb

NAN = float("nan")
ROWS = np.zeros((5, 3))
COUNTS = np.zeros((5, 3), np.int16)
ENDLESS = np.broadcast_to(np.zeros((1, 3), np.int16), (1 << 40, 3))
"""Terabytes, if it were copied."""
api: Any = plumb  # a hostile caller has no type checker

CALLS: dict[str, Callable[[], object]] = {
    "system None": lambda: api.Estimator(None),
    "system list": lambda: api.Estimator(["quad"]),
    "tuning list": lambda: api.Estimator("quad", ["adaptive"]),
    "period text": lambda: api.Estimator("quad", period_s="0.01"),
    "full scale text": lambda: api.Estimator("quad", gyr_range_dps="500"),
    "complex samples": lambda: api.Estimator("quad").run(ROWS + 1j, ROWS),
    "ragged samples": lambda: api.Estimator("quad").run([[1, 2, 3], [1, 2]], ROWS),
    "dates": lambda: api.Estimator("quad").run(ROWS.astype("datetime64[s]"), ROWS),
    "texts": lambda: api.Estimator("quad").run([["1", "2", "3"]], ROWS[:1]),
    "too many samples": lambda: api.Estimator("quad").run(np.broadcast_to(ROWS[:1], (9_000_000, 3)), ROWS),
    "no sample": lambda: api.Estimator("quad").step(None, None),
    "channels list": lambda: api.Estimator("balancer").run(ROWS, ROWS, channels=[1]),
    "run system None": lambda: api.run(None),
    "run board None": lambda: api.run("quad", board=None),
    "run seed float": lambda: api.run("quad", seed=1.5),
    "run seed text": lambda: api.run("quad", seed="a"),
    "run seconds text": lambda: api.run("quad", seconds="3"),
    "run seconds nan": lambda: api.run("quad", seconds=NAN),
    "run faults number": lambda: api.run("quad", faults=3),
    "run faults of numbers": lambda: api.run("quad", faults=[3]),
    "run conditions list": lambda: api.run("quad", conditions=["a"]),
    "run conditions text": lambda: api.run("quad", conditions={"bandwidth_hz": "x"}),
    "run scenario list": lambda: api.run("quad", scenario=[]),
    "run start list": lambda: api.run("quad", start=[1]),
    "run link": lambda: api.run("quad", board="virtual", link="usb"),
    "run image number": lambda: api.run("quad", board="virtual", image=3),
    "connect None": lambda: api.connect(None),
    "connect bytes": lambda: api.connect(b"native"),
    "connect link": lambda: api.connect("virtual", link="usb"),
    "connect seed": lambda: api.connect("native", seed="x"),
    "connect image": lambda: api.connect("virtual", image=3),
    "load None": lambda: api.load(None),
    "load zero byte": lambda: api.load("a\0.csv"),
    "golden None": lambda: api.golden.check(None),
    "golden numbers": lambda: api.golden.check([3]),
    "golden nothing": lambda: api.golden.check([]),
    "golden systems": lambda: api.golden.check(["native"], 3),
    "golden names": lambda: api.golden.check(["native"], names=[3]),
    "golden folder": lambda: api.golden.check(["native"], folder=3),
    "golden link": lambda: api.golden.check(["virtual"], link="usb"),
}
ON_A_BOARD: dict[str, Callable[[Any], object]] = {
    "name number": lambda board: board.params[3],
    "name list": lambda board: board.params[["a"]],
    "value None": lambda board: board.params.update({"pid.kp": None}),
    "value array": lambda board: board.params.update({"pid.kp": np.array([1.0, 2.0])}),
    "value complex": lambda board: board.params.update({"pid.kp": 1j}),
    "value of 400 digits": lambda board: board.params.update({"pid.kp": 10**400}),
    "count of 400 digits": lambda board: board.params.update({"arm_hold_ms": 10**400}),
    "update list": lambda board: board.params.update([("pid.kp", 1)]),
    "describe number": lambda board: board.params.describe(3),
    "ragged counts": lambda board: board.run("quad", raw=[[1, 2], [1]]),
    "endless counts": lambda board: board.run("quad", raw=ENDLESS),
    "texts for counts": lambda board: board.run("quad", raw=[["a"] * 3]),
    "counts out of range": lambda board: board.run("quad", raw=np.full((5, 3), 99999)),
    "setpoint text": lambda board: board.run("quad", raw=COUNTS, setpoint="x"),
    "setpoint too large": lambda board: board.run("quad", raw=COUNTS, setpoint=[1 << 40] * 5),
    "setpoint shape": lambda board: board.run("quad", raw=COUNTS, setpoint=np.zeros(4, np.int32)),
    "system None": lambda board: board.run(None, raw=COUNTS),
    "nan": lambda board: board.run("quad", gyr_radps=ROWS + NAN, acc_mps2=ROWS),
    "stream nan": lambda board: list(board.stream(NAN)),
    "stream text": lambda board: list(board.stream("1")),
}
AFTER_LEAVING: dict[str, Callable[[Any], object]] = {
    "params": lambda board: board.params,
    "run": lambda board: board.run("quad", raw=COUNTS),
    "stream": lambda board: list(board.stream(0.1)),
    "arm": lambda board: board.arm(),
    "disarm": lambda board: board.disarm(),
    "identity": lambda board: board.identity,
    "with": lambda board: board.__enter__(),
}


def sentence(call: Callable[[], object]) -> str:
    """The message of the error that the call ends in."""
    with pytest.raises(plumb.PlumbError) as caught:
        call()
    said = str(caught.value)
    assert said and len(said) < 400 and "Traceback" not in said
    return said


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_argument_is_a_sentence(name: str) -> None:
    assert "\n" not in sentence(CALLS[name])


@pytest.mark.parametrize("name", ON_A_BOARD)
def test_a_wrong_argument_to_a_board_is_a_sentence_and_changes_nothing(name: str) -> None:
    with plumb.connect("native", system="quad") as board:
        before = board.params.words
        sentence(lambda: ON_A_BOARD[name](board))
        assert board.params.words == before


@pytest.mark.parametrize("name", AFTER_LEAVING)
def test_a_board_that_was_left_says_so(name: str) -> None:
    with plumb.connect("native", system="quad") as board:
        _ = board.params
    assert "closed: connect again" in sentence(lambda: AFTER_LEAVING[name](board))


def test_two_boards_at_once_have_nothing_to_do_with_each_other() -> None:
    with plumb.connect("native", system="quad") as one, plumb.connect("native", system="balancer") as two:
        one.params["pid.kp"] = 0.03
        two.params["pid.kp"] = 0.06
        assert one.params["pid.kp"] == pytest.approx(0.03, rel=1e-3)
        samples = list(one.stream(0.1))
        assert "velocity_mps" in list(two.stream(0.1))[-1].signals and "velocity_mps" not in samples[-1].signals


def test_a_board_that_goes_away_is_link_trouble_and_can_be_left() -> None:
    def lose_it() -> None:
        with plumb.connect("native", system="quad") as board:
            port: Any = board._session() and board._talks_to
            for _ in board.stream(1.0):
                port.mcu.power_off()

    with pytest.raises(plumb.LinkError):
        lose_it()
