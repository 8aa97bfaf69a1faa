"""`plumb monitor`: it shows what a board streams, says nothing to a board that is only watched, and ends when asked."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Callable
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.boards.native.port import NativePort
from plumb.cli import monitor_line
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.link import monitor
from plumb.link.session import Session
from plumb.spec import declarations, parameters
from plumb.spec.signals import signals
from support.native_board import UartBoard

RAW = (1690, 2300, 3000, 0, 0, 0)
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> UartBoard:
    memory = UartBoard()
    memory.sensors(RAW)

    def opened(_spec: str, **_options: Any) -> LinkBoard:
        return LinkBoard("memory", Session.open(memory))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    return memory


def looks(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert front.main(["monitor", "--board", "memory", "--json", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return [json.loads(line) for line in captured.out.splitlines()]


def left_running(board: UartBoard, *frames: str, period_us: int = 20_000) -> None:
    """A run that another host began and left behind."""
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=period_us)
        session.begin("REALTIME_LIVE", frames=frames)


def test_a_run_of_its_own_is_shown_in_units(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    shown = looks(capsys, "--run", "live", "--seconds", "1.5")
    assert len(shown) == 15
    last = shown[-1]
    steps = last["step"] + 1
    words = run_fixed.run_control(ControlParams.from_words(CONTROL), [RAW] * steps, [0] * steps)
    assert last["tilt_deg"] == pytest.approx(words["tilt_turn_q32"][-1] * 360 / 2**32, abs=1e-6)
    assert last["tilt_measured_deg"] == pytest.approx(words["tilt_measured_turn_q32"][-1] * 360 / 2**32, abs=1e-6)
    assert last["bias_dps"] == pytest.approx(words["bias_turnps_q28"][-1] * 360 / 2**28, abs=1e-6)
    assert last["rate_dps"] == pytest.approx(words["rate_corrected_turnps_q28"][-1] * 360 / 2**28, abs=1e-6)
    assert last["command"] == pytest.approx(words["command_q22"][-1] / 2**22, abs=1e-9)
    assert last["pulse_0_us"] == words["pulse_halfus_0"][-1] / 2
    assert last["pulse_1_us"] == words["pulse_halfus_1"][-1] / 2
    assert last["raw"] == list(RAW[:3])
    assert (last["mode"], last["live"], last["armed"], last["read_only"]) == ("REALTIME", True, False, False)
    assert last["blocked"] == [] and last["faults"] == []
    # Steps of a second, two more or less at its ends; the looks are 0.1 s apart, to three steps.
    assert last["steps_per_s"] == pytest.approx(50, rel=0.05)
    assert last["time_s"] - shown[0]["time_s"] == pytest.approx(1.4, abs=0.06)
    assert not board.armed
    assert looks(capsys, "--seconds", "0.3")[-1]["mode"] == "IDLE"  # its run was ended


def test_who_only_watches_says_nothing_and_the_run_goes_on(
    board: UartBoard, capsys: pytest.CaptureFixture[str]
) -> None:
    left_running(board, "QUAD_ANGLE")
    sent = b""

    def note(data: bytes) -> bytes:
        nonlocal sent
        sent += data
        return data

    board.spoil_down = note
    before = board.steps
    shown = looks(capsys, "--seconds", "2")
    assert sent.count(b"t") == 1 and b"t7FC8" in sent  # HELLO, and nothing else
    assert sent.endswith(b"\rL\rC\r")
    last = shown[-1]
    assert (last["mode"], last["live"], last["read_only"]) == ("REALTIME", True, True)
    assert last["blocked"] == ["the link is closed or read-only"]
    assert last["tilt_deg"] is not None and last["bias_dps"] is None  # BIAS was not selected
    assert last["host_lost_steps"] == last["host_lost"] == last["host_rejected"] == 0
    # A step every 20 ms for 2 s, and for 200 ms more; the last may be on its way.
    assert board.steps - before >= 99
    board.run_us(200_000)
    assert board.steps - before >= 109


def test_an_idle_board_shows_no_angle(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    last = looks(capsys, "--seconds", "0.5")[-1]
    assert (last["mode"], last["step"], last["tilt_deg"], last["armed"]) == ("IDLE", None, None, False)
    assert "no run is on" in last["blocked"]


def test_the_first_look_waits_for_everything_an_open_link_says(board: UartBoard) -> None:
    with Session.open(board) as session:
        late_us = board.time_us + 250_000
        board.spoil_up = lambda data: data if board.time_us > late_us or b"t111" not in data else b""
        first = next(iter(monitor.watch(session)))
    assert first["mode"] == "IDLE" and first["board_lost"] is not None and first["saturated_steps"] is not None


def test_what_does_not_come_any_more_is_not_shown(board: UartBoard) -> None:
    with Session.open(board) as session:
        monitor.begin_live(session)
        for number, shown in enumerate(monitor.watch(session, 2.0)):
            if number == 5:
                assert shown["tilt_deg"] is not None
                session.end()
        assert shown["tilt_deg"] is None and shown["step"] is None and shown["mode"] == "IDLE"


def test_what_was_lost_is_counted(board: UartBoard) -> None:
    dropped = {b"t100": (7, 9), b"t304": (4,), b"t111": (4,)}
    received = dict.fromkeys(dropped, 0)

    def spoil(data: bytes) -> bytes:
        """Two STEP, one ANGLE and one STATUS less, and one line of noise."""
        out = b""
        for line in data.splitlines(keepends=True):
            kind = line[:4]
            if kind in received:
                received[kind] += 1
                if received[kind] in dropped[kind]:
                    out += b"t1\r" if kind == b"t111" else b""
                    continue
            out += line
        return out

    with Session.open(board) as session:
        monitor.begin_live(session)
        board.spoil_up = spoil
        last = list(monitor.watch(session, 1.0))[-1]
    assert (last["host_lost_steps"], last["host_lost"], last["host_rejected"]) == (2, 2, 1)


def test_the_board_s_faults_are_named(board: UartBoard) -> None:
    board.sensors(RAW, faults=0x101)
    with Session.open(board) as session:
        last = list(monitor.watch(session, 0.3))[-1]
    assert last["faults"] == ["no conversions", "running on the internal oscillator"]
    assert "the board has a fault" in last["blocked"]


@pytest.mark.parametrize("system", declarations.names())
@pytest.mark.parametrize(("period_us", "frames"), [(20_000, 16), (2_000, 4), (1_000, 1), (500, 1)])
def test_a_run_asks_for_no_more_than_the_line_carries(period_us: int, frames: int, system: str) -> None:
    chosen = monitor.selection(period_us, system)
    assert chosen == monitor.selection(100_000, system)[:frames]
    assert (1 + len(chosen)) * 22 * 1e6 / period_us < 92_160


def test_silence_is_link_trouble(board: UartBoard) -> None:
    with Session.open(board) as session, pytest.raises(Exception, match="fell silent") as caught:
        board.spoil_up = lambda _data: b""
        list(monitor.watch(session))
    assert getattr(caught.value, "exit_code", None) == 3


def test_one_line_a_second_where_there_is_no_terminal(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--seconds", "2.5"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 2
    assert all("REALTIME live disarmed  tilt +" in row and "\x1b" not in row for row in rows)
    board.sensors((0,) * 6, faults=0x100)
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--seconds", "1"]) == 0
    said = re.search(
        r"  saturated (\d+)  running on the internal oscillator  not armed: (.*)\n$", capsys.readouterr().out
    )
    assert said and "the sensors are implausible; " in said[2]
    assert 45 <= int(said[1]) <= 50  # of 50 steps; the board counts them out every 0.1 s


def test_a_line_says_volts_and_why_nothing_is_armed(
    board: UartBoard, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert front.main(["monitor", "--board", "memory", "--seconds", "0.3", "--json"]) == 0
    seen = {**json.loads(capsys.readouterr().out.splitlines()[-1]), "faults": [], "armed": False}
    blocked = monitor_line.line({**seen, "battery_v": 7.402, "blocked": ["it moves", "no run"]})
    assert blocked.endswith("  battery 7.40 V  not armed: it moves; no run")
    armed = monitor_line.line({**seen, "battery_v": None, "blocked": ["it moves"], "armed": True})
    assert "battery" not in armed and "it moves" not in armed


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_an_interrupt_ends_the_run_and_is_a_normal_end(
    number: int,
    code: int,
    board: UartBoard,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handler = signal.getsignal(number)
    look: Callable[[monitor.Monitor], monitor.Snapshot] = monitor.Monitor.snapshot

    def interrupted(self: monitor.Monitor) -> monitor.Snapshot:
        if board.steps == 20:
            os.kill(os.getpid(), number)
        return look(self)

    monkeypatch.setattr(monitor.Monitor, "snapshot", interrupted)
    assert front.main(["monitor", "--board", "memory", "--run", "live"]) == code
    assert capsys.readouterr().err == ("plumb: terminated.\n" if code else "")
    steps = board.steps
    board.run_us(100_000)
    assert board.steps == steps  # the run was ended
    assert signal.getsignal(number) is handler


def virtual(*arguments: str) -> None:
    """On the flash image, where there is one."""
    pytest.importorskip("unicorn")
    from plumb.errors import UsageError
    from plumb.flash.image import find_image

    try:
        find_image()
    except UsageError as error:
        pytest.skip(str(error))
    assert front.main(["monitor", "--board", "virtual", *arguments]) == 0


@pytest.mark.slow
def test_on_the_virtual_board_the_quad_s_axis_moves(capsys: pytest.CaptureFixture[str]) -> None:
    virtual("--run", "live", "--seconds", "7.5", "--json")
    tilts = [json.loads(line)["tilt_deg"] for line in capsys.readouterr().out.splitlines()]
    assert len(tilts) == 75
    # 3 deg: the start is forgotten after 2 s, and the bias is nearly learned; the motion that follows is of 20 deg.
    assert max(abs(tilt) for tilt in tilts[20:50]) < 3.0  # at rest for 5 s
    assert max(abs(tilt) for tilt in tilts[50:]) > 5.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "shown"),
    [
        ("balancer", ("tilt_deg", "duty", "velocity_mps")),
        ("turntable", ("attitude", "rates_dps")),
        pytest.param("quad", ("tilt_deg",), marks=pytest.mark.long),  # its axis is looked at above
    ],
)
def test_on_the_virtual_board_any_systems_plant_is_on_the_pins(
    system: str, shown: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """No sensor is missing, and the values are the system's."""
    virtual("--run", "live", "--system", system, "--seconds", "1", "--json")
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["faults"] == [] and last["step"] > 40
    assert all(last[name] is not None for name in shown)
    virtual("--run", "live", "--system", system, "--seconds", "1")
    words = {"balancer": "duty", "turntable": "yaw", "quad": "pulses"}
    assert words[system] in (line := capsys.readouterr().out) and line.count("\n") == 1
    assert not any(other in line for name, other in words.items() if name != system)


def test_a_plant_is_for_the_virtual_board_alone(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["monitor", "--board", "memory", "--system", "balancer"]) == 2
    assert "params tuning SYSTEM" in capsys.readouterr().err
    assert front.main(["monitor", "--board", "memory", "--scenario", "hold"]) == 2


def test_a_value_that_rounds_to_zero_has_no_minus() -> None:
    assert monitor_line.number(-1e-5, "deg") == "+0.000 deg"
    assert monitor_line.number(-0.0006, "") == "-0.001"


def test_a_line_of_a_vehicle_has_its_angles_all_motors_and_its_phase_in_words(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plumb.boards.open_link_board", lambda *_, **__: NativePort("quadrotor", None))
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--seconds", "1"]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert re.search(
        r"  yaw \S+ deg  pitch \S+ deg  roll \S+ deg  pulses 1000.0 1000.0 1000.0 1000.0 us  phase: ", line
    )
    assert "attitude_" not in line and "pulse_2" not in line
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--seconds", "0.5", "--json"]) == 0
    snapshot = json.loads(capsys.readouterr().out.splitlines()[-1])
    declared = [column for _, column, _ in signals("quadrotor")]
    shown = [name for name in snapshot if name in declared]
    assert shown == declared, "signals in declared order"


def test_a_line_of_a_vehicle_on_wheels_has_its_motors_in_per_cent(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plumb.boards.open_link_board", lambda *_, **__: NativePort("wheels", None))
    assert front.main(["monitor", "--board", "memory", "--run", "live", "--seconds", "1"]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert re.search(
        r"  turn rate \S+ deg/s  lean \S+ deg  motors not driven, asked for left \S+ % right \S+ %  phase: ", line
    ), line


def test_motors_are_named_where_a_system_drives_several() -> None:
    assert monitor.motors_of({"left": -0.5, "right": None}, "wheels") == {"left": -0.5}
    assert monitor.motors_of({"duty": 0.5}, "balancer") == {} == monitor.motors_of({}, None)


def test_a_choice_is_named_as_its_declaration_says() -> None:
    assert monitor.choices_of({"phase": 2.0}, "quadrotor") == {"phase": "landing without one"}
    assert (
        monitor.choices_of({"phase": 9.0}, "quadrotor") == {"phase": "9"}
        and monitor.choices_of({"phase": 1.0}, None) == {}
    )
    assert monitor.flags_set({"flags": None}, "quadrotor") is None
    first, second = (flag.name for flag in declarations.system("quadrotor").flags[:2])
    assert monitor.flags_set({"flags": 3.0}, "quadrotor") == [first, second]
