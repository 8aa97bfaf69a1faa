"""The flash controller as PM0075 has it, its wear and its power cuts, and the flash image saving under all of them."""

from __future__ import annotations

import struct

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (plumb[virtual])")
from plumb import parameters
from plumb.errors import LinkError, UsageError
from plumb.f103 import Machine, find_image
from plumb.session import Session

SLOTS = 0xF000
KEYR, SR, CR, AR = 0x04, 0x0C, 0x10, 0x14
HALF_WORD, WORD = 0x200, 0x300
UNLOCK = [(KEYR, 0x45670123), (KEYR, 0xCDEF89AB)]
PG, PER, STRT, LOCK = 1, 2, 64, 128
PGERR, WRPRTERR, EOP = 4, 16, 32
CYCLES_PER_US = 8


def carried_out(board, *steps, part="stm32f103c8", before=None):
    """The small program after these steps. before(machine): what to do to it first."""
    b = board("flash", part=part)
    b.machine.cpu.flash[SLOTS : SLOTS + 0x1000] = b"\xff" * 0x1000
    if before:
        before(b.machine)
    b.ask(0, len(steps))
    for i, (what, value) in enumerate(steps):
        b.ask(8 + 2 * i, what)
        b.ask(9 + 2 * i, value)
    b.machine.advance_us(200_000)
    return b


def half_word(machine, at=0):
    return struct.unpack_from("<H", machine.cpu.flash, SLOTS + at)[0]


def test_a_half_word_is_programmed_once_and_takes_its_time(board):
    b = carried_out(
        board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00041234), (HALF_WORD, 0x00045678), (SR, 0xFF), (HALF_WORD, 0x00040000)
    )
    assert b.result(1) == 7
    assert b.result(48 + 3) == pytest.approx(70 * CYCLES_PER_US, abs=20)
    assert b.result(32 + 3) == EOP
    assert b.result(32 + 4) == EOP | PGERR and b.result(48 + 4) < 20, "refused at once"
    assert b.result(32 + 5) == 0
    assert b.result(32 + 6) == EOP and half_word(b.machine, 4) == 0, "zero goes over anything"
    assert b.machine.warnings == [] and half_word(b.machine) == 0xFFFF


def test_refused_it_stays_as_it_is(board):
    b = carried_out(board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00041234), (HALF_WORD, 0x00040204))
    assert half_word(b.machine, 4) == 0x1234 and b.machine.flash.operations == 1


@pytest.mark.parametrize(("part", "page"), [("stm32f103c8", 1024), ("stm32f103ret6", 2048)])
def test_a_page_is_erased_while_the_core_stands_still(board, part, page):
    def fill(machine):
        machine.cpu.flash[SLOTS : SLOTS + 4096] = bytes(4096)

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS + 10), (CR, PER | STRT), part=part, before=fill)
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
def test_what_the_controller_does_not_take_is_a_bus_error(board, steps, faulting):
    b = carried_out(board, *steps)
    assert b.result(2) == faulting
    assert half_word(b.machine) == 0xFFFF and b.machine.flash.operations == 0


def test_locked_and_unlocked_again(board):
    b = carried_out(board, *UNLOCK, (CR, LOCK), *UNLOCK, (CR, PG), (HALF_WORD, 0x1234))
    assert half_word(b.machine) == 0x1234


def test_protected_pages_say_so(board):
    def protect(machine):
        machine.flash.protected = {SLOTS // 1024}

    steps = [*UNLOCK, (CR, PG), (HALF_WORD, 0x1234), (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT)]
    b = carried_out(board, *steps, before=protect)
    assert b.result(32 + 3) == WRPRTERR and b.result(32 + 6) == WRPRTERR and b.machine.flash.operations == 0


def test_worn_bits_keep_their_level(board):
    def wear(machine):
        machine.flash.wear(0x08000000 + SLOTS, 0x0F, 0)
        machine.flash.wear(0x08000000 + SLOTS + 1, 0xF0, 1)

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT), before=wear)
    assert half_word(b.machine) == 0xFFF0
    b = carried_out(board, *UNLOCK, (CR, PG), (HALF_WORD, 0x00020000), before=lambda m: m.flash.wear(0x0800F002, 1, 1))
    assert half_word(b.machine, 2) == 1


def test_a_cut_leaves_some_bits_old_and_some_new(board):
    def old(machine):
        machine.cpu.flash[SLOTS : SLOTS + 1024] = bytes(1024)
        machine.flash.cut_power_in = 0

    b = carried_out(board, *UNLOCK, (CR, PER), (AR, 0x08000000 + SLOTS), (CR, PER | STRT), before=old)
    bits = sum(byte.bit_count() for byte in b.machine.cpu.flash[SLOTS : SLOTS + 1024])
    assert not b.machine.powered and 3000 < bits < 5200
    assert set(b.machine.cpu.flash[SLOTS + 1024 : SLOTS + 2048]) == {0xFF}


# The flash image


@pytest.fixture(scope="module")
def image():
    try:
        return find_image()
    except UsageError as error:
        pytest.skip(str(error))


CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 30_000


def table(period_us):
    return parameters.whole_table(CONTROL, period_us=period_us)


def save(machine, period_us):
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, period_us=period_us)
        session.execute("SAVE")


def found(machine):
    """Values in use after a reset, and where they come from."""
    machine.reset()
    machine.advance_us(BOOT_US)
    machine.uart.reset_input_buffer()
    with Session.open(machine.uart) as session:
        assert session.identity is not None
        return session.read_parameters(), session.identity.parameter_source


@pytest.mark.parametrize("part", ["stm32f103c8", "stm32f103rct6", "stm32f103zet6"])
def test_the_image_saves_on_every_part(image, part):
    machine = Machine(image, part)
    machine.advance_us(BOOT_US)
    code = bytes(machine.cpu.flash[:SLOTS])
    for number, period_us in enumerate((3000, 4000, 5000), 1):
        begun = machine.now_us
        save(machine, period_us)
        assert machine.now_us - begun < 250_000
        assert found(machine) == (table(period_us), f"saved in flash, number {number}")
    assert bytes(machine.cpu.flash[:SLOTS]) == code
    assert set(machine.cpu.flash[SLOTS + 4096 :]) <= {0xFF}
    assert machine.warnings == [] and machine.reset_count == 4


@pytest.mark.parametrize("lsi_hz", [30_000, 60_000])
def test_no_watchdog_bites_while_it_saves(image, lsi_hz):
    machine = Machine(image)
    machine.iwdg.lsi_hz = lsi_hz
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    save(machine, 4000)
    assert machine.reset_count == 1


def cuts(operations):
    """Every page erase, the half-words about both ends, and every 29th between them: all of them are cut natively."""
    return sorted({*range(12), *range(12, operations, 29), *range(operations - 5, operations)})


def test_a_cut_at_any_operation_leaves_the_old_set_or_the_new(image):
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    before = machine.flash.operations
    save(machine, 4000)
    operations = machine.flash.operations - before
    assert operations == 1 + 2 + 5 + 3 * len(parameters.table()) + 2 + 1
    period_us, seen = 4000, set()
    for cut in cuts(operations):
        machine.flash.cut_power_in = cut
        with pytest.raises(LinkError):
            save(machine, period_us + 1)
        assert not machine.powered
        machine.power_on()
        machine.advance_us(BOOT_US)
        values, source = found(machine)
        assert values in (table(period_us), table(period_us + 1)) and source.startswith("saved in flash")
        seen.add(values == table(period_us + 1))
        period_us += values == table(period_us + 1)
        # And the next one that is not cut succeeds.
        save(machine, period_us := period_us + 1)
        assert found(machine)[0] == table(period_us)
    assert False in seen and machine.warnings == []


def test_a_worn_half_word_is_reported_and_the_old_set_stays(image):
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    machine.flash.wear(0x08000000 + SLOTS + 2048 + 77, 0x10, 0)
    with pytest.raises(LinkError, match="its flash does not take it"):
        save(machine, 4000)
    assert found(machine) == (table(3000), "saved in flash, number 1")
    assert machine.warnings == []


def test_a_brown_out_while_it_saves(image):
    """The supply dips and comes back: memory is half garbage, and the board starts as if from nothing."""
    machine = Machine(image)
    machine.advance_us(BOOT_US)
    save(machine, 3000)
    machine.timeline.at("dip", machine.now + 60_000 * 40320, lambda _time: machine.brown_out())
    with pytest.raises(LinkError):
        save(machine, 4000)
    machine.advance_us(BOOT_US)
    assert found(machine) == (table(3000), "saved in flash, number 1")
