"""What ends a run from outside the program: a loop that misses its deadline, and power that comes and goes.

The image is the one that is flashed; where it has to misbehave, its machine code is patched.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from plumb.f103.core.cpu import QUARTER_CYCLES
from plumb.f103.machine import Machine
from plumb.flash.elf import Elf
from plumb.flash.image import FLASH_BASE
from plumb.link.identity import Identity
from plumb.link.session import Session
from plumb.spec import parameters
from support.campaigns import campaign
from support.image_patches import patched
from support.pins import at_rest
from support.power import lose_power

BUILD = Path(__file__).parents[2] / "build/stm32f103"
BOOT_US = 30_000
NEUTRAL_US = 1000.0
READY_S = 1.0
"""Within this a board at rest is ready to be armed."""
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
FALLBACK_FAULT, WATCHDOG_FAULT, CRYSTAL_FAULT, CRASH_FAULT = 0x100, 0x400, 0x1000, 0x04
RETURN = struct.pack("<H", 0x4770)

pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.elf").exists(), reason="the flash image is not built: run make image"
)


def delay(us: int) -> bytes:
    """Machine code that takes so long and returns: movw, movt, then turns of two instructions, subs and bne."""
    turns = us * 72 * 4 // (2 * QUARTER_CYCLES[2])
    words = []
    for half, opcode in ((turns & 0xFFFF, 0xF240), (turns >> 16, 0xF2C0)):
        words += [opcode | half >> 12 | (half >> 11 & 1) << 10, (half >> 8 & 7) << 12 | 3 << 8 | half & 0xFF]
    return struct.pack("<6H", *words, 0x3B01, 0xD1FD) + RETURN


def started(image: bytes) -> Machine:
    machine = Machine(image)
    at_rest(machine)
    machine.advance_us(BOOT_US)
    return machine


def flying(image: bytes) -> tuple[Machine, Session]:
    """Armed, its outputs away from neutral; and whoever armed it, keeping it alive."""
    machine = started(image)
    session = Session.open(machine.uart)
    session.upload(CONTROL, period_us=1000, arm_hold_ms=0)
    session.begin("REALTIME_LIVE")
    session.arm()
    end_us = machine.now_us + 100_000.0  # a pulse changes with the next frame of 20 ms
    while machine.now_us < end_us:
        session.receive(0.005)
    assert not at_neutral(machine)
    return machine, session


def identity(machine: Machine) -> Identity:
    machine.uart.reset_input_buffer()
    with Session.open(machine.uart) as session:
        return session.require_match()


def at_neutral(machine: Machine) -> bool:
    return all(machine.pwm(pin).enabled and machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))


@pytest.mark.parametrize(("turn_us", "resets"), [(8_000, 0), (15_000, 1)])
def test_a_loop_that_comes_round_too_late_every_time_is_reset(
    image: bytes, elf: Elf, turn_us: int, resets: int
) -> None:
    """15 ms a turn would have fed a watchdog of 40 ms in time."""
    machine = Machine(patched(image, elf, "session_poll", delay(turn_us)))
    assert machine.run_until(lambda: machine.reset_count == 2, 500_000) == bool(resets)


def test_one_late_turn_is_forgiven(image: bytes) -> None:
    """Saving takes longer than the deadline of a turn, and is done in one."""
    machine = started(image)
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, period_us=3000)
        session.execute("SAVE")
        session.receive(0.5)
    assert machine.reset_count == 1


def test_armed_and_missing_steps_without_disarming_is_reset(image: bytes, elf: Elf) -> None:
    """An image that could not disarm: what should have is patched out, and a step with all about it takes longer than
    its period. Every turn still comes round in time, with as many steps in it as one may have."""
    machine = started(patched(image, elf, "arming_disarm", RETURN))
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, period_us=1000, arm_hold_ms=0)
        session.begin("REALTIME_LIVE")
        session.receive(READY_S)
        session.arm()
        session.pump()
        machine.flash.store(elf.symbol("control_step").address - FLASH_BASE, delay(500))
        machine.cpu.forget_code()
        machine.tim3.psc, machine.tim3.arr = 71, 499  # from here on the timer ticks every 500 us
        machine.tim3._restart_count(machine.now)
        assert machine.run_until(lambda: machine.reset_count == 2, 400_000)
    machine.advance_us(BOOT_US)
    assert at_neutral(machine)
    assert identity(machine)["FAULTS"] & WATCHDOG_FAULT


@pytest.mark.slow
@pytest.mark.parametrize("brown", [False, True], ids=["power cut", "brown-out"])
def test_power_fails_at_any_cycle_of_the_start(image: bytes, brown: bool) -> None:
    """Whatever was half set up, the next start is as good as the first, and reports its cause."""
    chance = random.Random(7)
    machine = started(image)
    for _ in range(campaign(25, 60)):
        machine.reset()
        machine.run_to(machine.now + chance.randrange(8_000 * 40320))
        lose_power(machine, brown)
        machine.advance_us(BOOT_US)
        assert at_neutral(machine)
    report = identity(machine)
    assert report.reset_cause == "power" and report["FAULTS"] == 0 and report["CRASH_PC"] == 0
    assert machine.warnings == []


@pytest.mark.slow
@pytest.mark.parametrize("brown", [False, True], ids=["power cut", "brown-out"])
def test_power_fails_in_flight(image: bytes, brown: bool) -> None:
    """Armed, driving, at any cycle: off at once, then neutral, disarmed and without a run."""
    chance = random.Random(8)
    machine, session = flying(image)
    snapshot = machine.snapshot(session)
    for _ in range(5):
        machine.restore(snapshot)
        machine.run_to(machine.now + chance.randrange(5_000 * 40320))
        lose_power(machine, brown)
        seen = set()
        for _look in range(300):
            machine.advance_us(100)
            seen.add((machine.pwm("PB6").enabled, machine.pwm("PB6").pulse_us))
        assert seen <= {(False, 0.0), (True, 0.0), (True, NEUTRAL_US)} and at_neutral(machine)
        assert identity(machine).reset_cause == "power"
        machine.uart.read(4096)
        machine.run_until(lambda: False, 120_000)
        with Session.open(machine.uart) as after:
            after.receive(0.2)
            status = after.telemetry["STATUS"]
            assert (status["armed"], status["mode"]) == (0, 0) and status["blocked"] & 2


@pytest.mark.slow
def test_a_crystal_that_dies_in_flight_is_reported_to_the_host(image: bytes) -> None:
    """Armed and driving: neutral at once, and the host finds the board idle, disarmed, at 64 MHz, off the CAN bus."""
    machine, _session = flying(image)
    machine.rcc.kill_crystal()
    assert machine.run_until(lambda: at_neutral(machine), 5_000)
    machine.advance_us(BOOT_US)
    report = identity(machine)
    assert report.reset_cause == "software" and report["CRASH_EXCEPTION"] == 2
    assert report["FAULTS"] & (CRYSTAL_FAULT | FALLBACK_FAULT) == CRYSTAL_FAULT | FALLBACK_FAULT
    with Session.open(machine.uart) as after:
        for _turn in range(100):
            after.receive(0.01)
        assert after.telemetry["STATUS"]["mode"] == 0 and after.telemetry["STATUS"]["armed"] == 0
    assert not machine.can.listening and machine.warnings == []


def test_a_crash_whose_reset_fails_is_neutral_until_the_watchdog_ends_it(
    image: bytes, elf: Elf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found in flight by the stack guard. The reset is all that usually switches off; here it does not come."""
    machine, _session = flying(image)
    reset, resets = machine.request_reset, machine.reset_count
    monkeypatch.setattr(machine, "request_reset", lambda cause: None if cause == "software" else reset(cause))
    machine.cpu.ram[elf.symbol("stack_guard").address - 0x20000000] ^= 0xFF
    assert machine.run_until(lambda: at_neutral(machine), 25_000) and machine.reset_count == resets
    for _look in range(15):
        machine.advance_us(1000)
        assert at_neutral(machine) and machine.reset_count == resets
    assert machine.run_until(lambda: machine.reset_count > resets, 30_000)
    machine.advance_us(BOOT_US)
    report = identity(machine)
    assert report.reset_cause == "window watchdog"
    assert report["FAULTS"] & (CRASH_FAULT | WATCHDOG_FAULT) == CRASH_FAULT | WATCHDOG_FAULT


def test_every_reset_says_what_it_was(image: bytes, elf: Elf) -> None:
    machine = started(image)
    assert identity(machine).reset_cause == "power"
    machine.reset()
    machine.advance_us(BOOT_US)
    assert identity(machine).reset_cause == "reset pin"
    guard = elf.symbol("stack_guard").address - 0x20000000
    machine.cpu.ram[guard] ^= 0xFF
    machine.advance_us(BOOT_US)
    assert identity(machine).reset_cause == "software"
    machine.request_reset("iwdg")
    machine.advance_us(BOOT_US)
    assert identity(machine).reset_cause == "watchdog"
