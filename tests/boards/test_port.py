"""The flash image on the simulated part, as far as the port is concerned: clocks, outputs, resets, faults.

What the port knows is read from its memory by symbol: these tests hold whatever is being said on the link.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from plumb.f103.machine import Machine
from plumb.flash.elf import Elf

BUILD = Path(__file__).parents[2] / "build/stm32f103"
FAULT_ADC, FAULT_LATE, FAULT_HARD, FAULT_IMAGE = 1, 2, 4, 8
FAULT_CLOCK_FALLBACK, FAULT_WATCHDOG, FAULT_CRYSTAL = 0x100, 0x400, 0x1000
BOOT_US = 30_000
NEUTRAL_US = 1000.0
HANG, UNDEFINED = b"\xfe\xe7", b"\x00\xde"
"""Machine code: a branch to itself, and an instruction that does not exist."""

pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.elf").exists(), reason="the flash image is not built: run make image"
)


def _word(machine: Machine, elf: Elf, symbol: str, index: int = 0) -> int:
    offset = elf.symbol(symbol).address - 0x20000000 + 4 * index
    return int(struct.unpack_from("<I", machine.cpu.ram, offset)[0])


def _faults(machine: Machine, elf: Elf) -> int:
    return _word(machine, elf, "start_faults")


def _patched(image: bytes, elf: Elf, function: str, code: bytes) -> bytes:
    at = elf.symbol(function).address - 0x08000000
    return image[:at] + code + image[at + len(code) :]


def _at_neutral(machine: Machine) -> bool:
    return all(machine.pwm(pin).enabled and machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))


@pytest.mark.parametrize("part", ["stm32f103c8", "stm32f103rct6", "stm32f103zet6"])
def test_starts_clean_on_every_part(image: bytes, elf: Elf, part: str) -> None:
    machine = Machine(image, part)
    machine.advance_us(BOOT_US)
    assert machine.warnings == []
    assert _faults(machine, elf) == 0
    assert _word(machine, elf, "mhz") == 72
    assert machine.usart.baud == pytest.approx(921600, rel=0.002)
    assert _at_neutral(machine)
    part_id, *_, flash_kib, _ram_kib = (_word(machine, elf, "identity", i) for i in range(9))
    assert flash_kib == machine.part.flash_kib
    assert part_id == machine.part.idcode & 0xFFF


def test_neutral_pulses_come_at_once(image: bytes) -> None:
    """Within 5 ms of reset, and never anything else on the pins before."""
    machine = Machine(image)
    assert machine.run_until(lambda: machine.pwm("PB6").enabled, 5000)
    assert machine.run_until(lambda: machine.pwm("PB6").pulse_us > 0, 5000)
    assert _at_neutral(machine)
    preloaded = 0x0808  # OC1PE, OC2PE: a change waits for the end of the frame, so no pulse is cut or doubled
    assert machine.tim4.ccmr1 & preloaded == preloaded


def test_without_a_crystal(image: bytes, elf: Elf) -> None:
    machine = Machine(image, crystal=False)
    machine.advance_us(200_000)
    assert _faults(machine, elf) == FAULT_CLOCK_FALLBACK
    assert _word(machine, elf, "mhz") == 64
    assert machine.usart.baud == pytest.approx(921600, rel=0.01)
    assert _at_neutral(machine) and machine.reset_count == 1


def test_without_crystal_and_pll_it_still_does_not_hang(image: bytes, elf: Elf) -> None:
    machine = Machine(image, crystal=False)
    machine.rcc.pll_dead = True
    machine.advance_us(400_000)
    assert _faults(machine, elf) == FAULT_CLOCK_FALLBACK
    assert _at_neutral(machine) and machine.reset_count == 1


def test_a_crystal_that_dies_in_flight(image: bytes, elf: Elf) -> None:
    """The clock security system raises NMI: reset, and on with the internal oscillator, not waiting for the crystal."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    machine.rcc.kill_crystal()
    assert machine.run_until(lambda: machine.reset_count == 2, 1000)
    assert machine.run_until(lambda: _at_neutral(machine), 5000)
    machine.advance_us(BOOT_US)
    assert machine.reset_count == 2
    assert _faults(machine, elf) == FAULT_CLOCK_FALLBACK | FAULT_CRYSTAL
    assert _word(machine, elf, "identity", 11) == 2  # crash_exception: NMI
    assert _at_neutral(machine)


def test_a_damaged_image_is_noticed(image: bytes, elf: Elf) -> None:
    damaged = bytearray(image)
    damaged[0x130 + 24] ^= 1  # a reserved word of the header: nothing else depends on it
    machine = Machine(bytes(damaged))
    machine.advance_us(BOOT_US)
    assert _faults(machine, elf) == FAULT_IMAGE


def test_a_hanging_loop_is_reset(image: bytes, elf: Elf) -> None:
    machine = Machine(_patched(image, elf, "session_poll", HANG))
    assert machine.run_until(lambda: machine.reset_count == 2, 500_000)
    assert machine.now_us < BOOT_US + 45_000  # the window watchdog; the independent one takes 167 ms and more
    machine.advance_us(BOOT_US)
    assert _faults(machine, elf) == FAULT_WATCHDOG | FAULT_IMAGE


def test_a_crash_is_reported_after_the_reset(image: bytes, elf: Elf) -> None:
    machine = Machine(_patched(image, elf, "session_poll", UNDEFINED), faults="run")
    assert machine.run_until(lambda: machine.reset_count == 2, BOOT_US)
    machine.run_until(lambda: machine.reset_count == 3, BOOT_US)
    assert _word(machine, elf, "identity", 10) == elf.symbol("session_poll").address
    assert _word(machine, elf, "identity", 11) == 3  # crash_exception: HardFault


def test_a_stack_that_reaches_its_guard(image: bytes, elf: Elf) -> None:
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    guard = elf.symbol("stack_guard").address - 0x20000000
    machine.cpu.ram[guard + 28] ^= 0xFF
    machine.advance_us(1100)
    assert machine.reset_count == 2
    machine.advance_us(BOOT_US)
    assert _faults(machine, elf) == FAULT_HARD


WITHOUT_A_STACK = {
    "runs out of RAM": struct.pack("<HH", 0xB4FF, 0xE7FD),  # push {r0-r7}; again
    "points nowhere, then a fault": struct.pack("<HHH", 0x2008, 0x4685, 0xDE00),  # movs r0, #8; mov sp, r0; udf
    "points nowhere, then an interrupt": struct.pack("<HHH", 0x2008, 0x4685, 0xE7FE),  # ... b .
    "points to no memory, then a fault": struct.pack("<HHHHH", 0x2020, 0xF2C3, 0x0000, 0x4685, 0xDE00),  # 0x30000020
    "ends where RAM begins": struct.pack("<HHHHH", 0x2020, 0xF2C2, 0x0000, 0x4685, 0xDE00),  # room for one frame
}


@pytest.mark.parametrize("code", WITHOUT_A_STACK.values(), ids=WITHOUT_A_STACK.keys())
def test_without_a_stack_it_is_reset_all_the_same_and_at_once(image: bytes, elf: Elf, code: bytes) -> None:
    """The handler brings a stack of its own, and reads no frame where none can be."""
    machine = Machine(_patched(image, elf, "session_poll", code), faults="run")
    assert machine.run_until(lambda: machine.reset_count == 2, BOOT_US), "no need of the watchdog's 160 ms"
    assert machine.warnings == []
    reported = machine.run_until(lambda: _word(machine, elf, "identity", 11) == 3, BOOT_US // 3)
    assert reported, "crash_exception: HardFault"


def test_a_pin_reset_forgets_the_crash(image: bytes, elf: Elf) -> None:
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    machine.rcc.kill_crystal()
    machine.advance_us(200_000)
    machine.rcc.crystal_dead = False
    machine.reset()
    machine.advance_us(BOOT_US)
    assert _faults(machine, elf) == 0


def test_a_note_that_power_damaged_reports_nothing(image: bytes, elf: Elf) -> None:
    """Memory after a dip of the supply may hold any part of it."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    machine.rcc.kill_crystal()
    assert machine.run_until(lambda: machine.reset_count == 2, 1000)
    machine.rcc.crystal_dead = False
    machine.cpu.ram[elf.symbol("note").address - 0x20000000 + 8] ^= 1
    machine.advance_us(BOOT_US)
    assert _faults(machine, elf) == 0 and _word(machine, elf, "identity", 11) == 0


def test_noise_on_the_line_is_counted_and_survived(image: bytes, elf: Elf) -> None:
    """A host at the wrong rate, then the right one: errors are counted up to 255 and nothing is stuck."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    machine.uart.baudrate = 115200
    machine.uart.write(bytes(range(256)) * 4)
    machine.advance_us(100_000)
    assert 0 < _word(machine, elf, "errors") <= 255
    machine.uart.baudrate = 921600
    machine.uart.read(4096)
    machine.uart.write(b"\rV\r")
    machine.advance_us(2000)
    assert machine.uart.read(64).rstrip(b"\r\a").lstrip(b"\r\a").startswith(b"V")
    assert machine.reset_count == 1


def test_time_goes_on_while_it_sleeps(image: bytes, elf: Elf) -> None:
    """Idle, the loop runs once a millisecond and sleeps for the rest; its clock agrees with the outside."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    started_us, board_us, awake = machine.now_us, _word(machine, elf, "last_us"), machine.awake_ticks()
    machine.advance_us(2_000_000)
    assert _word(machine, elf, "last_us") - board_us == pytest.approx(machine.now_us - started_us, abs=1100)
    assert (machine.awake_ticks() - awake) / machine.now < 0.1
