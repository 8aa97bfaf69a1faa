"""The flash controller as PM0075 has it, its wear and its power cuts. The image under them: test_f103_store.py."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from plumb.f103 import Machine
from support.f103_program import NewBoard, RunningProgram

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
SLOTS = 0xF000
KEYR, SR, CR, AR = 0x04, 0x0C, 0x10, 0x14
HALF_WORD, WORD = 0x200, 0x300
UNLOCK = [(KEYR, 0x45670123), (KEYR, 0xCDEF89AB)]
PG, PER, STRT, LOCK = 1, 2, 64, 128
PGERR, WRPRTERR, EOP = 4, 16, 32
CYCLES_PER_US = 8


def carried_out(
    board: NewBoard,
    *steps: tuple[int, int],
    part: str = "stm32f103c8",
    before: Callable[[Machine], None] | None = None,
) -> RunningProgram:
    """The small program, which handles its faults, after these steps. before(machine): what to do to it first."""
    b = board("flash", part=part, faults="run")
    b.machine.cpu.flash[SLOTS : SLOTS + 0x1000] = b"\xff" * 0x1000
    if before:
        before(b.machine)
    b.ask(0, len(steps))
    for i, (what, value) in enumerate(steps):
        b.ask(8 + 2 * i, what)
        b.ask(9 + 2 * i, value)
    b.machine.advance_us(200_000)
    return b


def half_word(machine: Machine, at: int = 0) -> int:
    return int(struct.unpack_from("<H", machine.cpu.flash, SLOTS + at)[0])


def test_a_half_word_is_programmed_once_and_takes_its_time(board: NewBoard) -> None:
    b = carried_out(
        board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00041234), (HALF_WORD, 0x00045678), (SR, 0xFF), (HALF_WORD, 0x00040000)
    )
    assert b.result(1) == 7
    # The cycles of the loop that waits.
    assert b.result(48 + 3) == pytest.approx(70 * CYCLES_PER_US, abs=20)
    assert b.result(32 + 3) == EOP
    assert b.result(32 + 4) == EOP | PGERR and b.result(48 + 4) < 20, "refused at once"
    assert b.result(32 + 5) == 0
    assert b.result(32 + 6) == EOP and half_word(b.machine, 4) == 0, "zero goes over anything"
    assert b.machine.warnings == [] and half_word(b.machine) == 0xFFFF


def test_refused_it_stays_as_it_is(board: NewBoard) -> None:
    b = carried_out(board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00041234), (HALF_WORD, 0x00040204))
    assert half_word(b.machine, 4) == 0x1234 and b.machine.flash.operations == 1


@pytest.mark.parametrize(("part", "page"), [("stm32f103c8", 1024), ("stm32f103ret6", 2048)])
def test_a_page_is_erased_while_the_core_stands_still(board: NewBoard, part: str, page: int) -> None:
    def fill(machine: Machine) -> None:
        machine.cpu.flash[SLOTS : SLOTS + 4096] = bytes(4096)

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS + 10), (CR, PER | STRT), part=part, before=fill)
    # The cycles of the loop that waits.
    assert b.result(48 + 4) == pytest.approx(40_000 * CYCLES_PER_US, abs=20)
    after = bytes(b.machine.cpu.flash[SLOTS : SLOTS + 4096])
    assert after == b"\xff" * page + bytes(4096 - page)


@pytest.mark.parametrize(
    ("steps", "faulting"),
    [
        ([(CR, PG), (HALF_WORD, 0x1234)], 2),  # locked
        ([*UNLOCK, (HALF_WORD, 0x1234)], 3),  # not asked to program
        ([*UNLOCK, (CR, PG), (WORD, 0x1234)], 4),  # half-words only
        ([(KEYR, 1), *UNLOCK, (CR, PG), (HALF_WORD, 0x1234)], 5),  # a wrong key locks until the reset
        ([UNLOCK[0], UNLOCK[0], UNLOCK[1], (CR, PG), (HALF_WORD, 0x1234)], 5),
        ([*UNLOCK, (CR, LOCK), (CR, PG), (HALF_WORD, 0x1234)], 5),
    ],
)
def test_what_the_controller_does_not_take_is_a_bus_error(
    board: NewBoard, steps: tuple[tuple[int, int], ...], faulting: bool
) -> None:
    b = carried_out(board, *steps)
    assert b.result(2) == faulting
    assert half_word(b.machine) == 0xFFFF and b.machine.flash.operations == 0


def test_locked_and_unlocked_again(board: NewBoard) -> None:
    b = carried_out(board, *UNLOCK, (CR, LOCK), *UNLOCK, (CR, PG), (HALF_WORD, 0x1234))
    assert half_word(b.machine) == 0x1234


def test_protected_pages_say_so(board: NewBoard) -> None:
    def protect(machine: Machine) -> None:
        machine.flash.protected = {SLOTS // 1024}

    steps = [*UNLOCK, (CR, PG), (HALF_WORD, 0x1234), (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT)]
    b = carried_out(board, *steps, before=protect)
    assert b.result(32 + 3) == WRPRTERR and b.result(32 + 6) == WRPRTERR and b.machine.flash.operations == 0


def test_worn_bits_keep_their_level(board: NewBoard) -> None:
    def wear(machine: Machine) -> None:
        machine.flash.wear(0x08000000 + SLOTS, 0x0F, 0)
        machine.flash.wear(0x08000000 + SLOTS + 1, 0xF0, 1)

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT), before=wear)
    assert half_word(b.machine) == 0xFFF0
    b = carried_out(board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00020000), before=lambda m: m.flash.wear(0x0800F002, 1, 1))
    assert half_word(b.machine, 2) == 1


def test_a_cut_leaves_some_bits_old_and_some_new(board: NewBoard) -> None:
    def old(machine: Machine) -> None:
        machine.cpu.flash[SLOTS : SLOTS + 1024] = bytes(1024)
        machine.flash.cut_power_in = 0

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT), before=old)
    bits = sum(byte.bit_count() for byte in b.machine.cpu.flash[SLOTS : SLOTS + 1024])
    assert not b.machine.powered and 3826 < bits < 4366  # half of 8192, 6 sigma of 45
    assert set(b.machine.cpu.flash[SLOTS + 1024 : SLOTS + 2048]) == {0xFF}
