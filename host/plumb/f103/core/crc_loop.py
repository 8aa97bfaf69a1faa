"""The loop that feeds memory to the CRC unit, many turns at once.

Firmware may check hundreds of words between two steps, and every store to the unit is a call from Unicorn into Python.
This loop is recognised by its machine code (Armv7-M A7.7):

    1: ldmia Rn!, {a, b, c, d}; str a, [Rm]; str b, [Rm]; str c, [Rm]; str d, [Rm]
       the same once more; cmp Rn, Rend; bne 1b

At its last store the words of the turns to come are taken from memory, and Rn, the loaded registers and the count of
instructions go on by as much, no further than the slice reaches: registers, flags and time are then what every turn on
its own leaves.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple

GROUP, GROUPS = 4, 2
"""Words of a group, and groups of a turn."""
WORDS, INSTRUCTIONS = GROUP * GROUPS, (1 + GROUP) * GROUPS + 2
"""Of a turn."""
TURN_BYTES = 4 * WORDS
BEFORE = 24
"""Most bytes of a turn in front of its last store."""
CODE_BYTES = BEFORE + 8
_LOW = range(8)


class CrcLoop(NamedTuple):
    """Numbers of the registers; the first two are below 8. loaded: those that take the words of a turn, in order."""

    source: int
    end: int
    loaded: tuple[int, ...]


def _store(halves: tuple[int, ...], at: int) -> tuple[int, int, int] | None:
    """Of `str Rt, [Rm]` at this half-word: Rt, Rm, and its length in half-words."""
    first = halves[at]
    if first & 0xFFC0 == 0x6000:  # encoding T1 without an offset
        return first & 7, first >> 3 & 7, 1
    if first & 0xFFF0 == 0xF8C0 and not halves[at + 1] & 0xFFF:  # encoding T3 without an offset
        return halves[at + 1] >> 12, first & 15, 2
    return None


def _group(halves: tuple[int, ...], begin: int) -> tuple[int, int, list[int], int, int] | None:
    """A load of GROUP words and their stores: Rn, Rm, the loaded registers, places of the last store and of what
    follows."""
    load, registers = halves[begin], halves[begin + 1]
    if load & 0xFFF0 != 0xE8B0 or registers >> 13 or registers.bit_count() != GROUP:  # neither SP, LR nor PC
        return None
    loaded = [number for number in range(13) if registers >> number & 1]
    at, begun, targets, stored = begin + 2, 0, set(), []
    for _ in range(GROUP):
        store = _store(halves, at) if at < len(halves) - 1 else None
        if store is None:
            return None
        begun, at = at, at + store[2]
        stored.append(store[0])
        targets.add(store[1])
    return (load & 15, targets.pop(), loaded, begun, at) if stored == loaded and len(targets) == 1 else None


def _loop_from(halves: tuple[int, ...], begin: int, last_store: int) -> CrcLoop | None:
    at, groups = begin, []
    for _ in range(GROUPS):
        group = _group(halves, at) if at < last_store else None
        if group is None:
            return None
        groups.append(group)
        at = group[4]
    source, target = groups[0][:2]
    if groups[-1][3] != last_store or at + 1 >= len(halves) or any(group[:2] != (source, target) for group in groups):
        return None
    compare, branch = halves[at], halves[at + 1]
    end = compare >> 3 & 7
    back = begin - (at + 1) - 2  # in half-words, from the branch's address and 4
    repeats = compare & 0xFFC0 == 0x4280 and compare & 7 == source and branch == 0xD100 | back & 0xFF
    loaded = tuple(number for group in groups for number in group[2])
    free = not {source, end, target} & {*loaded} and len({source, end, target}) == 3
    return CrcLoop(source, end, loaded) if repeats and free else None


@lru_cache(maxsize=64)
def crc_loop(code: bytes) -> CrcLoop | None:
    """The loop whose last store is BEFORE bytes into these CODE_BYTES bytes of a program; None: no such loop."""
    halves = struct.unpack(f"<{CODE_BYTES // 2}H", code)
    found = (_loop_from(halves, begin, BEFORE // 2) for begin in range(BEFORE // 2 - 1))
    return next((loop for loop in found if loop is not None), None)
