"""`plumb settings`, and a command without --board or --port."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.files import settings
from plumb.link import discovery
from plumb.link.discovery import SerialPort
from plumb.link.usb_adapters import known


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def test_settings_are_remembered_and_forgotten(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["settings", "board=serial:/dev/ttyUSB7@115200", "port=/dev/ttyUSB7"]) == 0
    assert "board = serial:/dev/ttyUSB7@115200 (" in capsys.readouterr().out
    assert front.main(["settings", "--forget", "port", "can=can:socketcan:can0", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["settings"] == {"board": "serial:/dev/ttyUSB7@115200", "can": "can:socketcan:can0"}
    assert Path(said["file"]) == settings.settings_file() and settings.read() == said["settings"]


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("board", "'board' sets nothing"),
        ("speed=3", "there is no setting 'speed'"),
        ("board=toaster", "'toaster' is not a board"),
        ("can=serial:/dev/ttyUSB0", "is no CAN bus"),
        ("can=auto", "'auto' is no CAN bus"),
        ("board=foo", "use auto, native, "),
        ("board=/dev/ttyUSB0", "(did you mean serial:/dev/ttyUSB0?)"),
        ("bord=auto", "there is no setting 'bord' (did you mean board?)"),
        ("port=spy:///etc/passwd", "is not opened"),
    ],
)
def test_a_setting_that_cannot_work_is_refused(assignment: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["settings", "board=virtual", assignment]) == 2
    assert said in capsys.readouterr().err
    assert settings.read() == {}


@pytest.mark.parametrize("text", ["board =", "board = 3", 'bord = "virtual"', "board = '\xff'", 'board = ""'])
def test_a_damaged_file_is_named(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    settings.settings_file().parent.mkdir(parents=True)
    settings.settings_file().write_bytes(text.encode("latin-1"))
    assert front.main(["params", "list"]) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and ("settings.toml" in err or "no setting 'bord'" in err)


def test_a_command_without_a_board_takes_the_setting_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["run", "quad", "--seconds", "1"]) == 2
    assert "name the board with --board" in capsys.readouterr().err
    settings.change({"board": "native"})
    assert front.main(["run", "quad", "--open-loop", "--seconds", "1"]) == 0
    captured = capsys.readouterr()
    assert captured.err == "board native, from the settings\n" and "on native" in captured.out
    assert front.main(["monitor", "--board", "serial:/dev/no-such-port"]) == 3  # the command line goes first
    assert "no-such-port" in capsys.readouterr().err
    settings.change({"board": "auto"})
    assert front.main(["doctor", "--json"]) in (0, 2)  # takes a board only when it is asked to
    assert capsys.readouterr().err == ""


def test_flash_takes_the_port_of_the_settings(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["flash"]) == 2
    assert "name the adapter with --port" in capsys.readouterr().err
    settings.change({"port": "auto"})
    ports = [SerialPort(f"/dev/no-port-{i}", "CP2102", "10c4:ea60", known(0x10C4, 0xEA60)) for i in range(2)]
    monkeypatch.setattr(discovery, "serial_ports", lambda: ports)
    assert front.main(["flash"]) == 3
    assert "2 adapters are here: /dev/no-port-0 (CP2102), /dev/no-port-1 (CP2102)" in capsys.readouterr().err
    del ports[1]
    assert front.main(["flash"]) == 3
    err = capsys.readouterr().err
    assert "port /dev/no-port-0, the only one here" in err and "there is no port /dev/no-port-0" in err


@pytest.mark.parametrize("text", ["board = " + "[" * 30_000, "board = " + "9" * 5000, "board = \xff"])
def test_settings_of_any_bytes_are_one_sentence(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    settings.settings_file().parent.mkdir(parents=True, exist_ok=True)
    settings.settings_file().write_bytes(text.encode("latin-1"))
    assert front.main(["settings"]) == 2
    assert "settings.toml cannot be read (" in capsys.readouterr().err
