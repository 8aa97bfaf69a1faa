"""The loop that feeds the CRC unit, taken many turns at once: time, memory and answers are those of turn after turn."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from unicorn.arm_const import UC_ARM_REG_R0

from plumb.f103.core.cpu import BRANCH_TO_ITSELF, FLASH_BASE, RAM_BASE, Cpu, Registers
from plumb.f103.core.crc_loop import BEFORE, CODE_BYTES, CrcLoop, crc_loop
from plumb.f103.machine import Machine
from plumb.f103.peripherals.crc import BASE as CRC_BASE
from plumb.f103.peripherals.crc import Crc
from plumb.link.session import Session
from plumb.spec import parameters
from support.pins import at_rest

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.bin"
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
CODE = {
    "first": 0x601C,  # str r4, [r3]
    "load": 0xC8C0,  # ldmia r0!, {r6, r7}
    "second": 0x601D,  # str r5, [r3]
    "third": 0x601E,
    "load ahead": 0xC830,  # ldmia r0!, {r4, r5}
    "fourth": 0x601F,
    "first again": 0x601C,
    "load again": 0xC8C0,
    "second again": 0x601D,
    "compare": 0x4288,  # cmp r0, r1
    "third again": 0x601E,
    "load ahead again": 0xC830,
    "last": 0x601F,
    "branch": 0xD1F1,  # bne to the first store
}


def code(**instead: int) -> bytes:
    """The turn."""
    return struct.pack(f"<{len(CODE)}H", *(CODE | instead).values())


def test_the_loop_is_known_by_its_code() -> None:
    assert len(code()) == CODE_BYTES and struct.unpack_from("<H", code(), BEFORE) == (CODE["last"],)
    assert crc_loop(code()) == CrcLoop(source=0, end=1, loaded=(4, 5, 6, 7))


@pytest.mark.parametrize(
    "other",
    [
        {"load": 0xC8D0},  # r4 and r6
        {"load": 0xC8E0},  # three words
        {"load": 0xC8C1},  # the address is among what is loaded
        {"load again": 0xC9C0},  # from another address
        {"load ahead": 0xC030},  # words are stored, not loaded
        {"second": 0x601C},  # a word twice
        {"third again": 0x6016},  # to another register
        {"third": 0x605E},  # to another address
        {"fourth": 0x701F},  # a byte
        {"last": 0x605F},
        {"compare": 0x4289},  # another register than the address
        {"branch": 0xD1F0},  # to somewhere else
        {"branch": 0xD0F1},  # on another condition
    ],
    ids=str,
)
def test_what_differs_is_no_such_loop(other: dict[str, int]) -> None:
    assert crc_loop(code(**other)) is None


def test_words_that_are_stored_in_another_order_than_loaded_are_no_such_loop() -> None:
    swapped = {"first": 0x601D, "second": 0x601C, "first again": 0x601D, "second again": 0x601C}
    assert crc_loop(code(**swapped)) is None


LOAD_AHEAD = b"\x30\xc8"
"""ldmia r0!, {r4, r5}"""


def turned(at_once: bool, *slices: int) -> tuple[list[int], int, bytes]:
    """The registers, the instructions and the unit's words after slices of so many instructions of the loop."""
    machine = Machine(IMAGE, seed=3)
    cpu, machine.crc.clocked = machine.cpu, True
    cpu.loops_at_once = at_once
    at = len(cpu.flash) - 64
    cpu.flash[at : at + CODE_BYTES + 4] = LOAD_AHEAD + code() + BRANCH_TO_ITSELF
    cpu.forget_code()
    cpu.ram[: 4 * 80] = struct.pack("<80I", *range(1000, 1080))
    registers = Registers(cpu.uc, *range(UC_ARM_REG_R0, UC_ARM_REG_R0 + 13))
    registers.write(RAM_BASE, RAM_BASE + 4 * 80, 0, CRC_BASE, *range(9))
    cpu.pc = FLASH_BASE + at
    for instructions in slices:
        cpu.run(instructions)
    return registers.read(), cpu.instructions, bytes(machine.crc.waiting)


@pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
@pytest.mark.parametrize("slices", [(150,), (43, 17, 60), (140, 1, 4)], ids=str)
def test_registers_after_a_slice_are_those_of_every_turn(slices: tuple[int, ...]) -> None:
    """Ten turns of 14 instructions: all, a slice that ends within, one that ends in front of the last branch."""
    assert turned(True, *slices) == turned(False, *slices)


def flown(at_once: bool) -> tuple[object, ...]:
    """The state after a live run that is armed, watched and ended: everything in which two ways to count could
    differ."""
    machine = Machine(IMAGE, seed=3)
    machine.cpu.loops_at_once = at_once
    at_rest(machine)
    machine.advance_us(30_000)
    received = bytearray()
    session = Session.open(machine.uart)
    session.upload(CONTROL, period_us=1000, arm_hold_ms=0)
    session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
    session.arm()
    for _ in range(20):
        session.receive(0.005)
        received += repr(session.telemetry).encode()
    session.close()
    cpu = machine.cpu
    return bytes(received), cpu.instructions, cpu.base, cpu.slept_ticks, cpu.pc, bytes(cpu.ram), machine.crc.dr


@pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
def test_many_turns_at_once_leave_what_every_turn_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []
    feed = Cpu._feed

    def counting(cpu: Cpu, crc: Crc) -> None:
        before = len(crc.waiting)
        feed(cpu, crc)
        taken.append(len(crc.waiting) - before)

    monkeypatch.setattr(Cpu, "_feed", counting)
    assert flown(at_once=False) == flown(at_once=True)
    assert sum(taken) > 10_000, "the firmware has the loop"
