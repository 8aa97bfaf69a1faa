"""Who may do what: without a matching greeting a link reads, stops, and brings a board to its bootloader; no more.
On the flash image, over both links."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn")

from plumb.boards.virtual_can import MachineBus
from plumb.f103.machine import Machine
from plumb.link.identity import NackError
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from support.sessions import CONTROL, STEER, booted, listen, opened, refusal, used_setpoints

LINKS = ["serial", "can"]
NOT_GREETED = 1
"""Bit of what blocks arming."""


@pytest.fixture
def machine() -> Machine:
    return booted()


def stranger(machine: Machine, link: str) -> Session:
    """A host of another version, which greeted as such."""
    session = Session(MachineBus(machine) if link == "can" else PlumbBus(machine.uart))
    session.protocol = replace(protocol(), version=protocol().version + 1, dbc_hash=1)
    session.connect()
    return session


def flying(machine: Machine, link: str) -> Session:
    """Armed on the board's own sensors, 400 Hz pulses, no hold."""
    session = opened(machine, link)
    session.upload(CONTROL, period_us=5000, esc_period_us=2500, arm_hold_ms=0)
    session.begin("REALTIME_LIVE")
    session.arm()
    listen(session, 0.3)
    assert session.telemetry["STATUS"]["armed"] == 1
    return session


@pytest.mark.parametrize("link", LINKS)
def test_a_host_of_another_version_changes_nothing(machine: Machine, link: str) -> None:
    session = stranger(machine, link)
    verb, run = session.protocol["EXECUTE"].value, session.protocol["RUN_BEGIN"].value

    def nonce(value: int) -> int:
        return session.request("CHALLENGE", value, 0, answer="NONCE", first=value)["nonce"]

    words = [row.default for row in parameters.table()]
    assert refusal(lambda: session.request("PARAM_SET", 0, 0, answer="PARAM_STAGED")) == "GREETING"
    assert refusal(lambda: session.request("PARAM_COMMIT", len(words), parameters.crc32(words))) == "GREETING"
    for name in ("SAVE", "LOAD", "DEFAULTS"):
        value = verb("verb", name)
        assert refusal(lambda value=value: session.request("EXECUTE", value, nonce(value))) == "GREETING"  # type: ignore[misc]
    for name in ("LOCKSTEP", "REALTIME_INJECTED", "REALTIME_LIVE"):
        value = run("run", name)
        assert refusal(lambda value=value: session.request("RUN_BEGIN", value, nonce(value))) == "GREETING"  # type: ignore[misc]
    assert refusal(lambda: session.request("SETPOINT", 0, STEER)) == "GREETING"
    assert refusal(lambda: session.request("SAMPLE_A", 1, 2, 3)) == "GREETING"
    with pytest.raises(NackError) as refused:  # with a number of the host, as those of this version have
        session.execute("ARM", matching=False)
    assert refused.value.reason == "BLOCKED" and refused.value.detail & NOT_GREETED
    # What it may: read, choose telemetry, stop.
    assert session.request("PARAM_GET", 5, 0, answer="PARAM_VALUE", first=5)["value"] == words[5]
    session.request("SELECT", 0, 1)
    assert session.end() == 0
    session.disarm()
    session.request("CLOSE", 0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("link", LINKS)
def test_a_host_of_another_version_does_not_steer_what_another_armed(machine: Machine, link: str) -> None:
    session = flying(machine, link)
    listen(session, 0.2)
    used = used_setpoints(session)
    foreign = stranger(machine, "can" if link == "serial" else "serial")
    for _ in range(50):
        foreign.send([foreign.frame("SETPOINT", 0, STEER)])
        session.receive(0.005)
    assert used == []
    assert session.telemetry["STATUS"]["armed"] == 1
    foreign.disarm()  # but it may stop it
    session.listener = None
    listen(session, 0.2)
    assert session.telemetry["STATUS"]["armed"] == 0


@pytest.mark.parametrize("link", LINKS)
def test_a_run_begins_with_a_nonce_of_its_own_only(machine: Machine, link: str) -> None:
    session = opened(machine, link)
    live, lockstep = (session.protocol["RUN_BEGIN"].value("run", name) for name in ("REALTIME_LIVE", "LOCKSTEP"))
    assert refusal(lambda: session.request("RUN_BEGIN", live, 12345)) == "NONCE"
    nonce = session.request("CHALLENGE", lockstep, 0, answer="NONCE", first=lockstep)["nonce"]
    assert refusal(lambda: session.request("RUN_BEGIN", live, nonce)) == "NONCE"


def test_a_can_link_that_timed_out_has_to_be_greeted_again(machine: Machine) -> None:
    session = Session.over(MachineBus(machine))
    machine.advance_us(2_200_000)
    session.bus.read_frames(0.0)  # type: ignore[attr-defined]
    # A stranger's HELLO opens the link; the greeting before it has gone with the host that said it.
    foreign = stranger(machine, "can")
    assert refusal(lambda: foreign.request("PARAM_SET", 0, 0, answer="PARAM_STAGED")) == "GREETING"


@pytest.mark.parametrize("command", [b"C\rO\r", b"L\rO\r"])
def test_a_uart_that_was_closed_has_to_be_greeted_again(machine: Machine, command: bytes) -> None:
    session = Session.open(machine.uart)
    session.request("PARAM_SET", 0, 0, answer="PARAM_STAGED")
    machine.uart.write(command)
    assert refusal(lambda: session.request("PARAM_SET", 0, 0, answer="PARAM_STAGED")) == "GREETING"


def test_any_version_brings_an_idle_board_to_its_bootloader_and_no_other(machine: Machine) -> None:
    """CHALLENGE, NONCE and EXECUTE BOOTLOADER are the same in every version."""
    frames = {name: protocol()[name] for name in ("CHALLENGE", "NONCE", "EXECUTE")}
    assert [(message.identifier, message.layout.format) for message in frames.values()] == [
        (0x040, "<BBHI"),
        (0x2A0, "<BBHI"),
        (0x041, "<BBHI"),
    ]
    bootloader = protocol()["EXECUTE"].value("verb", "BOOTLOADER")
    assert bootloader == 3
    session = flying(machine, "can")
    foreign = stranger(machine, "serial")

    def ask() -> None:
        nonce = foreign.request("CHALLENGE", bootloader, 0, answer="NONCE", first=bootloader)["nonce"]
        foreign.request("EXECUTE", bootloader, nonce)

    assert refusal(ask) == "BUSY"
    listen(session, 0.2)
    assert session.telemetry["STATUS"]["armed"] == 1 and machine.rom is None
    session.end()
    ask()
    machine.advance_us(200_000)
    assert machine.rom is not None
