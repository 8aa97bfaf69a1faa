"""Both pin sets of the one flash image: what each pin carries, what is neutral when, and how a set comes into force."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.boards.strap import set_strap
from plumb.errors import LinkError
from plumb.f103 import Machine
from plumb.f103.peripherals.tim1 import HIGH_PINS, LOW_PINS
from plumb.link.session import Session
from plumb.spec.parameters import table
from support.pins import at_rest

CONTROL_WORDS = sum(row.owner == "control" for row in table())
BOOT_US = 60_000
NEUTRAL_US = 1000.0
READY_US = 1_000_000
"""Within this a board at rest is ready to be armed."""
FAULT_BRIDGE, FAULT_HALL = 0x10, 0x20
BLOCKED_PINS = 1 << 9
SWITCH = "PC14"


@pytest.fixture
def standard(image: Path) -> Machine:
    machine = Machine(image)
    at_rest(machine)
    machine.advance_us(BOOT_US)
    return machine


@pytest.fixture
def bridged(standard: Machine) -> Machine:
    """Set once, saved, switched off, rewired, switched on: a rotor at rest, and a gate driver that is happy."""
    with Session.open(standard.uart) as session:
        session.upload(session.read_parameters()[:CONTROL_WORDS], pins=1, arm_hold_ms=0)
        session.execute("SAVE")
        assert session.connect()["PINS"] == 0  # not before the next start
    standard.power_cut()
    set_strap(standard, "bridge")
    standard.drive("PB12", True)
    standard.set_hall(5)
    standard.tim1.trace = []
    standard.power_on()
    standard.advance_us(BOOT_US)
    return standard


def test_standard_is_the_factory_set(standard: Machine) -> None:
    with Session.open(standard.uart) as session:
        assert session.connect()["PINS"] == 0
    for pin in ("PB6", "PB7"):
        assert standard.pwm(pin) == (NEUTRAL_US, 2500.0, True)
    for pin in HIGH_PINS[:1] + LOW_PINS:
        assert not standard.port(pin).is_output(int(pin[2:]))
    assert not standard.tim1.clocked and standard.warnings == []
    assert standard.afio.debug_port and standard.afio.swj_cfg == 2


def test_what_an_open_input_reads_as(standard: Machine) -> None:
    """Lines idle, the chip not selected, the switch open."""
    high = {"PA6": "data from the chip", "PA10": "UART", "PA11": "CAN", SWITCH: "switch", "PA4": "select"}
    assert {pin: standard.pin(pin) for pin in high} == dict.fromkeys(high, True)


def test_what_an_open_input_of_the_bridge_reads_as(bridged: Machine) -> None:
    """Hall sensors that are off are all alike, and a break input that is off breaks."""
    bridged.drive("PB12", None)
    for pin in ("PA15", "PB3", "PB10"):
        bridged.drive(pin, None)
    high = ("PA6", "PB7", "PA11", SWITCH, "PA4", "PA15", "PB3", "PB10")
    assert {pin: bridged.pin(pin) for pin in high} == dict.fromkeys(high, True)
    assert bridged.pin("PB12") is False


def test_bridge_speaks_on_other_pins_and_keeps_every_gate_low(bridged: Machine) -> None:
    with Session.open(bridged.uart) as session:
        identity = session.connect()
        assert identity["PINS"] == 1 and identity["FAULTS"] & 0xFF == 0
    assert bridged.port("PB6").is_alternate_output(6)
    assert bridged.tim4.ccer == 0, "two outputs of the chip on one pin: neither works"
    assert not bridged.pwm("PB7").enabled and not bridged.port("PB7").is_output(7)
    assert bridged.bridge() == ((None, None, None), False)
    bridged.tim1.settle(bridged.now)
    assert bridged.tim1.trace is not None
    assert not any(edge.on for edge in bridged.tim1.trace)
    for pin in HIGH_PINS + LOW_PINS:
        assert bridged.port(pin).is_alternate_output(int(pin[2:]))
    assert bridged.afio.debug_port and bridged.warnings == []


def test_gates_are_driven_low_from_the_moment_their_pins_are_outputs(bridged: Machine) -> None:
    """An output whose timer does not drive it floats, with a current through the gate driver's input at best."""
    bridged.reset()
    outputs = set()
    for _ in range(BOOT_US // 4):
        bridged.advance_us(4)
        for pin in HIGH_PINS + LOW_PINS:
            if bridged.port(pin).is_output(int(pin[2:])):
                outputs.add(pin)
                assert bridged.tim1.gate(pin, bridged.now) is False, f"{pin} at {bridged.now_us:.0f} us"
    assert outputs == set(HIGH_PINS + LOW_PINS)


def test_the_set_in_force_survives_every_kind_of_reset(bridged: Machine) -> None:
    bridged.reset()
    bridged.advance_us(BOOT_US)
    with Session.open(bridged.uart) as session:
        assert session.connect()["PINS"] == 1


@pytest.mark.slow
def test_a_quad_is_not_armed_on_the_pins_of_the_bridge(bridged: Machine) -> None:
    at_rest(bridged)
    with Session.open(bridged.uart) as session:
        session.begin("REALTIME_LIVE")
        for _ in range(200):
            session.receive(0.005)
        with pytest.raises(LinkError, match="nothing to move on these pins: wire the strap"):
            session.arm()
        for _ in range(50):
            session.receive(0.005)
        assert session.telemetry["STATUS"]["blocked"] == BLOCKED_PINS


def test_its_uart_pins_drive_a_bridge_so_it_does_not_enter_the_bootloader(bridged: Machine) -> None:
    with Session.open(bridged.uart) as session, pytest.raises(LinkError, match="this image cannot do that"):
        session.execute_idle("BOOTLOADER")


@pytest.mark.parametrize(
    ("what", "fault"),
    [(lambda m: m.drive("PB12", False), FAULT_BRIDGE), (lambda m: m.drive("PB12", None), FAULT_BRIDGE),
     (lambda m: m.set_hall(0), FAULT_HALL), (lambda m: m.set_hall(7), FAULT_HALL)],
)  # fmt: skip
def test_break_and_broken_hall_wires_are_reported_until_a_good_run_begins(
    bridged: Machine, what: Callable[[Machine], None], fault: int
) -> None:
    with Session.open(bridged.uart) as session:
        what(bridged)
        session.begin("LOCKSTEP")  # looks anew
        session.end()
        assert session.connect()["FAULTS"] & 0xFF == fault
        bridged.drive("PB12", True)
        bridged.set_hall(5)
        bridged.advance_us(1000)
        assert session.connect()["FAULTS"] & 0xFF == fault
        session.begin("LOCKSTEP")
        assert session.connect()["FAULTS"] & 0xFF == 0


def test_the_bridge_pins_stay_low_through_a_crash_and_restart(bridged: Machine) -> None:
    begin = bridged.now
    bridged.rcc.kill_crystal()
    bridged.advance_us(300_000)
    assert bridged.reset_count > 2
    bridged.tim1.settle(bridged.now)
    assert bridged.tim1.trace is not None
    assert not any(edge.on for edge in bridged.tim1.trace if edge.time >= begin)


def test_the_arm_switch_flies_the_saved_quad_and_lets_it_go(standard: Machine) -> None:
    with Session.open(standard.uart) as session:
        session.upload(session.read_parameters()[:CONTROL_WORDS], period_us=1000, esc_period_us=2500, arm_hold_ms=300)
        session.execute("SAVE")
    standard.power_cut()
    standard.power_on()
    standard.advance_us(BOOT_US)
    assert standard.pin(SWITCH) is True  # pulled up
    standard.drive(SWITCH, False)
    standard.advance_us(20_000 + 290_000)
    assert [standard.pwm(pin).pulse_us for pin in ("PB6", "PB7")] == [NEUTRAL_US] * 2  # the arming pulse
    assert standard.run_until(lambda: standard.pwm("PB6").pulse_us != NEUTRAL_US, READY_US + 320_000)
    standard.advance_us(1_000_000)
    assert standard.pwm("PB6").pulse_us != NEUTRAL_US  # no host, no keep-alive
    standard.drive(SWITCH, None)
    standard.advance_us(2500 + 1500)  # a turn of the loop, and the frame of pulses under way
    assert [standard.pwm(pin).pulse_us for pin in ("PB6", "PB7")] == [NEUTRAL_US] * 2


@pytest.mark.parametrize("hz", [50, 100, 400, 490])
def test_speed_controllers_get_their_pulses_at_any_rate(standard: Machine, hz: int) -> None:
    """1000 to 2000 us, 50 to 490 Hz: the period to half a microsecond."""
    period_us = round(1e6 / hz)
    words = dict(zip([row.name for row in table()], [row.default for row in table()], strict=True))
    assert words["esc.min_halfus"] == 2000 and words["esc.max_halfus"] == 4000
    with Session.open(standard.uart) as session:
        session.upload(session.read_parameters()[:CONTROL_WORDS], esc_period_us=period_us)
        session.begin("LOCKSTEP")
        standard.advance_us(50_000)
        assert standard.pwm("PB6") == (NEUTRAL_US, period_us, True)


def test_a_frame_under_way_ends_as_it_began(standard: Machine) -> None:
    """A shorter one that took effect at once would be run past, and no pulse would come for 33 ms."""
    timer = standard.tim4
    with Session.open(standard.uart) as session:
        control = session.read_parameters()[:CONTROL_WORDS]
        for period_us in (20_000, 2040, 20_000, 2500, 20_000, 2040):
            session.upload(control, esc_period_us=period_us)
            session.begin("LOCKSTEP")
            for _ in range(300):
                standard.advance_us(100)
                timer.settle(standard.now)
                assert timer.count(standard.now) <= timer.active_arr
            assert standard.pwm("PB6").period_us == period_us


@pytest.mark.slow
@pytest.mark.parametrize("hz", [50, 490])
def test_one_at_its_least_and_the_other_at_its_most(standard: Machine, hz: int) -> None:
    """A setpoint that asks for more than there is: 1000 and 2000 us, with both signs."""
    period_us = round(1e6 / hz)
    with Session.open(standard.uart) as session:
        control = session.read_parameters()[:CONTROL_WORDS]
        control[[row.name for row in table()].index("esc.span_halfus")] = 1100
        session.upload(control, esc_period_us=period_us, period_us=20_000, arm_hold_ms=0)
        ends = []
        for setpoint in (1 << 29, -1 << 29):
            session.begin("REALTIME_LIVE")
            session.arm()
            session.set_setpoint(setpoint)
            for _ in range(100):
                session.receive(0.005)
            waves = [standard.pwm(pin) for pin in ("PB6", "PB7")]
            assert all(wave.period_us == period_us for wave in waves)
            ends.append([wave.pulse_us for wave in waves])
            session.disarm()
        assert sorted(ends) == [[1000.0, 2000.0], [2000.0, 1000.0]]


def test_a_restart_brings_the_saved_set_into_force(image: Path) -> None:
    from plumb.boards.virtual import VirtualBoard

    with VirtualBoard(image) as board:
        session = board.session
        session.upload(session.read_parameters()[:CONTROL_WORDS], pins=1)
        session.execute_idle("SAVE")
        assert session.connect()["PINS"] == 0
        set_strap(board.machine, "bridge")
        assert board.restart().require_match()["PINS"] == 1
        assert board.machine.warnings == []
