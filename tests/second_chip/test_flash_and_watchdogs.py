"""Saved parameters, both watchdogs and the CRC unit on the second chip model: with the flash image where it uses them,
else register by register."""

from __future__ import annotations

import struct

import pytest

from plumb.errors import LinkError
from plumb.link.identity import NackError
from plumb.spec import parameters
from second_chip import Chip
from second_chip.clocks import IWDG_RESET, PIN_RESET, SOFTWARE_RESET, WWDG_RESET

from .conftest import START_S, Connect

CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
SLOT_0, SLOT_1 = 0xF000, 0xF800
"""Offsets in flash; two pages of 1 KiB each."""
IMAGE_FAULT, WATCHDOG_FAULT = 0x0008, 0x0400
RCC_APB1ENR, RCC_AHBENR = 0x4002101C, 0x40021014
WWDG_CR, WWDG_CFR = 0x40002C00, 0x40002C04
IWDG_KR, IWDG_PR, IWDG_RLR, IWDG_SR = 0x40003000, 0x40003004, 0x40003008, 0x4000300C
CRC_DR, CRC_CR = 0x40023000, 0x40023008
FLASH_KEYR, FLASH_SR, FLASH_CR, FLASH_AR = 0x40022004, 0x4002200C, 0x40022010, 0x40022014
WWDG_STEP_S = 4096 / 8e6
"""At the 8 MHz after reset."""


@pytest.fixture
def idle() -> Chip:
    """A chip whose program does nothing: b ."""
    return Chip(struct.pack("<2I", 0x20001000, 0x08000009) + b"\xfe\xe7")


def restarted(chip: Chip) -> Chip:
    """The same flash, switched off and on again."""
    again = Chip(bytes(chip.flash), memory_seed=2)
    again.run(START_S)
    return again


def test_saved_parameters_come_back_after_reset_and_after_power_off(chip: Chip, connect: Connect) -> None:
    session = connect(chip)
    for period_us in (3000, 4000, 5000):
        session.upload(CONTROL, period_us=period_us)
        session.execute("SAVE")
    assert chip.flash_controller.erased[-2:] == [SLOT_0, SLOT_0 + 1024], "the third save takes the older slot"
    session.upload(CONTROL, period_us=6000)

    chip.ask_reset()
    chip.run(START_S)
    assert chip.resets == 1
    for board in (connect(chip), connect(restarted(chip))):
        identity = board.connect()
        assert identity.parameter_source == "saved in flash, number 3"
        assert board.read_parameters() == parameters.whole_table(CONTROL, period_us=5000)
        assert identity["FAULTS"] == 0


def test_a_worn_cell_refuses_its_half_word_and_the_save_before_it_stays(chip: Chip, connect_uart: Connect) -> None:
    session = connect_uart(chip)
    session.upload(CONTROL, period_us=3000)
    session.execute("SAVE")
    chip.flash_controller.worn = {SLOT_1 + 32: 0x7FFF}
    chip.flash[SLOT_1 + 32 : SLOT_1 + 34] = [0xFF, 0x7F]
    session.upload(CONTROL, period_us=4000)
    with pytest.raises(NackError) as refused:
        session.execute("SAVE")
    assert refused.value.reason == "FLASH"
    assert chip.flash_controller.refused == [SLOT_1 + 32]
    assert connect_uart(restarted(chip)).read_parameters() == parameters.whole_table(CONTROL, period_us=3000)


def test_only_an_erased_half_word_takes_a_value_and_any_takes_0(idle: Chip) -> None:
    for key in (0x45670123, 0xCDEF89AB):
        idle.store(FLASH_KEYR, 4, key)
    idle.store(FLASH_CR, 4, 1)
    controller = idle.flash_controller
    results = []
    for value in (0x1234, 0x1200, 0x0000, 0x0001):
        controller.store(0x8000, 2, value)
        controller.settle()
        results.append((struct.unpack_from("<H", idle.flash, 0x8000)[0], idle.load(FLASH_SR, 4)))
        idle.store(FLASH_SR, 4, 0x34)
    eop, pgerr = 1 << 5, 1 << 2
    assert results == [(0x1234, eop), (0x1234, pgerr), (0, eop), (0, pgerr)]
    idle.store(FLASH_CR, 4, 1 << 7)
    idle.store(FLASH_CR, 4, 1)
    assert idle.load(FLASH_CR, 4) == 1 << 7, "locked"
    idle.store(FLASH_KEYR, 4, 0x12345678)
    for key in (0x45670123, 0xCDEF89AB):
        idle.store(FLASH_KEYR, 4, key)
    assert idle.load(FLASH_CR, 4) == 1 << 7, "a wrong key locks until the next reset"


def test_an_erase_that_takes_too_long_is_the_window_watchdog_s(chip: Chip, connect_uart: Connect) -> None:
    """40 ms for a page, the data sheet's limit, is what all other tests here take."""
    session = connect_uart(chip)
    session.upload(CONTROL, period_us=3000)
    chip.flash_controller.erase_us = 70_000.0
    with pytest.raises(LinkError):
        session.execute("SAVE")
    assert chip.resets >= 1
    identity = connect_uart(chip).identity
    assert identity is not None
    assert identity["RESET_CAUSE"] << 24 == WWDG_RESET | PIN_RESET
    assert identity["FAULTS"] & WATCHDOG_FAULT


@pytest.mark.parametrize(("refresh_after_steps", "resets"), [(0.5, 1), (10.5, 0), (20.5, 1)])
def test_the_window_watchdog_takes_a_refresh_inside_its_window_alone(
    idle: Chip, refresh_after_steps: float, resets: int
) -> None:
    """From 0x53 down to 0x3F, 20 steps; refreshed at 0x4A or below."""
    idle.store(RCC_APB1ENR, 4, 1 << 11)
    idle.store(WWDG_CFR, 4, 0x4A)
    idle.store(WWDG_CR, 4, 0x80 | 0x53)
    idle.run(refresh_after_steps * WWDG_STEP_S)
    if idle.resets == 0:
        idle.store(WWDG_CR, 4, 0x80 | 0x53)
    idle.run(WWDG_STEP_S)
    assert idle.resets == resets
    assert bool(idle.rcc.value["CSR"] & WWDG_RESET) == bool(resets)
    idle.run(30 * WWDG_STEP_S)
    assert idle.resets == 1, "nobody refreshes it any more; after the reset it is off"


def test_iwdg_resets_after_its_lsi_counts(idle: Chip) -> None:
    idle.store(IWDG_KR, 4, 0xCCCC)
    idle.store(IWDG_PR, 4, 2)
    assert idle.load(IWDG_SR, 4) == 0, "locked"
    idle.store(IWDG_KR, 4, 0x5555)
    idle.store(IWDG_PR, 4, 2)
    idle.store(IWDG_RLR, 4, 625)
    assert idle.load(IWDG_SR, 4) == 3
    idle.run(0.001)
    assert idle.load(IWDG_SR, 4) == 0
    length_s = 626 * 16 / 40e3
    for _ in range(3):
        idle.store(IWDG_KR, 4, 0xAAAA)
        idle.run(0.9 * length_s)
    assert idle.resets == 0
    idle.run(0.1 * length_s + 0.001)
    assert idle.resets == 1
    assert idle.rcc.value["CSR"] & (IWDG_RESET | WWDG_RESET | SOFTWARE_RESET) == IWDG_RESET


def test_the_crc_unit_gives_what_the_image_was_sealed_with(image: bytes, idle: Chip, connect_uart: Connect) -> None:
    idle.store(RCC_AHBENR, 4, 1 << 6)
    idle.store(CRC_DR, 4, 0x12345678)
    assert idle.load(CRC_DR, 4) == 0xDF8A8A2B
    idle.store(CRC_CR, 4, 1)
    assert idle.load(CRC_DR, 4) == 0xFFFFFFFF

    damaged = bytearray(image)
    damaged[0x13C] ^= 1  # in the header, which nothing else reads
    board = Chip(bytes(damaged))
    board.run(START_S)
    identity = connect_uart(board).identity
    assert identity is not None and identity["FAULTS"] & IMAGE_FAULT
