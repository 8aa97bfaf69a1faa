"""CRC calculation unit (RM0008 chapter 4): remainder of a stream of words, polynomial 0x04C11DB7, highest bit first.

Writing DR feeds one word, reading it gives the remainder so far. CR.RESET sets the remainder to all ones; IDR is a byte
of storage that RESET leaves alone. Without RCC_AHBENR.CRCEN the unit ignores writes and reads 0. It takes words only. A
word keeps the unit busy for four cycles of HCLK, during which a further write waits (4.2). The simulated time (cpu.py)
leaves these waits out; `plumb bench` counts them.
"""

from __future__ import annotations

import array
import zlib
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

BASE = 0x40023000
DR_OFFSET = 0x00
START = 0xFFFFFFFF
RESET = 1
_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


_FOUR_BYTES = next(code for code in "IL" if array.array(code).itemsize == 4)


def _mirror(word: int) -> int:
    return int.from_bytes(word.to_bytes(4, "big").translate(_MIRRORED), "little")


def remainder(start: int, words: bytes | bytearray) -> int:
    """The unit's remainder after these words, as they lie in memory; start: the remainder before them."""
    # zlib divides by the same polynomial, with every bit order reversed and the remainder complemented. The unit begins
    # with the highest byte of a word.
    highest_first = array.array(_FOUR_BYTES, words)
    highest_first.byteswap()
    mirrored = highest_first.tobytes().translate(_MIRRORED)
    return _mirror(zlib.crc32(mirrored, _mirror(start) ^ 0xFFFFFFFF) ^ 0xFFFFFFFF)


class Crc(Peripheral):
    """waiting: words written since DR was last read, as they lie in memory; the remainder is computed when DR is read.
    by_other_code: the words come from code other than the loop of crc_loop.py, so the core need not look for that loop
    again until DR is read."""

    NARROW = "refuse"
    REGISTERS = (Register("dr", DR_OFFSET, START), Register("idr", 0x04, 0, 0xFF), Register("cr", 0x08))
    dr: int

    def __init__(self, machine: Mcu) -> None:
        self.waiting = bytearray()
        self.by_other_code = False
        super().__init__(machine, "CRC", BASE)

    def reset(self) -> None:
        super().reset()
        self._begin()

    def _begin(self) -> None:
        self.waiting.clear()
        self.by_other_code = False

    def write_dr(self, value: int) -> None:
        self.waiting += value.to_bytes(4, "little")

    def read_dr(self) -> int:
        if self.waiting:
            self.dr = remainder(self.dr, self.waiting)
            self._begin()
        return self.dr

    def read_cr(self) -> int:
        """Hardware clears RESET at once."""
        return 0

    def write_cr(self, value: int) -> None:
        if value & RESET:
            self.dr = START
            self._begin()
