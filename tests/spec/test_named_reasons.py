"""Whatever keeps a board from arming, or ended its being armed, has a name on the host: bit by bit, and in `doctor`."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.link.identity import (
    BLOCKED,
    BLOCKING_FAULTS,
    FAULTS,
    bits_text,
    disarmed_text,
    implausible,
    plausibility_text,
)
from plumb.link.session import Session
from plumb.spec import declarations
from plumb.spec.protocol import load_database
from support.native_board import UartBoard

FIRMWARE = Path(__file__).parents[2] / "firmware"
BIT = r"^#define {}_(\w+)[\s\\]+0x([0-9a-fA-F]+)U\b"


def bits_of(header: str, prefix: str) -> dict[str, int]:
    text = (FIRMWARE / header).read_text(encoding="utf-8")
    return {name: int(value, 16) for name, value in re.findall(BIT.format(prefix), text, re.MULTILINE | re.IGNORECASE)}


def test_every_blocking_reason_has_a_name_in_host_and_dbc() -> None:
    reasons = bits_of("link/arming.h", "ARMING_BLOCK")
    assert sorted(reasons.values()) == [1 << bit for bit in sorted(BLOCKED)]
    said = {signal.name: signal.comment for message in load_database().messages for signal in message.signals}
    for bit in BLOCKED:
        assert re.search(rf"\b{bit} ", f"{said['blocked']} {said['disarm_cause']}"), bit


def test_every_fault_has_a_name_in_host_and_dbc() -> None:
    faults = bits_of("app/board.h", "BOARD_FAULT")
    assert len(faults) > 10
    assert set(faults.values()) <= {1 << bit for bit in FAULTS}
    said = {signal.name: signal.comment for message in load_database().messages for signal in message.signals}
    for bit in (value.bit_length() - 1 for value in faults.values()):
        assert re.search(rf"\b{bit} ", said["faults"] or ""), bit


def test_names_are_sentences_of_their_own() -> None:
    for names in (BLOCKED, FAULTS):
        assert len(set(names.values())) == len(names)
    assert bits_text(1 << 4 | 1 << 5, FAULTS).count(";") == 1


STOPPED = [name for name, declared in declarations.systems().items() if declared.stop_reasons]


@pytest.mark.parametrize("system", STOPPED)
def test_every_bit_of_a_stop_reason_in_c_has_a_text(system: str) -> None:
    header = (FIRMWARE / f"include/plumb/{system}.h").read_text(encoding="utf-8")
    section = header.partition("/* Word `stop_reason`")[2].partition("\n\n")[0]
    values = {int(value) for value in re.findall(r"\b(\d+)U\b", section)}
    assert values == {1 << reason.bit for reason in declarations.system(system).stop_reasons}


@pytest.mark.parametrize("system", STOPPED)
def test_a_stop_reason_has_the_text_of_the_system_that_runs_alone(system: str) -> None:
    said = {"disarmed_by": 0xFF00, "failed": 0xFF00}
    own = [reason.doc for reason in declarations.system(system).stop_reasons]
    assert plausibility_text(said, system) == own
    report = disarmed_text(1 << 15, said, system)
    assert [text for text in own if text not in report] == []
    for other in set(STOPPED) - {system}:
        foreign = [reason.doc for reason in declarations.system(other).stop_reasons]
        assert [text for text in foreign if text in report] == [] and other not in report


def test_of_an_unknown_system_a_stop_reason_names_the_systems_that_have_it() -> None:
    texts = implausible(None)
    assert "quadrotor: " in texts[13] and "wheels: " in texts[13] and "wheels" not in texts[8]


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> UartBoard:
    memory = UartBoard()
    memory.switch(False)
    memory.run_us(50_000)
    monkeypatch.setattr("plumb.boards.open_link_board", lambda spec, link: LinkBoard(spec, Session.open(memory)))
    return memory


def doctor(capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, list[str]]]:
    code = front.main(["doctor", "--board", "memory", "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    report: dict[str, list[str]] = {}
    for finding in findings:
        report.setdefault(finding["what"], []).append(finding["detail"])
    return code, report


def test_doctor_on_a_board_that_is_well(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, report = doctor(capsys)
    assert code == 0
    assert report["last reset"] == ["power"] and report["parameters"] == ["factory defaults"]
    assert report["pins"] == ["standard"] and "crash" not in report and "fault" not in report and "arming" not in report


@pytest.mark.parametrize("bit", BLOCKING_FAULTS)
def test_doctor_names_each_fault_that_blocks(board: UartBoard, capsys: pytest.CaptureFixture[str], bit: int) -> None:
    board.sensors(faults=1 << bit)
    code, report = doctor(capsys)
    assert code == 1 and report["fault"] == [FAULTS[bit]]


def test_doctor_names_a_switch_that_is_closed(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    board.reset()
    board.switch(True)
    code, report = doctor(capsys)
    assert code == 0 and report["arming"] == [BLOCKED[10]]
