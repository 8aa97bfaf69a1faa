"""Flash and its controller (PM0075): wait states, keys, programming of half-words, erasing of pages, fault injection.

An operation takes the datasheet's longest time, during which the core, which runs from flash, stalls. The memory
changes at its end; after a reset or a power cut in between, some of the bits have their old and some their new value.
Worn bits keep their level. Mass erase and option bytes are not modelled: using them stops the simulation.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.flash.image import FLASH_BASE

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

KEYS = (0x45670123, 0xCDEF89AB)
BSY, PGERR, WRPRTERR, EOP = 1, 1 << 2, 1 << 4, 1 << 5
PG, PER, STRT, LOCK = 1, 1 << 1, 1 << 6, 1 << 7
NOT_MODELLED = 0x1634
"""MER, OPTPG, OPTER, OPTWRE and the interrupts."""
PROGRAM_US, ERASE_US = 70, 40_000
HSION = 1


@dataclass
class Operation:
    """An erase or programming. offset: of its first byte in flash. after: the bytes at its end."""

    offset: int
    after: bytes
    begun: int
    ends: int


def torn(before: bytes, after: bytes, odds: float, chance: Random) -> bytes:
    """Bytes after an interrupted operation: each bit that was to change has changed with probability `odds`."""
    mask = bytes(
        sum(1 << bit for bit in range(8) if chance.random() < odds) if old != new else 0
        for old, new in zip(before, after, strict=True)
    )
    return bytes(o & ~m | n & m for o, n, m in zip(before, after, mask, strict=True))


class Flash(Peripheral):
    """operations: number begun since the machine was created. cut_power_in: power fails in the middle of an operation,
    0: of the next one, 1: of the one after it; None: of none. protected: numbers of write-protected pages. journal: a
    list to which every operation is appended. hides_lock: LOCK reads 0 while the controller is locked, as some clones
    have it."""

    NARROW = "refuse"
    REGISTERS = (
        Register("acr", 0x00, 0x30),
        Register("keyr", 0x04),
        Register("optkeyr", 0x08),
        Register("sr", 0x0C),
        Register("cr", 0x10, LOCK),
        Register("ar", 0x14),
        Register("obr", 0x1C, 0x03FFFFFC, 0),
        Register("wrpr", 0x20, 0xFFFFFFFF, 0),
    )
    acr: int
    sr: int
    cr: int
    ar: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "FLASH", 0x40022000)
        self.keys_seen = 0
        self.page_bytes = 1024 if machine.part.flash_kib <= 128 else 2048
        self.operations = 0
        self.cut_power_in: int | None = None
        self.protected: set[int] = set()
        self.journal: list[Operation] | None = None
        self.hides_lock = False
        self._stuck: dict[int, tuple[int, int]] = {}
        self._operation: Operation | None = None

    def reset(self) -> None:
        super().reset()
        self.machine.cpu.set_clock(self.machine.rcc.hclk_ticks, self.acr & 7)
        self.keys_seen = 0
        if self._operation is not None:
            self._leave_half_done(self._operation)
            self._operation = None
        self.machine.timeline.cancel("flash")
        self.machine.timeline.cancel("flash power")

    # Fault injection

    def wear(self, address: int, bits: int, level: int) -> None:
        """These bits of the byte at `address` are stuck at 0 or 1 from now on."""
        zeros, ones = self._stuck.get(address - FLASH_BASE, (0, 0))
        self._stuck[address - FLASH_BASE] = (zeros | bits, ones) if not level else (zeros, ones | bits)
        self.store(address - FLASH_BASE, bytes(self.machine.cpu.flash[address - FLASH_BASE :][:1]))

    def stall(self, seconds: float) -> None:
        """Stall the core for this time, as while a page is erased; the memory does not change."""
        now = self.machine.now
        nothing = Operation(0, bytes(self.machine.cpu.flash[:2]), now, 0)
        self._begin(nothing, round(seconds * 1e6))

    # Registers

    def write_acr(self, value: int) -> None:
        if value & 7 > 2:
            raise SimulationError(f"FLASH_ACR.LATENCY = {value & 7} is reserved")
        if value & 7 != self.acr & 7:
            self.machine.cpu.set_clock(self.machine.rcc.hclk_ticks, value & 7)
        self.acr = value & 0x1F | (value & 0x10) << 1  # PRFTBS follows PRFTBE

    def read_keyr(self) -> int:
        return 0

    def write_keyr(self, value: int) -> None:
        if self.keys_seen < 2 and value == KEYS[self.keys_seen]:
            self.keys_seen += 1
            if self.keys_seen == 2:
                self.cr &= ~LOCK
        else:
            self.keys_seen = 3  # a wrong key locks until reset
            self.cr |= LOCK

    def write_sr(self, value: int) -> None:
        self.sr &= ~(value & (PGERR | WRPRTERR | EOP))

    def read_cr(self) -> int:
        return self.cr & ~LOCK if self.hides_lock else self.cr

    def write_cr(self, value: int) -> None:
        if self.cr & LOCK:
            if not self.hides_lock:  # a program cannot know
                self.machine.warn("FLASH_CR is written while locked")
            return
        if self.busy:
            self.machine.warn("FLASH_CR is written while an operation is under way")
            return
        if value & NOT_MODELLED:
            raise SimulationError(f"FLASH_CR = 0x{value:X}: mass erase, option bytes and interrupts are not modelled")
        self.cr = value & (PG | PER | LOCK)
        if value & LOCK:
            self.keys_seen = 0
        elif value & STRT and value & PER:
            self._erase()
        elif value & STRT:
            self.machine.warn("FLASH_CR.STRT is set with nothing to start")

    def write_ar(self, value: int) -> None:
        if self.busy:
            self.machine.warn("FLASH_AR is written while an operation is under way")
        else:
            self.ar = value

    # Operations

    @property
    def busy(self) -> bool:
        """An operation is under way: the core stalls."""
        return self._operation is not None

    def takes(self, size: int) -> bool:
        """True when a write of this size to the memory is a command to program; all others are bus errors."""
        return size == 2 and bool(self.cr & PG) and not self.cr & LOCK

    def program(self, address: int, value: int) -> None:
        offset = address - FLASH_BASE
        found = int.from_bytes(self.machine.cpu.flash[offset : offset + 2], "little")
        if offset // self.page_bytes in self.protected:
            self.sr |= WRPRTERR
        elif found != 0xFFFF and value != 0:
            self.sr |= PGERR
        else:
            self._begin(Operation(offset, struct.pack("<H", value), self.machine.now, 0), PROGRAM_US)

    def _erase(self) -> None:
        page, flash = (self.ar - FLASH_BASE) // self.page_bytes, self.machine.cpu.flash
        if not 0 <= page < len(flash) // self.page_bytes:
            raise SimulationError(f"FLASH_AR = 0x{self.ar:08X} lies outside the flash of {self.machine.part.name}")
        if page in self.protected:
            self.sr |= WRPRTERR
            return
        blank = b"\xff" * self.page_bytes
        self._begin(Operation(page * self.page_bytes, blank, self.machine.now, 0), ERASE_US)

    def _begin(self, operation: Operation, duration_us: int) -> None:
        if not self.machine.rcc.cr & HSION:
            self.machine.warn("flash is programmed while HSI, which drives it, is off")
        operation.ends = operation.begun + duration_us * TICKS_PER_US
        self._operation = operation
        self.operations += 1
        if self.journal is not None:
            self.journal.append(operation)
        self.sr |= BSY
        self.machine.timeline.at("flash", operation.ends, self._end)
        if self.cut_power_in is not None:
            self.cut_power_in -= 1
            if self.cut_power_in < 0:
                self.cut_power_in = None
                half_way = (operation.begun + operation.ends) // 2
                self.machine.timeline.at("flash power", half_way, lambda _time: self.machine.power_cut())
        self.machine.cpu.end_slice()

    def _end(self, _time: int) -> None:
        assert self._operation is not None
        self.store(self._operation.offset, self._operation.after)
        self._operation = None
        self.sr = self.sr & ~BSY | EOP

    def _leave_half_done(self, operation: Operation) -> None:
        """Change each bit with a probability equal to the part of the operation's time that has passed."""
        odds = (self.machine.now - operation.begun) / (operation.ends - operation.begun)
        before = bytes(self.machine.cpu.flash[operation.offset : operation.offset + len(operation.after)])
        self.store(operation.offset, torn(before, operation.after, odds, self.machine.chance))

    def store(self, offset: int, data: bytes) -> None:
        """Write these bytes to the memory; worn bits keep their level."""
        for at, byte in enumerate(data, offset):
            zeros, ones = self._stuck.get(at, (0, 0))
            self.machine.cpu.flash[at] = byte & ~zeros | ones
