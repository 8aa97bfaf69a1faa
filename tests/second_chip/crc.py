"""CRC calculation unit (RM0008 4): 0x04C11DB7, words, highest bit first, no reflection, no final inversion."""

from __future__ import annotations

from typing import ClassVar

from second_chip.block import Block, Layout

POLYNOMIAL = 0x04C11DB7


def _divided(word: int) -> int:
    for _ in range(32):
        word = (word << 1 ^ (POLYNOMIAL if word >> 31 else 0)) & 0xFFFFFFFF
    return word


_TOP, _HIGH, _LOW, _BOTTOM = ([_divided(byte << shift) for byte in range(256)] for shift in (24, 16, 8, 0))
"""What each byte of a word leaves; the sum, modulo 2, is what the word leaves."""


class CrcUnit(Block):
    LAYOUT: ClassVar[Layout] = {0x00: ("DR", 0xFFFFFFFF, 0), 0x04: ("IDR", 0, 0xFF), 0x08: ("CR", 0, 0)}
    CLOCK = ("AHBENR", 6)

    def write_DR(self, value: int) -> None:
        word = self.value["DR"] ^ value
        self.value["DR"] = _TOP[word >> 24] ^ _HIGH[word >> 16 & 255] ^ _LOW[word >> 8 & 255] ^ _BOTTOM[word & 255]

    def write_CR(self, value: int) -> None:
        if value & 1:
            self.value["DR"] = 0xFFFFFFFF
