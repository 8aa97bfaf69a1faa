"""Why no board answers on a port: one finding for each cause, with what mends it."""

from __future__ import annotations

import json
import os
import pty
import tty
from collections.abc import Iterator

import pytest

from plumb import __main__ as front
from plumb.flash import silent_port
from plumb.link.endpoint_names import SerialName
from plumb.link.findings import Finding
from plumb.link.transports.byte_stream import ObjectStream
from support.bootloader import Bootloader

pytest.importorskip("stm32loader", reason="flashing needs the extra flash")


@pytest.fixture
def open_end() -> Iterator[str]:
    """A port behind which nobody answers."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield os.ttyname(near)
    os.close(far)
    os.close(near)


def only(found: Iterator[Finding]) -> Finding:
    (finding,) = found
    assert finding.needed and not finding.good
    return finding


def test_boot0_at_1() -> None:
    with Bootloader() as chip:
        finding = only(silent_port.diagnose(SerialName(chip.port)))
        assert finding.what == "BOOT0" and finding.mend.startswith(f"plumb flash --port {chip.port}, then set BOOT0")
        assert not chip.erased and not chip.written and chip.started_at is None


def test_a_bootloader_that_is_not_one_of_st() -> None:
    with Bootloader(version=0x30) as chip:
        boot0, clone = silent_port.diagnose(SerialName(chip.port))
    assert boot0.what == "BOOT0"
    assert (clone.what, clone.needed) == ("clone", False) and "version 3.0" in clone.detail


@pytest.mark.parametrize(
    ("asked", "board", "mend"),
    [(115200, 921600, "--board serial:{port}"), (921600, 460800, "--board serial:{port}@460800")],
)
def test_another_baud_rate(asked: int, board: int, mend: str, open_end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(silent_port, "bootloader_at", lambda port: None)
    monkeypatch.setattr(silent_port, "answers_at", lambda port, baud: b"V1007\r" if baud == board else b"\xf0\x1e")
    finding = only(silent_port.diagnose(SerialName(open_end, asked)))
    assert finding.detail == f"a board answers at {board} baud, not at {asked}"
    assert finding.mend == mend.format(port=open_end)


def test_another_program_on_the_chip(open_end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(silent_port, "bootloader_at", lambda port: None)
    monkeypatch.setattr(silent_port, "answers_at", lambda port, baud: b"Marlin 2.1\n")
    assert "another program on the chip" in only(silent_port.diagnose(SerialName(open_end))).detail


def test_silence(open_end: str) -> None:
    assert only(silent_port.diagnose(SerialName(open_end))).detail == silent_port.SILENT


def test_a_port_that_is_not_there_or_does_not_open() -> None:
    assert "there is no port" in only(silent_port.diagnose(SerialName("/dev/no-such-port"))).detail
    closed = only(silent_port.diagnose(SerialName("socket://127.0.0.1:1")))
    assert "no connection to 127.0.0.1:1" in closed.detail


class Node:
    """The board's end of a line, on which any program may be talking."""

    def __init__(self) -> None:
        self.received = b""

    def write(self, data: bytes) -> None:
        self.received += data

    def read(self, size: int) -> bytes:
        return b"V1007\r" if self.received.endswith(b"V\r") else b""


def test_the_question_gets_its_answer_from_a_board(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Node()
    monkeypatch.setattr(silent_port, "open_stream", lambda name, baud: ObjectStream(node))
    assert silent_port.answers_at("port", 115200).startswith(b"V1007\r")
    assert node.received == b"\rC\rV\r"


def test_doctor_says_why_and_ends_with_3(open_end: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["doctor", "--board", f"serial:{open_end}", "--json"]) == 3
    said = json.loads(capsys.readouterr().out)
    assert not said["good"] and [one["detail"] for one in said["findings"]][-1] == silent_port.SILENT
    with Bootloader() as chip:
        assert front.main(["doctor", "--board", f"serial:{chip.port}"]) == 3
        assert "MISS BOOT0: the chip's own bootloader answers (medium density)" in capsys.readouterr().out
