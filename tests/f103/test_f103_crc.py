"""The CRC unit of the simulated part against the definition of its polynomial, bit by bit (RM0008 chapter 4)."""

from __future__ import annotations

import random
from collections.abc import Iterable

import pytest

from plumb.f103.core.bus import Bus, SimulationError
from support.f103_program import NewBoard

DR, IDR, CR, AHBENR = 0x40023000, 0x40023004, 0x40023008, 0x40021014
CRCEN = 1 << 6


def by_definition(words: Iterable[int], remainder: int = 0xFFFFFFFF) -> int:
    """Each word is added to the remainder, then divided by 0x04C11DB7 from its highest bit down."""
    for word in words:
        remainder ^= word
        for _bit in range(32):
            remainder = (remainder << 1 ^ (0x04C11DB7 if remainder >> 31 else 0)) & 0xFFFFFFFF
    return remainder


@pytest.fixture
def bus(board: NewBoard) -> Bus:
    machine = board("clock").machine
    machine.bus.write(AHBENR, 4, machine.bus.read(AHBENR, 4) | CRCEN)
    return machine.bus


def test_remainders_are_those_of_the_definition(bus: Bus) -> None:
    chance = random.Random(41)
    for count in (1, 2, 3, 40, 117):
        words = [chance.getrandbits(32) for _ in range(count)]
        bus.write(CR, 4, 1)
        for word in words:
            bus.write(DR, 4, word)
        assert bus.read(DR, 4) == by_definition(words)
        bus.write(DR, 4, 0x80000001)  # reading does not end the stream
        assert bus.read(DR, 4) == by_definition([*words, 0x80000001])


def test_published_remainder_of_one_zero_word(bus: Bus) -> None:
    assert bus.read(DR, 4) == 0xFFFFFFFF
    bus.write(DR, 4, 0)
    assert bus.read(DR, 4) == 0xC704DD7B  # CRC-32/MPEG-2 of four zero bytes


def test_reset_puts_the_remainder_to_ones_and_leaves_the_storage_byte(bus: Bus) -> None:
    bus.write(IDR, 4, 0x1A5)
    bus.write(DR, 4, 12345)
    bus.write(CR, 4, 0)
    assert bus.read(DR, 4) == by_definition([12345])
    bus.write(DR, 4, 1)
    bus.write(CR, 4, 1)
    assert (bus.read(DR, 4), bus.read(CR, 4), bus.read(IDR, 4)) == (0xFFFFFFFF, 0, 0xA5)


def test_without_its_clock_the_unit_takes_nothing_and_says_so(bus: Bus) -> None:
    bus.write(DR, 4, 7)
    bus.write(AHBENR, 4, bus.read(AHBENR, 4) & ~CRCEN)
    bus.write(DR, 4, 8)
    assert bus.read(DR, 4) == 0
    assert any("CRC is written" in text for text in bus.machine.warnings)
    bus.write(AHBENR, 4, bus.read(AHBENR, 4) | CRCEN)
    assert bus.read(DR, 4) == by_definition([7])


def test_narrow_writes_are_refused(bus: Bus) -> None:
    for width in (1, 2):
        with pytest.raises(SimulationError, match="32 bits only"):
            bus.write(DR, width, 1)
