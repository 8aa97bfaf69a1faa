"""Acceptance filters of bxCAN (RM0008 24.7.4): which of the fourteen banks accepts a frame, and for which FIFO."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.f103.attached.canwire import WireFrame

BANKS = 14
RTR, IDE = 2, 4
"""Bits of the identifier word of a mailbox: remote frame, extended identifier."""


@dataclass(frozen=True)
class Filters:
    """The filter registers. banks: both words of each bank; the others have one bit for each bank. listed: identifiers,
    not identifier and mask; wide: 32 bits; fifo: number of the FIFO; active: in use."""

    banks: Sequence[tuple[int, int]]
    listed: int
    wide: int
    fifo: int
    active: int


def identifier_word(frame: WireFrame) -> int:
    """Identifier, IDE and RTR of a frame, as the identifier word of a mailbox has them."""
    head = frame.identifier << 3 | IDE if frame.extended else frame.identifier << 21
    return head | (RTR if frame.remote else 0)


def match(filters: Filters, frame: WireFrame) -> tuple[int, int] | None:
    """(FIFO, filter match index) of the filter of highest priority that accepts the frame; None when none does."""
    head = identifier_word(frame)
    short = (head >> 21) << 5 | bool(head & RTR) << 4 | bool(head & IDE) << 3 | (head >> 18) & 7
    best: tuple[int, int, int, int] | None = None
    next_index = [0, 0]
    for bank, (low, high) in enumerate(filters.banks):
        bit = 1 << bank
        wide, listed = bool(filters.wide & bit), bool(filters.listed & bit)
        fifo = int(bool(filters.fifo & bit))
        if wide:
            wanted = [(low, 0xFFFFFFFE), (high, 0xFFFFFFFE)] if listed else [(low, high & 0xFFFFFFFE)]
        else:
            halves = [low & 0xFFFF, low >> 16, high & 0xFFFF, high >> 16]
            wanted = [(h, 0xFFFF) for h in halves] if listed else [(halves[0], halves[1]), (halves[2], halves[3])]
        for i, (identifier, mask) in enumerate(wanted):
            index = next_index[fifo] + i
            hit = filters.active & bit and not ((head if wide else short) ^ identifier) & mask
            rank = (not wide, not listed, index, fifo)
            if hit and (best is None or rank < best):
                best = rank
        next_index[fifo] += len(wanted)
    return None if best is None else (best[3], best[2])
