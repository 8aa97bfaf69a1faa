"""Flash program and erase controller (PM0075 2.3, RM0008 3.3.3). The processor stands still while it works."""

from __future__ import annotations

from typing import ClassVar

from second_chip.block import Block, Layout

KEYS = (0x45670123, 0xCDEF89AB)
PROGRAM_US, ERASE_US = 52.5, 40000.0
"""Typical, and the datasheet's worst case."""
PG, PER, STRT, LOCK = 1, 2, 1 << 6, 1 << 7
PGERR, EOP = 1 << 2, 1 << 5


class FlashController(Block):
    """worn: half-words that keep a value whatever erases their page, by offset. erase_us: how long a page takes.
    erased, refused: offsets of pages, and of half-words that were not erased, in order."""

    LAYOUT: ClassVar[Layout] = {
        0x00: ("ACR", 0x30, 0x1F),
        0x04: ("KEYR", 0, 0),
        0x0C: ("SR", 0, 0),
        0x10: ("CR", LOCK, 0x16F7),
        0x14: ("AR", 0, 0xFFFFFFFF),
        0x1C: ("OBR", 0x03FFFFFC, 0),
        0x20: ("WRPR", 0xFFFFFFFF, 0),
    }

    def reset(self) -> None:
        if not self.value:
            self.worn: dict[int, int] = {}
            self.erase_us = ERASE_US
            self.erased: list[int] = []
            self.refused: list[int] = []
        super().reset()
        self.keys_given = 0
        self.locked_for_good = False
        self._owed: tuple[int, bytes] | None = None

    def write_KEYR(self, value: int) -> None:
        if not self.value["CR"] & LOCK or self.locked_for_good:
            return
        if value != KEYS[self.keys_given]:
            self.locked_for_good = True  # until the next reset
        elif self.keys_given == 1:
            self.keys_given = 0
            self.value["CR"] &= ~LOCK
        else:
            self.keys_given = 1

    def write_SR(self, value: int) -> None:
        self.value["SR"] &= ~(value & 0x34)

    def read_AR(self) -> int:
        return 0

    def read_KEYR(self) -> int:
        return 0

    def write_CR(self, value: int) -> None:
        if self.value["CR"] & LOCK:
            return
        self.value["CR"] = value & 0x16F7 & ~STRT
        if value & STRT and value & PER:
            page = 1024 if len(self.chip.flash) <= 128 * 1024 else 2048
            first = (self.value["AR"] & 0xFFFFFF) // page * page
            self.chip.stall_us(self.erase_us)
            self.chip.flash[first : first + page] = [0xFF] * page
            for at, value in self.worn.items():
                if first <= at < first + page:
                    self.chip.flash[at : at + 2] = [value & 0xFF, value >> 8]
            self.erased.append(first)
            self.value["SR"] |= EOP

    def store(self, at: int, size: int, value: int) -> None:
        """A store to flash. Programs one erased half-word; 0 may go over anything (PM0075 2.3.2)."""
        before = bytes(self.chip.flash[at : at + size])
        self._owed = (at, before)
        if size != 2 or at % 2 or self.value["CR"] & (LOCK | PG) != PG:
            raise ValueError("only an unlocked controller in programming mode takes a store, of a half-word")
        if before != b"\xff\xff" and value & 0xFFFF != 0:
            self.value["SR"] |= PGERR
            self.refused.append(at)
            return
        self._owed = (at, (value & 0xFFFF).to_bytes(2, "little"))
        self.chip.stall_us(PROGRAM_US)
        self.value["SR"] |= EOP

    def settle(self) -> None:
        """The emulated store writes its value behind the back of this controller: what really happened is put there
        before anybody looks."""
        if self._owed is not None:
            at, content = self._owed
            self._owed = None
            self.chip.flash[at : at + len(content)] = list(content)
