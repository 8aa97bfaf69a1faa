"""Boards by themselves: `--board auto` takes the only one that is here, else it lists them and takes none."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import plumb
from plumb import __main__ as front
from plumb.errors import LinkError
from plumb.files import settings
from plumb.link import discovery, served_boards
from plumb.link.can_interfaces import CanInterface, network_interfaces
from plumb.link.discovery import Answer, Candidate, SerialPort
from plumb.link.identity import Identity
from plumb.link.usb_adapters import known

CP2102 = known(0x10C4, 0xEA60)
BOARD = Identity({"UNIQUE_ID_0": 7}, None)


def port(number: int, adapter: bool = True) -> SerialPort:
    return SerialPort(f"/dev/ttyUSB{number}", "USB UART", "10c4:ea60 0001", CP2102 if adapter else None)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., list[str]]:
    """A machine with these serial ports, of which some answer as a board, and no settings; returns who was asked."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    (tmp_path / "runtime").mkdir(mode=0o700)

    def has(ports: list[SerialPort], boards: tuple[str, ...] = ()) -> list[str]:
        asked: list[str] = []

        def ask(candidate: Candidate) -> Answer:
            asked.append(candidate.name)
            return Answer(candidate, BOARD) if candidate.name in boards else Answer(candidate, None, "no answer")

        monkeypatch.setattr(discovery, "serial_ports", lambda: ports)
        monkeypatch.setattr(discovery, "ask", ask)
        return asked

    return has


def test_the_only_candidate_is_taken_unopened(machine: Callable[..., list[str]]) -> None:
    asked = machine([port(0), port(1, adapter=False)])
    assert discovery.resolved("auto") == "serial:/dev/ttyUSB0"
    assert asked == []


def test_of_several_ports_the_one_that_answers_is_taken(machine: Callable[..., list[str]]) -> None:
    asked = machine([port(0), port(1), port(2, adapter=False)], boards=("serial:/dev/ttyUSB1",))
    assert discovery.resolved("auto") == "serial:/dev/ttyUSB1"
    assert sorted(asked) == ["serial:/dev/ttyUSB0", "serial:/dev/ttyUSB1"]  # an unknown adapter is never opened


@pytest.mark.parametrize(
    ("ports", "boards", "said"),
    [
        ([], (), "no board is here"),
        (
            [port(0), port(1)],
            (),
            "none of 2 ports answers as a board (serial:/dev/ttyUSB0: no answer; serial:/dev/ttyU",
        ),
        (
            [port(0), port(1)],
            ("serial:/dev/ttyUSB0", "serial:/dev/ttyUSB1"),
            "2 boards are here: serial:/dev/ttyUSB0 (CP2102), serial:/dev/ttyUSB1 (CP2102); name one of them",
        ),
    ],
)
def test_any_other_number_is_code_3_and_the_list(
    ports: list[SerialPort],
    boards: tuple[str, ...],
    said: str,
    machine: Callable[..., list[str]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    machine(ports, boards)
    assert front.main(["monitor", "--board", "auto", "--seconds", "1"]) == 3
    err = capsys.readouterr().err
    assert said in err and len(err.splitlines()) == 1
    with pytest.raises(LinkError, match=r"here|answers"):
        plumb.connect("auto")


def test_a_can_bus_is_asked_only_when_the_settings_name_it(machine: Callable[..., list[str]]) -> None:
    asked = machine([port(0)], boards=("can:socketcan:can0",))
    assert discovery.resolved("auto") == "serial:/dev/ttyUSB0"
    settings.change({"can": "can:socketcan:can0"})
    assert discovery.resolved("auto") == "can:socketcan:can0"
    assert sorted(asked) == ["can:socketcan:can0", "serial:/dev/ttyUSB0"]


def test_a_candidate_that_cannot_be_opened_is_an_answer() -> None:
    for name, said in [
        ("serial:/dev/no-such-port", "there is no port"),
        ("can:nonsense:can0", "has no interface"),
        ("can:", "is not a board"),
    ]:
        answer = discovery.ask(Candidate(name, ""))
        assert not answer.is_board and said in answer.trouble


SERVE = (
    "import sys\nfrom plumb.link.served_boards import Entry\n"
    "with Entry('quad') as entry:\n"
    "    entry.add('can:slcan:/dev/pts/8')\n    entry.add('serial:/dev/pts/9')\n"
    "    print('up', flush=True)\n    sys.stdin.read()\n"
)


def test_a_served_board_is_listed_while_its_process_lives(machine: Callable[..., list[str]]) -> None:
    """However the process ends, its board is gone: an entry without its lock is removed."""
    machine([])
    assert served_boards.served_boards() == []
    for end in ("close", "kill"):
        with subprocess.Popen([sys.executable, "-c", SERVE], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            assert process.stdin and process.stdout and process.stdout.readline() == b"up\n"
            (board,) = served_boards.served_boards()
            assert board.names == ("serial:/dev/pts/9", "can:slcan:/dev/pts/8")  # one board, its serial link first
            assert (board.system, board.process) == ("quad", process.pid)
            assert discovery.resolved("auto") == "serial:/dev/pts/9"
            process.kill() if end == "kill" else process.stdin.close()
            process.wait()
        assert served_boards.served_boards() == []
        assert not list(served_boards.folder().iterdir())


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"names": [], "system": "", "process": 1}', "\xff", '{"names": 3}', "[" * 60_000]
)
def test_an_entry_that_cannot_be_read_is_no_board(text: str, machine: Callable[..., list[str]]) -> None:
    machine([])
    with served_boards.Entry("") as entry:
        entry.add("serial:x")
        (path,) = served_boards.folder().glob("*.json")
        path.write_bytes(text.encode("latin-1"))
        assert served_boards.served_boards() == []


def test_can_network_interfaces_up_and_down(tmp_path: Path) -> None:
    for name, kind, flags in [
        ("can0", 280, "0x40080"),
        ("vcan1", 280, "0xc1"),
        ("eth0", 1, "0x1003"),
        ("odd", None, ""),
    ]:
        (tmp_path / name).mkdir()
        if kind is not None:
            (tmp_path / name / "type").write_text(f"{kind}\n")
            (tmp_path / name / "flags").write_text(f"{flags}\n")
    assert network_interfaces(tmp_path) == [
        CanInterface("can:socketcan:can0", "down"),
        CanInterface("can:socketcan:vcan1", "up"),
    ]


def test_ports_lists_all_three_kinds(
    machine: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slcan = SerialPort("/dev/ttyACM0", "CANable", "16d0:117e", known(0x16D0, 0x117E))
    asked = machine([port(0), port(1, adapter=False), slcan], boards=("serial:/dev/ttyUSB0",))
    buses = [CanInterface("can:socketcan:can0", "down"), CanInterface("can:socketcan:can1", "up", 500)]
    monkeypatch.setattr("plumb.link.can_interfaces.can_interfaces", lambda: buses)
    with served_boards.Entry("quad") as entry:
        entry.add("serial:socket://127.0.0.1:4000")
        assert front.main(["ports"]) == 0
        out = capsys.readouterr().out
        assert not asked
        assert [line.split()[0] for line in out.splitlines()] == [
            "serial:/dev/ttyUSB0",
            "serial:/dev/ttyUSB1",
            "can:slcan:/dev/ttyACM0",
            "serial:socket://127.0.0.1:4000",
            "can:socketcan:can0",
            "can:socketcan:can1",
        ]
        assert "sudo ip link set can0 up type can bitrate 500000" in out and "up, 500 kbit/s" in out
        assert front.main(["ports", "--json", "--probe"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert asked == ["serial:/dev/ttyUSB0"]
    assert said["ports"][0]["board"].startswith("plumb board 00000007")
    assert "board" not in said["ports"][1] and said["served"][0]["system"] == "quad" and said["can"][1]["kbit"] == 500
