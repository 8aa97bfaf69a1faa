"""The display of `plumb monitor` on a terminal, its keys, and --reconnect."""

from __future__ import annotations

import io
import os
import re
import select
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.cli import monitor as command
from plumb.errors import LinkError
from plumb.link.monitor import Extremes, begin_live, watch
from plumb.link.session import Session
from support.native_board import UartBoard

pytest.importorskip("rich", reason="the display of plumb monitor needs rich (the extra monitor)")
from rich.console import Console

from plumb.cli.keyboard import Keyboard
from plumb.cli.monitor_screen import Screen, sparkline

RAW = (1690, 2300, 3000, 0, 0, 0)
ALTERNATE, ORDINARY = "\x1b[?1049h", "\x1b[?1049l"
COLOUR = re.compile(r"\x1b\[(?:\d+;)*(?:3[0-7]|4[0-7])m")


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> UartBoard:
    memory = UartBoard()
    memory.sensors(RAW)
    monkeypatch.setattr("plumb.boards.open_link_board", lambda *_, **__: LinkBoard("memory", Session.open(memory)))
    return memory


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 100 by 40; `monitored` makes stdout one."""
    for name, value in {"COLUMNS": "100", "LINES": "40", "TERM": "xterm-256color"}.items():
        monkeypatch.setenv(name, value)
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """stdin is a terminal; the function types keys into it."""
    import pty

    master, slave = pty.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield lambda text: (os.write(master, text.encode()), None)[1]
    os.close(master)


def monitored(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[str, str]:
    """stdout and stderr of the command, with stdout as a terminal."""
    with pytest.MonkeyPatch.context() as patch:  # here, because pytest replaces stdout after a fixture
        patch.setattr("sys.stdout.isatty", lambda: True)
        assert front.main(["monitor", "--board", "memory", "--run", "live", *arguments]) == 0
    captured = capsys.readouterr()
    return captured.out, captured.err


def text_of(drawn: str) -> str:
    return re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", drawn)


def screen_of(width: int = 100, height: int = 40, encoding: str = "utf-8") -> tuple[Screen, io.BytesIO]:
    out = io.BytesIO()
    file = io.TextIOWrapper(out, encoding=encoding, write_through=True)
    console = Console(file=file, force_terminal=True, width=width, height=height, highlight=False, color_system=None)
    return Screen(console), out


@pytest.mark.usefixtures("terminal")
def test_the_display_shows_the_values_their_extremes_and_the_state(
    board: UartBoard, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two seconds are whole periods: the display ends while the frames of the newest step are on the line."""
    out, _ = monitored(capsys, "--seconds", "2")
    assert out.count(ALTERNATE) == out.count(ORDINARY) == 1
    last = text_of(out.split(ORDINARY)[1])
    tilt = re.search(r"^ tilt +([+-][\d.]+) +deg +([+-][\d.]+) +([+-][\d.]+)", last, re.MULTILINE)
    assert tilt and float(tilt[2]) <= float(tilt[1]) <= float(tilt[3]) and float(tilt[2]) < float(tilt[3])
    assert (
        re.search(rf"REALTIME live    disarmed    step {board.steps - 1}\b", last) and "nothing blocks arming" in last
    )
    assert re.search(r"^ rate .*deg/s.*^ faults +none", last, re.MULTILINE | re.DOTALL)
    assert COLOUR.search(out)


@pytest.mark.usefixtures("board", "terminal")
def test_no_color_takes_the_colours_away(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    out, _ = monitored(capsys, "--seconds", "0.5")
    assert ALTERNATE in out and not COLOUR.search(out)


@pytest.mark.usefixtures("board", "terminal")
@pytest.mark.parametrize("why", ["lines", "dumb", "no rich"])
def test_lines_where_the_display_cannot_be_or_is_not_wanted(
    why: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    if why == "no rich":
        monkeypatch.setitem(sys.modules, "rich.console", None)
    out, err = monitored(capsys, "--seconds", "2", *(["--lines"] if why == "lines" else []))
    assert "\x1b" not in out and out.count("\n") == 2
    assert ("the display needs rich; install it" in err) == (why == "no rich")


def test_extremes_are_those_of_every_frame_and_not_of_the_looks(board: UartBoard) -> None:
    extremes = Extremes()
    with Session.open(board) as session:
        begin_live(session)
        looks = watch(session, 1.0, extremes)
        for _ in range(4):
            next(looks)
        board.sensors((1690, 3000, 2300, 0, 0, 0))  # for two of the five steps between two looks
        board.run_us(40_000)
        board.sensors(RAW)
        seen = [look["tilt_measured_deg"] for look in looks]
        high, low = extremes.high["tilt_measured_deg"], extremes.low["tilt_measured_deg"]
        # The counts of two steps are those of another tilt by tens of degrees.
        assert min(seen) - low > 20 or high - max(seen) > 20
        extremes.forget()
        assert extremes.low == extremes.high == {}
        session.end()


def look(**values: object) -> dict[str, Any]:
    """A snapshot of an idle board with these values."""
    with Session.open(UartBoard()) as session:
        return {**next(iter(watch(session, 0.1))), **values}


def test_a_small_terminal_gets_whole_rows_and_one_without_unicode_ascii() -> None:
    screen, out = screen_of(width=60, height=10, encoding="ascii")
    faults = ["a sensor is lost", "input PA0 is at a rail", "input PA1 is at a rail", "input PA2 is at a rail"]
    with screen:
        for step in range(3):
            screen.show(look(tilt_deg=float(step), faults=faults), Extremes())
        drawn = out.getvalue().decode()
    assert drawn.isascii()
    pictures = [text_of(picture).splitlines() for picture in drawn.split("\x1b[H")[1:]]
    assert all(len(row) <= 60 for rows in pictures for row in rows) and max(map(len, pictures)) == 10
    after = " ".join(text_of(out.getvalue().decode()[len(drawn) :]).split())
    assert after.count("is at a rail") == 3 and after.count("input") == 3  # on the ordinary screen nothing is cut


COUNTED = (
    *("saturated_steps", "starved_steps", "can_off_bus", "can_transmit_errors", "can_receive_errors", "can_bus_offs"),
    *("host_lost_steps", "host_lost", "host_rejected", "board_lost", "board_rejected", "board_dropped"),
)


@pytest.mark.parametrize("name", [*COUNTED, None])
def test_counters_are_one_row_while_nothing_is_lost(name: str | None) -> None:
    screen, out = screen_of()
    zero: dict[str, object] = dict.fromkeys(COUNTED, 0)
    with screen:
        screen.show(look(**{**zero, **({} if name is None else {name: 3})}), Extremes())
    shown = text_of(out.getvalue().decode())
    assert ("all zero" in shown) is (name is None)
    assert all((row in shown) is (name is not None) for row in ("starved", "errors sent", "other frames"))


def test_the_course_keeps_its_shape_and_shows_gaps() -> None:
    values = [(0.1 * k, float(k % 10)) for k in range(1, 101)]
    first = sparkline(values, 10.0, 10.0, 10)
    assert len(first) == 10
    peak = [(0.1 * k, 1.0 if 40 <= k < 50 else 0.0) for k in range(100)]
    assert sparkline(peak, 9.95, 10.0, 10) == "▁▁▁▁█▁▁▁▁▁"
    assert sparkline(peak, 11.95, 10.0, 10) == "▁▁█▁▁▁▁▁  "  # two spans later, no values since
    assert sparkline([], 1.0, 10.0, 5) == "     "
    assert sparkline([(0.5, 3.0)], 0.5, 10.0, 5) == "    ▁"


@pytest.mark.usefixtures("terminal")
def test_keys_freeze_forget_change_the_span_and_end(typed: Callable[[str], None]) -> None:
    screen, out = screen_of()
    extremes = Extremes()
    with screen:
        screen.show(look(tilt_deg=1.0), extremes)
        extremes.note("tilt_deg", 80.0)
        typed("r")
        assert not screen.ended()
        screen.show(look(tilt_deg=2.0), extremes)
        assert "tilt_deg" not in extremes.high
        typed("+++")
        assert not screen.ended() and screen.window_s == 120
        typed("-")
        assert not screen.ended() and screen.window_s == 60
        typed(" ")
        assert not screen.ended()
        before = len(out.getvalue())
        screen.show(look(tilt_deg=77.0), extremes)
        frozen = text_of(out.getvalue()[before:].decode())
        assert "frozen" in frozen and "77.000" not in frozen
        typed("\x1b[A")  # cursor up is not Esc
        assert not screen.ended()
        typed("q")
        assert screen.ended()


@pytest.mark.usefixtures("board", "terminal")
def test_q_ends_the_command(
    capsys: pytest.CaptureFixture[str], typed: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Screen, "begin", lambda _self, _identity: typed("q"))
    out, _ = monitored(capsys, "--seconds", "30")
    # A picture every 0.1 s would be 300 until the end that was asked for.
    assert ORDINARY in out and out.count("\x1b[H") < 5


def test_the_terminal_is_as_before_after_the_keys(typed: Callable[[str], None]) -> None:
    import termios

    before = termios.tcgetattr(sys.stdin.fileno())
    with Keyboard() as keyboard:
        assert not termios.tcgetattr(sys.stdin.fileno())[3] & termios.ECHO
        typed("ab")
        select.select([sys.stdin], [], [], 5.0)
        assert list(keyboard.pressed()) == ["a", "b"]
    assert termios.tcgetattr(sys.stdin.fileno()) == before


def test_where_stdin_is_no_terminal_there_are_no_keys(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "keys").write_text("q")
    with (tmp_path / "keys").open() as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        with Keyboard() as keyboard:
            assert list(keyboard.pressed()) == []


class Cut:
    """A board whose cable is cut after so many looks, and back after two attempts to open it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, board: UartBoard) -> None:
        self.attempts, self.board = 0, board
        self.between: Callable[[], None] = lambda: None
        monkeypatch.setattr("plumb.boards.open_link_board", self.opened)
        monkeypatch.setattr(command, "RECONNECT_INTERVAL_S", 0.0)

    def opened(self, *_: Any, **__: Any) -> LinkBoard:
        self.attempts += 1
        if self.attempts in (1, 3):
            raise LinkError("there is no port memory")
        if self.attempts == 4:
            self.board.spoil_up = lambda data: data
            self.between()
        if self.attempts == 2:
            self.board.spoil_up = self._until_cut
        return LinkBoard("memory", Session.open(self.board))

    def _until_cut(self, data: bytes) -> bytes:
        return data if self.board.steps < 20 else b""


def test_it_waits_for_the_board_and_comes_back_to_its_run(
    board: UartBoard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = Cut(monkeypatch, board)
    tick = iter(range(10**6))
    monkeypatch.setattr(time, "monotonic", lambda: next(tick) * 0.01)
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--reconnect", "--json", "--seconds", "9"]) == 0
    captured = capsys.readouterr()
    assert cut.attempts == 4 and '"mode": "REALTIME"' in captured.out.splitlines()[-1]
    assert captured.err.count("there is no port memory; trying again") == 2
    assert captured.err.count("fell silent") == 1
    steps = board.steps
    board.run_us(100_000)
    assert board.steps == steps  # its run was ended, after the second connection


def test_a_run_that_another_host_began_meanwhile_goes_on(
    board: UartBoard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = Cut(monkeypatch, board)

    def another_host() -> None:
        with Session.open(board) as session:
            session.end()
            for _ in range(2):
                session.begin("REALTIME_LIVE", frames=())

    cut.between = another_host
    tick = iter(range(10**6))
    monkeypatch.setattr(time, "monotonic", lambda: next(tick) * 0.01)
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--reconnect", "--json", "--seconds", "9"]) == 0
    assert '"mode": "REALTIME"' in capsys.readouterr().out.splitlines()[-1]
    steps = board.steps
    board.run_us(100_000)
    assert board.steps > steps


def test_without_reconnect_a_lost_board_is_link_trouble_and_the_virtual_board_is_never_lost(
    board: UartBoard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Cut(monkeypatch, board)
    assert front.main(["monitor", "--board", "memory"]) == 3
    assert front.main(["monitor", "--board", "virtual", "--reconnect"]) == 2
    assert "--board virtual is never lost" in capsys.readouterr().err


def test_ctrl_c_while_it_waits_for_the_board_is_a_normal_end(
    board: UartBoard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Cut(monkeypatch, board)

    def interrupted(_self: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(command.Watching, "pause", interrupted)
    assert front.main(["monitor", "--board", "memory", "--reconnect"]) == 0
    assert "Traceback" not in capsys.readouterr().err
