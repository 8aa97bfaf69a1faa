"""The loop that feeds memory to the CRC unit, many turns at once.

Firmware may check hundreds of words between two steps, and every store to the unit is a call from Unicorn into Python.
This loop is recognised by its machine code (Armv7-M A7.7), in which every instruction has 16 bits:

    1: str a, [Rm]; ldmia Rn!, {c, d}; str b, [Rm]; str c, [Rm]; ldmia Rn!, {a, b}; str d, [Rm]
       the same once more, with cmp Rn, Rend before str c; bne 1b

At the last store of a turn, the model takes the words of the coming turns from memory, and advances Rn, the loaded
registers and the count of instructions by as many turns, up to the end of the slice. Registers, flags and time are then
the same as if every turn had been executed. The last turn is always executed, because its comparison sets other flags.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple

INSTRUCTIONS = 14
"""Instructions in a turn."""
TURN_BYTES = 32
"""Bytes of memory that a turn feeds to the unit."""
AHEAD_BYTES = 8
"""Bytes of memory that the next turn feeds and that are already loaded at the last store of a turn."""
CODE_BYTES = 2 * INSTRUCTIONS
BEFORE = CODE_BYTES - 4
"""Bytes of a turn in front of its last store."""


class CrcLoop(NamedTuple):
    """Numbers of the registers, all below 8. loaded: the registers a, b, c, d, which hold the words of a turn."""

    source: int
    end: int
    loaded: tuple[int, int, int, int]


def _store(register: int, target: int) -> int:
    """`str register, [target]`, encoding T1 without an offset."""
    return 0x6000 | target << 3 | register


def _load(source: int, first: int, second: int) -> int:
    """`ldmia source!, {first, second}`, encoding T1."""
    return 0xC800 | source << 8 | 1 << first | 1 << second


@lru_cache(maxsize=64)
def crc_loop(code: bytes) -> CrcLoop | None:
    """The loop whose last store is BEFORE bytes into these CODE_BYTES bytes of a program; None: no such loop."""
    halves = struct.unpack(f"<{INSTRUCTIONS}H", code)
    (a, b, c, d), target = (halves[at] & 7 for at in (0, 2, 3, 5)), halves[0] >> 3 & 7
    source, end = halves[1] >> 8 & 7, halves[9] >> 3 & 7
    half = (
        _store(a, target), _load(source, c, d), _store(b, target),
        _store(c, target), _load(source, a, b), _store(d, target),
    )  # fmt: skip
    compare, branch = 0x4280 | end << 3 | source, 0xD100 | -(INSTRUCTIONS + 1) & 0xFF
    turn = (*half, *half[:3], compare, *half[3:], branch)
    in_order = a < b and c < d and len({a, b, c, d, source, end, target}) == 7
    return CrcLoop(source, end, (a, b, c, d)) if in_order and halves == turn else None
