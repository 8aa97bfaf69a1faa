"""plumb.connect: a board that is left, in whatever way, is disarmed at once, and its outputs are neutral.

On the shipped main loop in this process, and on the flash image over its UART and over CAN: in simulated time.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Literal, NamedTuple

import pytest

import plumb
from plumb.api.connection import Board
from plumb.boards.native.port import NativePort
from plumb.boards.virtual import VirtualBoard
from plumb.link.monitor import Monitor
from plumb.link.session import Session

NEUTRAL_US = 1000.0
SETTLE_US = 25_000
"""More than a frame of pulses, and less than the 40 ms after which a board without keep-alive disarms."""
LISTEN_S = 0.3


class Kind(NamedTuple):
    """A board and the link to it."""

    board: str
    link: Literal["serial", "can"]


KINDS = [Kind("native", "serial"), Kind("virtual", "serial"), Kind("virtual", "can")]


class Outside:
    """The board as its actuators and a second host see it."""

    def __init__(self, board: Board) -> None:
        talks_to = board._talks_to
        assert isinstance(talks_to, NativePort | VirtualBoard)
        self._board = talks_to

    def pulses_us(self) -> list[float]:
        if isinstance(self._board, NativePort):
            return [half_us / 2.0 for half_us in self._board.mcu.wires.pulse_halfus[:2]]
        return [self._board.machine.pwm(pin).pulse_us for pin in ("PB6", "PB7")]

    def let_pass(self, time_us: int) -> None:
        if isinstance(self._board, NativePort):
            self._board.mcu.run_us(time_us)
        else:
            self._board.machine.advance_us(time_us)

    def disarm_cause(self) -> list[str]:
        """The report to a host that connects now."""
        board = self._board
        session = Session.open(board.mcu.uart) if isinstance(board, NativePort) else board.reconnect()
        monitor = Monitor(session)
        session.listener = monitor.feed
        end_s = session.clock() + LISTEN_S
        while session.clock() < end_s:
            session.receive(0.05)
        assert monitor.snapshot()["armed"] is False
        cause: list[str] = monitor.snapshot()["disarm_cause"]
        session.close()
        return cause


def armed_and_driving(board: Board) -> Outside:
    """Arm the board, and stream until its outputs leave neutral."""
    board.params["arm_hold_ms"] = 0
    assert not board.armed
    board.arm()
    assert board.armed
    outside = Outside(board)
    for sample in board.stream(1.0):
        if sample.armed and NEUTRAL_US not in outside.pulses_us():
            break
    assert NEUTRAL_US not in outside.pulses_us()
    return outside


def left_plainly(_: Board) -> None:
    return


def left_by_an_exception(_: Board) -> None:
    raise RuntimeError("of the caller")


def left_by_ctrl_c(board: Board) -> None:
    for _ in board.stream(1.0):
        signal.raise_signal(signal.SIGINT)


def left_inside_an_interrupted_exit(board: Board) -> None:
    """Ctrl-C while the board is being closed waits until it is closed."""
    session = board._session()
    end = session.end

    def interrupted() -> int:
        signal.raise_signal(signal.SIGINT)
        return end()

    session.end = interrupted  # type: ignore[method-assign]


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
@pytest.mark.parametrize(
    ("leave", "error"),
    [
        (left_plainly, None),
        (left_by_an_exception, RuntimeError),
        (left_by_ctrl_c, KeyboardInterrupt),
        (left_inside_an_interrupted_exit, KeyboardInterrupt),
    ],
)
def test_leaving_disarms(kind: Kind, leave: Callable[[Board], None], error: type[BaseException] | None) -> None:
    """By the host's word, not by its silence."""
    seen = []

    def leave_it() -> None:
        with plumb.connect(kind.board, link=kind.link, system="quad") as board:
            seen.append(armed_and_driving(board))
            leave(board)

    if error is None:
        leave_it()
    else:
        with pytest.raises(error):
            leave_it()
    (outside,) = seen
    outside.let_pass(SETTLE_US)
    assert outside.pulses_us() == [NEUTRAL_US, NEUTRAL_US]
    assert outside.disarm_cause() == ["the host disarmed"]


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_disarm_goes_on_with_the_run(kind: Kind) -> None:
    with plumb.connect(kind.board, link=kind.link, system="quad") as board:
        outside = armed_and_driving(board)
        board.disarm()
        samples = list(board.stream(0.2))
        assert not samples[-1].armed and samples[-1].health.disarm_cause == ("the host disarmed",)
        assert outside.pulses_us() == [NEUTRAL_US, NEUTRAL_US]
