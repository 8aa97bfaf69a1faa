"""`plumb setup`: the whole way on a simulated board, and each step on a board that another process serves."""

from __future__ import annotations

import argparse
import builtins
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.calibration import rest_check
from plumb.cli import setup
from plumb.cli.questions import Answers, Terminal
from plumb.errors import LinkError, UsageError
from plumb.files import settings
from plumb.link import discovery, parameter_history, parameter_table
from plumb.link.discovery import Answer, Candidate
from plumb.link.identity import Identity
from plumb.link.session import Session
from plumb.spec.parameter_file import by_name
from support.declared_systems import without_part
from support.native_board import UartBoard


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in ("CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{place}_HOME", str(tmp_path / place))


def answers(folder: Path, **said: str | bool) -> Path:
    path = folder / "answers.toml"
    path.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in said.items()))
    return path


@pytest.mark.slow
def test_setup_ends_green_without_anybody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = answers(tmp_path, system="balancer", calibrate=True, write=True, save=False)
    assert front.main(["setup", "--board", "native", "--answers", str(said), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"green": True, "board": "native", "calibrated": True, "troubles": []}
    steps = [line for line in captured.err.splitlines() if line[:1].isdigit()]
    assert [line[0] for line in steps] == ["1", "3", "4", "6"]
    assert "in use until the board is reset" in captured.err
    assert settings.read() == {}  # a simulated board is not remembered


@pytest.mark.long
def test_setup_ends_green_on_the_flash_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = answers(tmp_path, board="virtual", system="quad", calibrate=True, write=True, save=True)
    assert front.main(["setup", "--answers", str(said)]) == 0
    assert capsys.readouterr().out.startswith("GREEN: tilt ")


def test_an_answer_that_is_missing_names_its_question(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = answers(tmp_path, system="balancer")
    assert front.main(["setup", "--board", "native", "--answers", str(said)]) == 2
    assert "does not answer 'calibrate'" in capsys.readouterr().err
    assert front.main(["setup", "--answers", str(said)]) == 2
    assert "does not answer 'board'" in capsys.readouterr().err


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> Iterator[UartBoard]:
    """A board in memory, behind the name serial:memory."""
    memory = UartBoard()
    memory.run_us(50_000)
    monkeypatch.setattr("plumb.boards.open_link_board", lambda spec: LinkBoard(spec, Session.open(memory)))
    yield memory


def test_the_shipped_parameters_are_set_when_that_is_wanted_and_remembered(board: UartBoard, tmp_path: Path) -> None:
    arguments = argparse.Namespace(system=None, image=None, seed=1)
    for tuning in (False, True):
        asked = Answers(answers(tmp_path, system="balancer", tuning=tuning))
        opened, put = setup.open_board("serial:memory", arguments, asked)
        assert put is None
        table = by_name(parameter_table.read_table(opened.session))
        assert (table["system"], table["pins"]) == ((1, 1) if tuning else (0, 0))
        unique_id = opened.session.require_match().unique_id
    (change,) = parameter_history.read(unique_id)
    assert (change.did, change.tuning) == ("tuning balancer tuned", "tuned")


@pytest.mark.parametrize(
    ("sensors", "tuning", "accel_bus"),
    [
        ("mpu6050", "mpu6050", 2),
        ("adxl345_itg3205", "adxl345_itg3205", 0),
        ("icm20602", "mpu6050", 3),
        ("mpu9250", "mpu6050", 4),
    ],
)
def test_the_sensors_that_are_wired_choose_the_tuning(
    board: UartBoard, tmp_path: Path, sensors: str, tuning: str, accel_bus: int
) -> None:
    arguments = argparse.Namespace(system="attitude", image=None, seed=1)
    asked = Answers(answers(tmp_path, tuning=True, sensors=sensors))
    opened, _ = setup.open_board("serial:memory", arguments, asked)
    table = by_name(parameter_table.read_table(opened.session))
    assert (table["accel_bus"], table["gyro.gain"]) == (accel_bus, 51872 if accel_bus == 0 else 45467)
    assert parameter_history.read(opened.session.require_match().unique_id)[-1].tuning == tuning
    with pytest.raises(UsageError, match=r"sensors = 'gy85' is none of adxl345_itg3205, mpu6050, icm20602, mpu9250"):
        setup.open_board("serial:memory", arguments, Answers(answers(tmp_path, tuning=True, sensors="gy85")))


def test_an_image_without_a_system_that_has_poses_is_named(
    board: UartBoard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unasked = argparse.Namespace(system=None, image=None, seed=1)
    name = without_part("poses")
    monkeypatch.setattr(Identity, "systems", (name,))
    with pytest.raises(UsageError, match=f"has only {name}, which plumb cannot calibrate: plumb flash --image \\w+"):
        setup.open_board("serial:memory", unasked, Answers(answers(tmp_path)))


def test_a_sensor_that_is_missing_ends_it(board: UartBoard, monkeypatch: pytest.MonkeyPatch) -> None:
    with Session.open(board) as session:
        setup.look_at_sensors(session)
        monkeypatch.setattr("plumb.calibration.axis_calibration.sensors_text", lambda said: ["gyro: does not answer"])
        with pytest.raises(LinkError, match=r"gyro: does not answer: wire it as in docs/wiring"):
            setup.look_at_sensors(session)


@pytest.mark.parametrize(
    ("answer", "said", "default"),
    [
        (Answer(Candidate("x", ""), None, "nobody answers"), "nobody answers", True),
        (Answer(Candidate("x", ""), Identity({"UNIQUE_ID_2": 5}, "other definitions")), "other definitions", True),
        (Answer(Candidate("x", ""), Identity({"UNIQUE_ID_2": 5, "SYSTEMS": 1}, None)), "it has no attitude", True),
        (Answer(Candidate("x", ""), Identity({"UNIQUE_ID_2": 5, "SYSTEMS": 16}, None)), "with attitude (image", False),
    ],
)
def test_flashing_is_offered_where_it_helps(
    answer: Answer, said: str, default: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flashed: list[argparse.Namespace] = []
    monkeypatch.setattr(discovery, "ask", lambda candidate: answer)
    monkeypatch.setattr("plumb.flash.image.find_image", lambda image: Path("firmware.bin"))
    monkeypatch.setattr("plumb.cli.flash.main", flashed.append)
    arguments = argparse.Namespace(image=None, system="attitude")

    class Enter:
        """Takes every default."""

        def agree(self, key: str, text: str, default: bool) -> bool:
            return default

        def wait(self, text: str) -> None:
            assert "BOOT0 to 0" in text

    asked: Any = Enter()
    setup.flash("serial:/dev/ttyUSB0", arguments, asked)
    assert said in capsys.readouterr().err
    assert [one.port for one in flashed] == ["/dev/ttyUSB0"] * default
    setup.flash("can:socketcan:can0", arguments, asked)  # there is no bootloader on CAN
    setup.flash("serial:socket://127.0.0.1:4000", arguments, asked)
    assert len(flashed) == default


def test_the_board_is_remembered(tmp_path: Path) -> None:
    asked = Answers(answers(tmp_path, remember=True))
    setup.remember("serial:/dev/ttyUSB3@115200", asked)
    assert settings.read() == {"board": "serial:/dev/ttyUSB3@115200", "port": "/dev/ttyUSB3"}
    setup.remember("can:socketcan:can0", Answers(answers(tmp_path, remember=False)))
    assert settings.read()["board"] == "serial:/dev/ttyUSB3@115200"


LOOK: dict[str, Any] = {
    "faults": [], "live": True, "steps_per_s": 100.0, "host_lost": 3, "board_dropped": 0, "saturated_steps": 7,
    "rate_dps": 0.1, "tilt_deg": 1.0, "tilt_measured_deg": 1.1,
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"rate_dps": None, "tilt_deg": None, "tilt_measured_deg": None}, None),  # a system without them
        ({"faults": ["running on the internal oscillator"]}, "fault: running on"),
        ({"live": False}, "does not run on its own sensors"),
        ({"steps_per_s": 97.0}, "97.0 steps per second instead of 100.0"),
        ({"steps_per_s": None}, "no steps per second"),
        ({"host_lost": 5}, "2 frames were lost"),
        ({"board_dropped": 1}, "1 frame did not fit"),
        ({"saturated_steps": 8}, "outside their range"),
        ({"rate_dps": -12.0}, "a rate of -6.0 deg/s at rest"),
        ({"tilt_deg": 7.0}, "the tilt is +4.0 deg, and +1.1 deg by the accelerometer"),
    ],
)
def test_the_light_is_green_only_when_all_is_well(change: dict[str, Any], said: str | None) -> None:
    found = rest_check.troubles([LOOK, {**LOOK, **change}], 100.0)
    assert len(found) == (said is not None), found
    assert all(str(said) in text for text in found), found


def test_the_terminal_asks_until_it_is_answered(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = iter(["boat", "quad", "", "maybe", "Y", "", "serial:x"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(builtins, "input", lambda: next(typed))
    asked = Terminal()
    assert asked.choose("system", "which?", ["quad", "balancer"], "balancer") == "quad"
    assert asked.choose("system", "which?", ["quad", "balancer"], "balancer") == "balancer"
    assert asked.agree("write", "write?", False) is True
    assert asked.agree("write", "write?", False) is False
    assert asked.choose("board", "which?", ["virtual", "another name ..."], "virtual") == "serial:x"
    assert "'boat' is none of these" in capsys.readouterr().err

    def ended() -> str:
        raise EOFError

    monkeypatch.setattr(builtins, "input", ended)
    with pytest.raises(KeyboardInterrupt):
        asked.wait("put it there")
