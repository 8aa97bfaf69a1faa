"""The flash image saving its parameters: under power cuts at every operation and any two in a row, worn, on every part.

What all ways to leave an operation half done lead to is tried on the C by itself, in tests/c/test_store.c.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.errors import LinkError
from plumb.f103 import Machine
from plumb.f103.peripherals.flash import LOCK, torn
from plumb.flash.elf import Elf
from plumb.link.session import Session
from plumb.spec import parameters
from support.campaigns import LONG

Operation = tuple[int, bytes]
"""Offset in the two slots, and the bytes that are there afterwards: ff is erased."""

SLOTS, SLOT = 0xF000, 0x800


CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 30_000


def table(period_us: int) -> list[int]:
    return parameters.whole_table(CONTROL, period_us=period_us)


def save(machine: Machine, period_us: int) -> None:
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, period_us=period_us)
        session.execute("SAVE")


def found(machine: Machine) -> tuple[list[int], str]:
    """Values in use after a reset, and where they come from."""
    machine.reset()
    machine.advance_us(BOOT_US)
    machine.uart.reset_input_buffer()
    with Session.open(machine.uart) as session:
        assert session.identity is not None
        return session.read_parameters(), session.identity.parameter_source


def test_a_clone_whose_lock_reads_0_while_it_is_locked_saves(image: Path) -> None:
    machine = Machine(image)
    machine.flash.hides_lock = True
    machine.advance_us(BOOT_US)
    for period_us in (3000, 4000):
        save(machine, period_us)
        assert found(machine)[0] == table(period_us)
    assert machine.warnings == []


@pytest.mark.parametrize("part", ["stm32f103c8", "stm32f103rct6", "stm32f103zet6"])
def test_the_image_saves_on_every_part(image: Path, part: str) -> None:
    machine = Machine(image, part)
    machine.advance_us(BOOT_US)
    code = bytes(machine.cpu.flash[:SLOTS])
    for number, period_us in enumerate((3000, 4000, 5000), 1):
        begun = machine.now_us
        machine.flash.journal = []
        save(machine, period_us)
        erased = [operation.offset for operation in machine.flash.journal if len(operation.after) > 2]
        slot = SLOTS + (number + 1) % 2 * SLOT
        assert erased == list(range(slot, slot + SLOT, machine.flash.page_bytes)), "each page once"
        # Two pages of 40 ms, up to 1024 half-words of 70 us, and the line's frames: 152 ms, half as much again.
        assert machine.now_us - begun < 250_000
        assert found(machine) == (table(period_us), f"saved in flash, number {number}")
    assert bytes(machine.cpu.flash[:SLOTS]) == code
    assert set(machine.cpu.flash[SLOTS + 4096 :]) <= {0xFF}
    assert machine.warnings == [] and machine.reset_count == 4


def test_saved_parameters_are_read_in_a_few_milliseconds(image: Path) -> None:
    """At 8 MHz, before the clock is set up: no entry is looked for in the whole table."""
    started_us = []
    machine = Machine(image)
    for _ in range(2):
        begun = machine.now_us
        assert machine.run_until(lambda: bool(machine.tim4.cr1 & 1), 100_000)
        started_us.append(machine.now_us - begun)
        machine.advance_us(BOOT_US)
        save(machine, 3000)
        machine.reset()
    blank, saved = started_us
    assert blank < saved < blank + 4000


@pytest.mark.parametrize("lsi_hz", [30_000, 60_000])
def test_no_watchdog_bites_while_it_saves(image: Path, lsi_hz: int) -> None:
    machine = Machine(image)
    machine.iwdg.lsi_hz = lsi_hz
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    save(machine, 4000)
    assert machine.reset_count == 1


def test_nor_while_it_finds_that_a_slot_is_worn_out(image: Path) -> None:
    """Both slots in one save, which takes longer than the fastest watchdog waits."""
    machine = Machine(image)
    machine.iwdg.lsi_hz = 60_000
    machine.advance_us(BOOT_US)
    machine.flash.wear(0x08000000 + SLOTS + 2 * (5 + 3 * len(parameters.table()) + 1), 0xFF, 0)  # its CRC
    save(machine, 3000)
    assert machine.reset_count == 1 and found(machine) == (table(3000), "saved in flash, number 1")


class Slots:
    """The two slots as bytes, and what a start of the image makes of them."""

    def __init__(self, image: Path) -> None:
        self.machine = Machine(image)
        self.values = Elf(image.with_suffix(".elf")).symbol("params").address - 0x20000000

    @property
    def now(self) -> bytes:
        return bytes(self.machine.cpu.flash[SLOTS : SLOTS + 2 * SLOT])

    def journal_of_saving(self, period_us: int) -> list[Operation]:
        """What the flash is asked for: (offset in the slots, bytes) in order."""
        self.machine.flash.journal = []
        save(self.machine, period_us)
        operations, self.machine.flash.journal = self.machine.flash.journal, None
        return [(operation.offset - SLOTS, operation.after) for operation in operations]

    def period_found_in(self, slots: bytes) -> int:
        """period_us of the set that the image has found by the time its outputs begin; it must be all of that set."""
        machine = self.machine
        machine.power_cut()
        machine.cpu.flash[SLOTS : SLOTS + 2 * SLOT] = slots
        machine.power_on()
        assert machine.run_until(lambda: bool(machine.tim4.cr1 & 1), 100_000)
        count = len(parameters.table())
        values = list(struct.unpack_from(f"<{count}I", machine.cpu.ram, self.values))
        index = [row.name for row in parameters.table()].index("period_us")
        assert values == [value & 0xFFFFFFFF for value in table(values[index])], "a mixture"
        return int(values[index])

    def torn(self, slots: bytes, operation: Operation, odds: float = 0.5) -> bytes:
        """The slots with this operation half done."""
        at, after = operation
        half = torn(slots[at : at + len(after)], after, odds, self.machine.chance)
        return slots[:at] + half + slots[at + len(after) :]


def done(slots: bytes, operation: Operation) -> bytes:
    at, after = operation
    return slots[:at] + after + slots[at + len(after) :]


def every_cut(slots: bytes, operations: list[Operation]) -> Iterator[tuple[int, bytes]]:
    """(number, the slots before) of every operation."""
    for number, operation in enumerate(operations):
        yield number, slots
        slots = done(slots, operation)


@pytest.fixture
def slots(image: Path) -> Slots:
    s = Slots(image)
    s.machine.advance_us(BOOT_US)
    save(s.machine, 3000)
    return s


@pytest.mark.slow
def test_power_fails_at_any_operation_and_at_any_two_in_a_row(slots: Slots) -> None:
    """The image says what it writes, every cut of it is made, and every result is started.

    Of the save after a cut, only what precedes the blank slot can still meet what the cut left; from there on the slots
    are the same as in a save that no cut came before. Both ends of a save and every ninth operation between them, which
    are all alike, unless PLUMB_LONG=1.
    """
    before = slots.now
    operations = slots.journal_of_saving(4000)
    assert len(operations) == 1 + 2 + 5 + 3 * len(parameters.table()) + 2 + 1
    after = slots.now
    assert slots.period_found_in(before) == 3000 and slots.period_found_in(after) == 4000
    end_of_set = operations[-1][0] - SLOT
    seen = set()
    chosen = {n for n in range(len(operations)) if LONG or n < 12 or n >= len(operations) - 6 or n % 9 == 0}
    cuts = [slots.torn(found, operations[n]) for n, found in every_cut(before, operations) if n in chosen]
    cuts.append(after)  # the seal reads as programmed, and is not
    for once in cuts:
        period_us = slots.period_found_in(once)
        seen.add(period_us)
        used = SLOT if period_us == 4000 else 0
        again = [(used + end_of_set, b"\0\0"), *((SLOT - used + page, b"\xff" * 1024) for page in (0, 1024))]
        for second, left in every_cut(once, again):
            assert slots.period_found_in(slots.torn(left, again[second])) == period_us
            ready = done(left, again[second])
        whole = after if used else before
        assert ready[used : used + SLOT] == whole[used : used + SLOT]
        assert set(ready[SLOT - used : 2 * SLOT - used]) == {0xFF}
    assert seen == {3000, 4000}


def test_a_save_after_a_cut_begins_with_the_seal_and_two_erases(slots: Slots) -> None:
    """Whatever the cut left; and it succeeds."""
    before = slots.now
    operations = slots.journal_of_saving(4000)
    end_of_set = operations[-1][0] - SLOT
    for number in (0, 1, 2, 3, 100, len(operations) - 2, len(operations) - 1):
        left = dict(every_cut(before, operations))[number]
        period_us = slots.period_found_in(slots.torn(left, operations[number]))
        slots.machine.advance_us(BOOT_US)
        used = SLOT if period_us == 4000 else 0
        again = slots.journal_of_saving(5000)
        assert again[:3] == [(used + end_of_set, b"\0\0")] + [
            (SLOT - used + page, b"\xff" * 1024) for page in (0, 1024)
        ]
        assert slots.period_found_in(slots.now) == 5000
    assert slots.machine.warnings == []


def test_power_that_fails_while_it_saves(image: Path) -> None:
    """The supply goes in the middle of an operation of the controller, and nobody gets an answer."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    for cut in (0, 1, 2, 3, 7, 150):
        machine.flash.cut_power_in = cut
        with pytest.raises(LinkError):
            save(machine, 4000)
        assert not machine.powered
        machine.power_on()
        machine.advance_us(BOOT_US)
        assert found(machine) == (table(3000), "saved in flash, number 1")
    save(machine, 4000)
    assert found(machine) == (table(4000), "saved in flash, number 2")


def test_a_worn_half_word_is_reported_and_the_old_set_stays(image: Path) -> None:
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    machine.flash.wear(0x08000000 + SLOTS + 2048 + 77, 0x10, 0)
    with pytest.raises(LinkError, match="its flash does not take it"):
        save(machine, 4000)
    assert found(machine) == (table(3000), "saved in flash, number 1")
    assert machine.warnings == []


def test_pages_that_were_protected_can_be_saved_to_again(image: Path) -> None:
    """What the controller refused stands in its flags until it is cleared; and it is locked between saves."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    machine.flash.protected = set(range(60, 64))
    with pytest.raises(LinkError, match="its flash does not take it"):
        save(machine, 4000)
    machine.flash.protected = set()
    save(machine, 4000)
    assert machine.flash.cr == LOCK and machine.warnings == []
    assert found(machine) == (table(4000), "saved in flash, number 2")


def test_a_brown_out_while_it_saves(image: Path) -> None:
    """The supply dips and comes back: memory is half garbage, and the board starts as if from nothing."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    machine.timeline.at("dip", machine.now + 60_000 * 40320, lambda _time: machine.brown_out())
    with pytest.raises(LinkError):
        save(machine, 4000)
    machine.advance_us(BOOT_US)
    assert found(machine) == (table(3000), "saved in flash, number 1")
