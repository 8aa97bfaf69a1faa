"""CRC calculation unit (RM0008 4): 0x04C11DB7, words, highest bit first, no reflection, no final inversion."""

from __future__ import annotations

from typing import ClassVar

from second_chip.block import Block, Layout

POLYNOMIAL = 0x04C11DB7


def _byte(value: int) -> int:
    value <<= 24
    for _ in range(8):
        value = value << 1 ^ (POLYNOMIAL if value >> 31 & 1 else 0)
    return value & 0xFFFFFFFF


TABLE = [_byte(value) for value in range(256)]


class CrcUnit(Block):
    LAYOUT: ClassVar[Layout] = {0x00: ("DR", 0xFFFFFFFF, 0), 0x04: ("IDR", 0, 0xFF), 0x08: ("CR", 0, 0)}
    CLOCK = ("AHBENR", 6)

    def write_DR(self, value: int) -> None:
        crc = self.value["DR"] ^ value
        for _ in range(4):
            crc = crc << 8 & 0xFFFFFFFF ^ TABLE[crc >> 24]
        self.value["DR"] = crc

    def write_CR(self, value: int) -> None:
        if value & 1:
            self.value["DR"] = 0xFFFFFFFF
