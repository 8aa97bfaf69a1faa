"""Faults that only some chips or boards show: each is an option of the virtual chip."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from plumb.f103.machine import Machine
from plumb.link.session import Session
from plumb.spec import parameters

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.bin"
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 60_000
SLOTS, SLOT_BYTES = 0xF000, 0x800


@pytest.mark.parametrize("part", ["stm32f103c8", "stm32f103zet6"])
def test_a_chip_without_a_flash_size_saves_all_the_same(part: str) -> None:
    """Every page of the slot is erased, whichever size the pages have."""
    machine = Machine(IMAGE, part, flash_size=0xFFFF)
    machine.advance_us(BOOT_US)
    with Session.open(machine.uart) as session:
        assert session.connect()["FLASH_KIB"] == 0
        for number, period_us in enumerate((3000, 4000, 5000)):
            machine.flash.journal = []
            session.upload(CONTROL, period_us=period_us)
            session.execute("SAVE")
            erased = {operation.offset for operation in machine.flash.journal if len(operation.after) > 2}
            slot = SLOTS + number % 2 * SLOT_BYTES
            assert erased == set(range(slot, slot + SLOT_BYTES, machine.flash.page_bytes))
    machine.reset()
    machine.advance_us(BOOT_US)
    with Session.open(machine.uart) as session:
        assert session.connect().parameter_source == "saved in flash, number 3"
    assert machine.warnings == []


def test_the_arm_switch_works_with_the_lse_left_on() -> None:
    machine = Machine(IMAGE, lse_left_on=True)
    assert machine.pin("PC14") is None
    machine.advance_us(BOOT_US)
    assert machine.pin("PC14") is True
    machine.drive("PC14", False)
    assert machine.pin("PC14") is False
    assert machine.warnings == []
