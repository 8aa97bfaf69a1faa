"""The bit-band aliases (Armv7-M B3.1, RM0008 3.3.3): a word for each bit of the first MiB of RAM and of peripherals.

A store to the word is a read and a write of what holds the bit, in one instruction; so flags that a read or a write of
ones clears behave as they do on silicon. The access to the register has the width of the access to the alias.
"""

from __future__ import annotations

from collections.abc import Callable

Read = Callable[[int, int], int]
Write = Callable[[int, int, int], None]
RAM_ALIAS, PERIPHERAL_ALIAS, PERIPHERALS = 0x22000000, 0x42000000, 0x40000000
PERIPHERAL_BYTES = 1 << 20
WORDS_PER_BYTE_BYTES = 32
"""Bytes of the alias for each byte of memory."""


def place(offset: int, width: int) -> tuple[int, int]:
    """Byte offset in the region, aligned to the width, and the bit in it, for an offset in the alias."""
    bit = offset >> 2
    byte = bit >> 3 & ~(width - 1)
    return byte, bit - 8 * byte


def reader(base: int, read: Read) -> Read:
    """read(address, width) of the region from `base` on -> the same for offsets in its alias: 0 or 1."""

    def read_bit(offset: int, width: int) -> int:
        byte, bit = place(offset, width)
        return read(base + byte, width) >> bit & 1

    return read_bit


def writer(base: int, read: Read, write: Write) -> Write:
    """write(address, width, value) of the region -> the same for its alias: bit 0 of the value goes to the bit."""

    def write_bit(offset: int, width: int, value: int) -> None:
        byte, bit = place(offset, width)
        old = read(base + byte, width)
        write(base + byte, width, old & ~(1 << bit) | (value & 1) << bit)

    return write_bit
