"""Everything that goes over the serial link goes over CAN: on the virtual board, with any python-can bus."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")

from plumb import __main__ as front
from plumb.boards.virtual import VirtualBoard
from plumb.boards.virtual_can import MachineBus
from plumb.boards.virtual_machine import open_machine
from plumb.cli import verbs
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.f103.attached.canwire import BIT_RECESSIVE, CRC, CanWire, WireFrame
from plumb.flash.image import find_image
from plumb.link.identity import NackError
from plumb.link.lockstep import Lockstep
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.proof.live_run import run_live
from plumb.spec import parameters
from plumb.systems.quad import scenarios as quad
from support.pins import at_rest

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


@pytest.fixture
def board() -> Iterator[VirtualBoard]:
    with VirtualBoard(link="can") as opened:
        yield opened
        assert opened.machine.warnings == []


def parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The parser and those of its verbs."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from parsers(verb)


@pytest.mark.parametrize("name", verbs.commands())
def test_whatever_speaks_to_a_board_does_so_over_either_link(name: str) -> None:
    for parser in parsers(verbs.command_parser(name)):
        options = parser._option_string_actions
        simulated = "--board" in options and options["--board"].choices is not None  # no other board is taken
        if ("--board" in options and not simulated) or "--confirm" in options:
            assert options["--link"].choices == ("serial", "can") and options["--link"].default == "serial"


def listen(session: Session, seconds: float) -> None:
    end = session.clock() + seconds
    while session.clock() < end:
        session.receive(0.005)


def test_connect_parameters_and_close(board: VirtualBoard) -> None:
    session = board.session
    assert session.identity is not None and session.identity.mismatch is None
    rows = parameters.table()
    values = session.read_parameters()
    assert values == [row.default for row in rows]
    control = parameters.control_part(values)
    crc = session.upload(control, period_us=4000)
    assert session.connect()["PARAMETER_CRC"] == crc
    session.close()
    board.machine.advance_us(10_000)
    sent = board.machine.can.wire.frames_sent
    board.machine.advance_us(500_000)
    assert board.machine.can.wire.frames_sent == sent


def test_the_way_into_the_bootloader_is_not_over_can(board: VirtualBoard) -> None:
    """Nobody could follow there: this part's ROM listens on the UART alone."""
    with pytest.raises(LinkError, match="cannot do that"):
        board.session.execute("BOOTLOADER")
    board.machine.advance_us(200_000)
    assert board.machine.rom is None and board.machine.reset_count == 1


@pytest.mark.slow
def test_a_listening_host_keeps_the_link_open(board: VirtualBoard) -> None:
    while board.session.clock() < 5:
        board.session.receive(0.1)
    assert board.session.telemetry["STATUS"]["blocked"] & 16 == 0
    assert board.session.counters.lost == 0


def test_two_runs_are_the_same_to_the_bit_and_the_same_as_over_the_uart() -> None:
    texts = []
    for link in ("can", "can", "serial"):
        with VirtualBoard(link=link) as board:
            params = quantise(quad.TUNINGS["adaptive"])
            scenario = quad.scenario("motion", 1003, seconds=2)
            answer = board.run_injected(params, scenario.counts(), scenario.setpoint())
            texts.append((answer.digests.tobytes(), board.machine.now if link == "can" else 0))
    assert texts[0] == texts[1]
    assert texts[0][0] == texts[2][0]


def test_words_of_a_step_come_over_can(board: VirtualBoard) -> None:
    params = quantise(quad.TUNINGS["adaptive"])
    scenario = quad.scenario("motion", 1003, seconds=1)
    words = board.words_of_step(params, scenario.counts(), scenario.setpoint(), 20)
    with VirtualBoard() as other:
        assert words == other.words_of_step(params, scenario.counts(), scenario.setpoint(), 20)


@pytest.mark.parametrize("loop", [[], ["--open-loop"]])
def test_run_over_can(loop: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "quad", "--board", "virtual", "--link", "can", "--seconds", "3", "--json", *loop]
    assert front.main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["link"] == "can" and summary["verdict"] == "pass"
    assert summary["metrics"]["target_vs_fixed_mismatches"] == 0


@pytest.mark.slow
def test_a_live_run_is_armed_and_kept_alive_over_can(board: VirtualBoard) -> None:
    trial = run_live(board, quad.scenario("hold", 1000, seconds=2), quantise(quad.HOLD))
    assert trial.verdict == "pass" and trial.mismatches == 0


def test_a_host_that_hangs_loses_the_board(board: VirtualBoard) -> None:
    session = board.session
    rows = parameters.table()
    session.upload(parameters.control_part([row.default for row in rows]), period_us=5000, arm_hold_ms=0)
    at_rest(board.machine)
    session.begin("REALTIME_LIVE")
    session.arm()
    listen(session, 0.3)
    assert session.telemetry["STATUS"]["armed"] == 1 and board.machine.pwm("PB6").pulse_us > 1000
    board.machine.advance_us(50_000)
    assert board.machine.pwm("PB6").pulse_us == 1000
    listen(session, 0.2)
    assert session.telemetry["EVENTS"]["disarm_cause"] == 0x20


@pytest.mark.slow
def test_the_bit_rate_of_the_board_survives_an_upload() -> None:
    """The new rate comes into force when the host has gone; runs of other hosts do not bring the default back."""
    machine = open_machine()
    with Session.open(machine.uart) as session:
        values = session.read_parameters()
        session.upload(parameters.control_part(values), can_bitrate_kbit=1000)
        machine.advance_us(10_000)
        assert machine.can.kbit == 1000
        session.upload(parameters.control_part(values))
        assert machine.can.kbit == 1000
    with pytest.raises(LinkError, match="can_bitrate_kbit is the bus's bit rate"):
        Session.over(MachineBus(machine))
    machine.can.wire.kbit = 1000
    machine.advance_us(1_100_000)
    with Session.over(MachineBus(machine)) as session:
        session.upload(parameters.control_part(values), can_bitrate_kbit=250)
        listen(session, 0.1)
        assert machine.can.kbit == 1000 and session.read_parameters()  # not under the feet of who asked
    machine.advance_us(10_000)
    assert machine.can.kbit == 250


@pytest.mark.slow
def test_both_links_at_once() -> None:
    """Replies go where the question came from, telemetry to both, and the link that armed is the one that must live."""
    machine = open_machine()
    uart, bus = Session.open(machine.uart), Session.over(MachineBus(machine))
    control = parameters.control_part(uart.read_parameters())
    at_rest(machine)
    uart.upload(control, period_us=5000, arm_hold_ms=0)
    assert bus.read_parameters() == uart.read_parameters()
    received: dict[str, list[int]] = {"uart": [], "can": []}
    step = uart.protocol["STEP"].identifier
    for name, session in (("uart", uart), ("can", bus)):
        steps = received[name]
        session.listener = lambda frames, steps=steps: steps.extend(
            int.from_bytes(data[2:4], "little") for identifier, data in frames if identifier == step
        )
    bus.begin("REALTIME_LIVE")
    bus.arm()
    for _ in range(60):
        bus.receive(0.01)
        uart.receive(0.0)
    assert bus.telemetry["STATUS"]["armed"] == uart.telemetry["STATUS"]["armed"] == 1
    uart.receive(0.01)
    assert set(received["can"][5:-5]) <= set(received["uart"]) and len(received["can"]) > 50
    with pytest.raises(LinkError, match="from another link"):
        uart.request("PARAM_COMMIT", 1, 0)
    value = bus.protocol["KEEPALIVE_VALUE"]
    end = uart.clock() + 0.1
    while uart.clock() < end:  # the right values are not enough: the link that armed must live
        for identifier, data in bus.frames.read_frames(0.005):
            if identifier == value.identifier:
                uart.send([uart.frame("KEEPALIVE", *value.unpack(data)[2:])])
        uart.receive(0.0)
    listen(bus, 0.2)
    assert bus.telemetry["STATUS"]["armed"] == 0
    assert bus.telemetry["EVENTS"]["disarm_cause"] == 0x20
    bus.arm()
    uart.close()  # not who armed
    listen(bus, 0.2)
    assert bus.telemetry["STATUS"]["armed"] == 1
    again = Session(PlumbBus(machine.uart))
    again.disarm()  # but anybody may stop it
    listen(bus, 0.2)
    assert bus.telemetry["STATUS"]["armed"] == 0
    assert machine.warnings == []
    again.close()
    bus.close()


def test_what_belongs_to_one_link_is_no_use_on_the_other() -> None:
    """A nonce, and staged parameters: a greeting over the other link forgets none, its own staging replaces them."""
    machine = open_machine()
    uart, bus = Session.open(machine.uart), Session.over(MachineBus(machine))
    lockstep = uart.protocol["RUN_BEGIN"].value("run", "LOCKSTEP")
    nonce = uart.request("CHALLENGE", lockstep, 0, answer="NONCE", first=lockstep)["nonce"]
    with pytest.raises(NackError, match="nonce"):
        bus.request("RUN_BEGIN", lockstep, nonce)
    bus.request("CHALLENGE", lockstep, 0, answer="NONCE", first=lockstep)
    uart.request("RUN_BEGIN", lockstep, nonce)  # each link has its own: neither took it away
    uart.end()
    rows = parameters.table()
    words = [row.default for row in rows]
    place = {row.name: index for index, row in enumerate(rows)}

    def stage(session: Session, name: str, value: int) -> None:
        session.request("PARAM_SET", place[name], value, answer="PARAM_STAGED", first=place[name])

    stage(uart, "arm_hold_ms", 7)
    bus.connect()
    words[place["arm_hold_ms"]] = 7
    uart.request("PARAM_COMMIT", len(words), parameters.crc32(words))
    stage(uart, "arm_hold_ms", 8)
    stage(bus, "period_us", 10_000)
    words[place["period_us"]] = 10_000
    bus.request("PARAM_COMMIT", len(words), parameters.crc32(words))
    assert uart.read_parameters() == words
    uart.close()
    bus.close()


def test_the_parameters_of_a_run_are_reported_on_both_links() -> None:
    machine = open_machine()
    uart, bus = Session.open(machine.uart), Session.over(MachineBus(machine))
    used = uart.protocol["SETPOINT_USED"].identifier
    received: dict[str, list[int]] = {"uart": [], "can": []}
    for name, session in (("uart", uart), ("can", bus)):
        session.listener = lambda frames, kept=received[name]: kept.extend(
            int.from_bytes(data[4:8], "little") for identifier, data in frames if identifier == used
        )
    bus.begin("REALTIME_LIVE")
    bus.set_setpoint(12345)
    listen(bus, 0.1)
    uart.receive(0.01)
    assert received == {"uart": [12345], "can": [12345]}
    uart.close()
    bus.close()


def test_lockstep_goes_at_the_pace_of_who_began_it() -> None:
    """A dead bus, with the CAN link still open, does not hold up a run over the UART; nor may CAN feed it samples."""
    machine = open_machine()
    uart, bus = Session.open(machine.uart), Session.over(MachineBus(machine))
    run = Lockstep(uart)
    machine.can.wire.acknowledged = False
    for step in range(200):
        assert run.exchange((step, 2, 3)).step == step
    machine.can.wire.acknowledged = True
    bus.connect()
    with pytest.raises(LinkError, match="from another link"):
        bus.request("SAMPLE_A", 1, 2, 3)
    assert uart.end() == 200
    uart.close()
    bus.close()


def test_stock_python_can_receives_and_asks(board: VirtualBoard) -> None:
    """The in-process bus is a python-can bus like any other."""
    bus = board.session.bus
    assert isinstance(bus, can.BusABC)
    message = board.session.protocol["PARAM_GET"]
    bus.send(can.Message(arbitration_id=message.identifier, data=message.pack(0, 0, 5, 0), is_extended_id=False))
    wanted = board.session.protocol["PARAM_VALUE"].identifier
    received = [bus.recv(0.05) for _ in range(8)]
    assert wanted in [frame.arbitration_id for frame in received if frame is not None]


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("can:none:0", "python-can has no interface 'none'"),
        ("can:virtual", "is not a bus"),
        ("can:", "is not a board"),
        ("can:socketcand:127.0.0.1", "HOST:PORT:CHANNEL"),
    ],
)
def test_a_bus_that_is_none_is_wrong_use(spec: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["run", "quad", "--board", spec]) == 2
    complaint = capsys.readouterr().err
    assert sentence in complaint and len(complaint.splitlines()) == 1


def test_nobody_on_the_bus_is_one_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert front.main(["run", "quad", "--board", "can:virtual:nobody", "--seconds", "1"]) == 3
    complaint = capsys.readouterr().err
    assert "does not answer" in complaint and "can_bitrate_kbit" in complaint and len(complaint.splitlines()) == 1


def no_acknowledgement(wire: CanWire) -> None:
    wire.acknowledged = False
    wire.fail_receiving.extend([CRC] * 1000)  # nothing comes through either


def bus_off(wire: CanWire) -> None:
    wire.fail_sending.extend([BIT_RECESSIVE] * 1000)
    wire.fail_receiving.extend([CRC] * 1000)


def babbling(wire: CanWire) -> None:
    wire.babble(WireFrame(0, bytes(8)))


def shorted(wire: CanWire) -> None:
    wire.short(True)


def another_bit_rate(wire: CanWire) -> None:
    wire.kbit = 250


@pytest.mark.slow
@pytest.mark.parametrize("fault", [no_acknowledgement, bus_off, babbling, shorted, another_bit_rate])
def test_whatever_happens_to_the_bus_the_outputs_are_safe_in_50_ms(
    board: VirtualBoard, fault: Callable[[CanWire], None]
) -> None:
    """The host goes on sending keep-alives and none arrives."""
    session, machine = board.session, board.machine
    at_rest(machine)
    session.upload(
        parameters.control_part(session.read_parameters()), period_us=2500, esc_period_us=2500, arm_hold_ms=0
    )
    session.begin("REALTIME_LIVE")
    session.arm()
    listen(session, 0.3)
    assert machine.pwm("PB6").pulse_us > 1000
    fault(machine.can.wire)
    started_us = machine.now_us
    while machine.pwm("PB6").pulse_us > 1000 or machine.pwm("PB7").pulse_us > 1000:
        session.pump()
        machine.advance_us(500)
        assert machine.now_us - started_us < 51_000
    machine.advance_us(200_000)
    assert machine.pwm("PB6").pulse_us == machine.pwm("PB7").pulse_us == 1000
    assert machine.reset_count == 1
