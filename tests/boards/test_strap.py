"""The strap alone decides where UART and timers go; with a saved pin set that disagrees, no actuator pin is driven.

The image is that of `vehicles`, which has the actuators of all four pin sets."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.boards.strap import GROUNDED, set_strap
from plumb.boards.virtual_can import MachineBus
from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.f103.peripherals.tim1 import HIGH_PINS, LOW_PINS
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.pin_sets import PIN_SETS
from support.pins import at_rest
from support.vehicles_image import vehicles_image

ROOT = Path(__file__).parents[2]
ALL = ROOT / "build/stm32f103/firmware.bin"
pytestmark = pytest.mark.skipif(not ALL.exists(), reason="the flash image is not built: run make image")
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 60_000
ESC_PINS, GATE_PINS, ROTOR_PINS = ("PB6", "PB7"), HIGH_PINS + LOW_PINS, ("PA0", "PA1", "PA2", "PA3")
WHEEL_PINS = ("PB14", "PB15", "PA8", "PB13", "PB0", "PB1")
ACTUATORS = {"standard": ESC_PINS, "bridge": GATE_PINS, "quadrotor": ROTOR_PINS, "wheels": WHEEL_PINS}
TABLES = tuple(ACTUATORS)
BOTH_LOW_SIDES = 0x440
"""CC2NE and CC3NE of TIM1_CCER."""
UART_PINS = {
    "standard": ("PA9", "PA10"),
    "bridge": ("PB6", "PB7"),
    "quadrotor": ("PA9", "PA10"),
    "wheels": ("PA9", "PA10"),
}
SETS = {"standard": 0, "bridge": 1, "quadrotor": 2, "wheels": 3}
CAPTURES = 3
"""CC1S of TIM1_CCMR1: PA8 is an input, the receiver's pulse train."""
FAULT_STRAP, BLOCKED_PINS, BLOCKED_FAULT = 0x8000, 1 << 9, 1 << 3


def outputs(machine: Machine) -> set[str]:
    """Every pin that the board drives, but those of CAN, I2C and SPI, which every pin set has at the same place."""
    shared = {"PA4", "PA5", "PA7", "PA12", "PB8", "PB9"}
    pins = {f"P{'ABC'[i]}{n}" for i in range(3) for n in range(16) if machine.ports[i].is_output(n)}
    return pins - shared


class Outputs:
    """Every pin that was ever an output, from power-on."""

    def __init__(self, machine: Machine) -> None:
        self.ever: set[str] = set()
        for port in machine.ports[:3]:
            changed = port._changed

            def look(changed: object = changed) -> None:
                assert callable(changed)
                changed()
                self.ever |= outputs(machine)

            port._changed = look  # type: ignore[method-assign]


def saved(pins: str) -> bytes:
    """The slots of a board on which this pin set was saved."""
    machine = Machine(vehicles_image())
    machine.advance_us(BOOT_US)
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, pins=SETS[pins])
        session.execute("SAVE")
    return bytes(machine.cpu.flash[0xF000:0x10000])


@pytest.fixture(scope="module")
def slots() -> dict[str, bytes]:
    return {"standard": b"", **{pins: saved(pins) for pins in TABLES[1:]}}


def started(strap: str, slots: bytes) -> tuple[Machine, Outputs]:
    machine = Machine(vehicles_image())
    set_strap(machine, strap)
    at_rest(machine)
    machine.flash.store(0xF000, slots)
    watched = Outputs(machine)
    machine.advance_us(BOOT_US)
    return machine, watched


def test_the_parameter_that_saves_a_pin_set_names_them_all() -> None:
    [row] = [row for row in parameters.table() if row.name == "pins"]
    said = ", ".join(f"{number} {one.name} ({one.drives})" for number, one in enumerate(PIN_SETS))
    assert row.max == len(PIN_SETS) - 1 and said in row.doc


@pytest.mark.parametrize("strap", GROUNDED)
@pytest.mark.parametrize("table", TABLES)
def test_no_pin_is_driven_that_the_strap_does_not_allow(slots: dict[str, bytes], strap: str, table: str) -> None:
    """Not for a moment, since power-on: no UART on a speed controller or a gate."""
    machine, watched = started(strap, slots[table])
    uart = set(UART_PINS[strap][:1])
    actuators = set(ACTUATORS[strap]) if strap == table else set()
    assert watched.ever == uart | actuators
    assert machine.warnings == []
    assert all(machine.pwm(pin).enabled == (strap == table == "standard") for pin in ESC_PINS)
    # The timers themselves: a pin that is no output would hide one that runs.
    pulses = [machine.tim4.output(channel, machine.now).enabled for channel in range(2)]
    assert pulses == [strap == table == "standard"] * 2
    rotors = [machine.pwm(pin).enabled for pin in ROTOR_PINS]
    assert rotors == [strap == table == "quadrotor"] * 4
    assert bool(machine.tim2.ccer & 0x1110) == (strap == table == "quadrotor")
    motors = machine.tim1.active_ccer == BOTH_LOW_SIDES
    assert motors == (strap == table == "wheels")
    bridge = machine.tim1.cr1 & 1 and not machine.tim1.ccmr1 & CAPTURES and not motors
    assert bool(bridge) == (strap == table == "bridge")
    encoders = [timer.smcr & 7 == 3 for timer in (machine.tim2, machine.tim4)]
    assert encoders == [strap == table == "wheels"] * 2
    assert not any(encoders) or machine.tim2.arr == machine.tim4.arr == 0xFFFF, "nothing of pulses"
    assert machine.duty("PB14") is machine.duty("PB15") is None, "no motor turns before it is armed"
    assert not any(machine.pin(pin) for pin in WHEEL_PINS if motors)


def test_an_image_without_wheels_leaves_all_their_pins_alone() -> None:
    machine = Machine(ALL)
    set_strap(machine, "wheels")
    machine.advance_us(BOOT_US)
    assert outputs(machine) == {"PA9"}


@pytest.mark.parametrize("strap", GROUNDED)
@pytest.mark.parametrize("table", TABLES)
def test_a_disagreement_is_reported_and_blocks_arming(slots: dict[str, bytes], strap: str, table: str) -> None:
    machine, _ = started(strap, slots[table])
    machine.drive("PB12", True)
    machine.set_hall(5)
    machine.advance_us(1000)
    with Session.over(MachineBus(machine, "the virtual board")) as session:  # CAN is at the same place in every set
        assert session.identity is not None and session.identity["PINS"] == SETS[strap]
        agreed = strap == table
        assert bool(session.identity["FAULTS"] & FAULT_STRAP) == (not agreed)
        if not agreed:
            session.begin("REALTIME_LIVE")
            with pytest.raises(LinkError, match="the board has a fault; this system has nothing to move on these pins"):
                session.arm()
            assert outputs(machine) == set(UART_PINS[strap][:1])


def test_the_strap_selects_the_uart_and_the_pin_set_is_set_over_it(slots: dict[str, bytes]) -> None:
    """A blank board with the strap of the bridge: gates off, the UART on PB6 and PB7; then the parameter agrees."""
    machine, _ = started("bridge", b"")
    machine.drive("PB12", True)
    machine.set_hall(5)
    with Session.open(machine.uart) as session:
        assert session.connect()["FAULTS"] & FAULT_STRAP
        session.upload(CONTROL, pins=1)
        session.execute("SAVE")
        assert session.connect()["FAULTS"] & FAULT_STRAP  # until the next start
    machine.reset()
    machine.advance_us(BOOT_US)
    with Session.open(machine.uart) as session:
        assert session.connect()["FAULTS"] & (FAULT_STRAP | 0xFF) == 0
    assert outputs(machine) == {"PB6", *GATE_PINS}


def test_the_strap_is_read_once(slots: dict[str, bytes]) -> None:
    machine, watched = started("standard", b"")
    set_strap(machine, "bridge")
    machine.advance_us(100_000)
    assert watched.ever == {"PA9", *ESC_PINS}
    machine.reset()
    machine.advance_us(BOOT_US)
    assert outputs(machine) == {"PB6"}


def test_a_slow_pull_up_and_a_noisy_wire_are_not_taken_for_a_strap(slots: dict[str, bytes]) -> None:
    slow = Machine(vehicles_image())
    for pin in (4, 5):
        slow.port("PB4").rise_us[pin] = 450.0
    slow.advance_us(BOOT_US)
    assert outputs(slow) == {"PA9", *ESC_PINS}

    noisy = Machine(vehicles_image())
    port = noisy.port("PB5")
    level, looks = port.level, [0]

    def flicker(pin: int) -> bool | None:
        looks[0] += pin == 5
        return not level(pin) if pin == 5 and looks[0] % 3 == 0 else level(pin)

    port.level = flicker  # type: ignore[method-assign]
    noisy.advance_us(BOOT_US)
    assert outputs(noisy) == set()


def test_doctor_names_both_sides_of_a_disagreement(
    slots: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def opened(spec: str, link: str) -> LinkBoard:
        machine, _ = started("standard", slots["bridge"])
        return LinkBoard(spec, Session.open(machine.uart))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    assert front.main(["doctor", "--board", "virtual"]) == 1
    said = capsys.readouterr().out
    assert "MISS pins: the strap says standard; the parameters are for bridge" in said
    assert "the strap and the saved parameter pins disagree: no actuator pin is driven" in said
