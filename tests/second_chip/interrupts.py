"""NVIC, SysTick and the system control block (Armv7-M B3.2 to B3.4), with the 4 priority bits of the F103."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from second_chip.chip import Chip

NMI, HARD_FAULT, DEBUG_MONITOR, PENDSV, SYSTICK, FIRST_IRQ = 2, 3, 12, 14, 15, 16
LINES = 60
AIRCR_KEY = 0x05FA


class Nvic:
    """Exceptions by number: pending, enabled, active. A line that is still high when its handler returns is pending
    again."""

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.reset()

    def reset(self) -> None:
        self.pending = 0
        self.enabled = 1 << NMI | 1 << HARD_FAULT | 1 << PENDSV | 1 << SYSTICK
        self.lines = 0
        self.active: list[int] = []
        self.priority = [0] * (FIRST_IRQ + LINES)
        self.priority[NMI], self.priority[HARD_FAULT] = -2, -1
        self.vtor = 0
        self.reload = self.control = 0
        self.tick_started: int | None = None
        self.stopped_at = 0
        self.count_flag = False
        self._tick_id = 0

    # ---- what a peripheral does ----

    def line(self, irq: int, level: bool) -> None:
        bit = 1 << FIRST_IRQ + irq
        if level and not self.lines & bit:
            self.pending |= bit
        self.lines = self.lines | bit if level else self.lines & ~bit

    def nmi(self) -> None:
        self.pending |= 1 << NMI

    # ---- what the processor asks ----

    def next(self, masked: bool) -> int | None:
        """The exception to be taken now, if there is one. masked: PRIMASK is set."""
        ready = self.pending & self.enabled
        if not ready:
            return None
        current = min((self.priority[number] for number in self.active), default=256)
        best = None
        while ready:
            number = (ready & -ready).bit_length() - 1
            ready &= ready - 1
            if self.priority[number] < current:
                current, best = self.priority[number], number
        return None if masked and best is not None and best != NMI else best

    def enter(self, number: int) -> None:
        self.pending &= ~(1 << number)
        self.active.append(number)

    def leave(self) -> None:
        number = self.active.pop()
        self.pending |= self.lines & 1 << number

    # ---- SysTick ----

    def _cycle(self) -> int:
        return self.chip.rcc.cycle * (1 if self.control & 4 else 8)

    def _start(self) -> None:
        """The counter takes the reload value one cycle after it has reached 0 (B3.3.1)."""
        self.tick_started = self.chip.now
        self._tick_id += 1
        self._schedule(self._tick_id)

    def _schedule(self, tick_id: int) -> None:
        self.chip.after((self.reload + 1) * self._cycle(), lambda: self._tick(tick_id))

    def _tick(self, tick_id: int) -> None:
        if tick_id != self._tick_id or not self.control & 1:
            return
        self.tick_started = self.chip.now
        self.count_flag = True
        if self.control & 2:
            self.pending |= 1 << SYSTICK
        self._schedule(tick_id)

    def _current(self) -> int:
        if self.tick_started is None:
            return self.stopped_at
        return max(0, self.reload - (self.chip.now - self.tick_started) // self._cycle())

    # ---- registers, offsets from 0xE000E000 ----

    def read(self, offset: int) -> int:
        if 0x100 <= offset < 0x400:
            shift = FIRST_IRQ + 32 * (offset % 0x80 // 4)
            source = self.enabled if offset < 0x200 else self.pending if offset < 0x300 else self._active_bits()
            return source >> shift & 0xFFFFFFFF
        if 0x400 <= offset < 0x43C:
            first = FIRST_IRQ + offset - 0x400
            return int.from_bytes(bytes(self.priority[first : first + 4]), "little")
        if offset == 0x10:
            flag, self.count_flag = self.count_flag, False
            return self.control | flag << 16
        if offset == 0xD04:
            bits = (self.pending >> NMI & 1) << 31 | (self.pending >> PENDSV & 1) << 28
            bits |= (self.pending >> SYSTICK & 1) << 26 | (self.pending >> FIRST_IRQ > 0) << 22
            to_base = len(self.active) < 2  # RETTOBASE: nothing is interrupted but the program
            return bits | to_base << 11 | (self.active[-1] if self.active else 0)
        return {
            0x14: self.reload,
            0x18: self._current(),
            0xD00: 0x411FC231,  # Cortex-M3 r1p1
            0xD08: self.vtor,
            0xD0C: 0xFA050000,
            0xD14: 0,  # CCR: r1p1 leaves STKALIGN at 0
            0xD20: int.from_bytes(bytes(self.priority[DEBUG_MONITOR:FIRST_IRQ]), "little"),
        }[offset]

    def _active_bits(self) -> int:
        return sum(1 << number for number in self.active)

    def write(self, offset: int, value: int) -> None:
        if 0x100 <= offset < 0x300:
            bits = value << FIRST_IRQ + 32 * (offset % 0x80 // 4)
            if offset < 0x180:
                self.enabled |= bits
            elif offset < 0x200:
                self.enabled &= ~bits
            elif offset < 0x280:
                self.pending |= bits
            else:
                self.pending = self.pending & ~bits | self.lines & bits & ~self._active_bits()
        elif 0x400 <= offset < 0x43C:
            first = FIRST_IRQ + offset - 0x400
            self.priority[first : first + 4] = [byte & 0xF0 for byte in value.to_bytes(4, "little")]
        elif offset == 0x10:
            was, self.control = self.control, value & 7
            if value & 1 and not was & 1:
                self._start()
            elif not value & 1 and was & 1:
                self.stopped_at, self.tick_started = self._current(), None
        elif offset == 0x14:
            self.reload = value & 0xFFFFFF
        elif offset == 0x18:
            self.count_flag, self.stopped_at = False, 0
            if self.control & 1:
                self._start()
        elif offset == 0xD04:
            for bit, number in ((31, NMI), (28, PENDSV), (26, SYSTICK)):
                self.pending |= (value >> bit & 1) << number
            self.pending &= ~((value >> 27 & 1) << PENDSV | (value >> 25 & 1) << SYSTICK)
        elif offset == 0xD08:
            self.vtor = value & 0x3FFFFF80
        elif offset == 0xD0C:
            if value >> 16 == AIRCR_KEY and value & 4:
                self.chip.ask_reset(software=True)
        elif offset == 0xD20:
            for number in (DEBUG_MONITOR, PENDSV, SYSTICK):
                self.priority[number] = value >> 8 * (number - DEBUG_MONITOR) & 0xF0
        else:
            raise KeyError(offset)
