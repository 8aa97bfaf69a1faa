"""Independent and window watchdog (RM0008 19, 20)."""

from __future__ import annotations

from typing import ClassVar

from second_chip.block import Block, Layout
from second_chip.clocks import IWDG_RESET, UNITS_HZ, WWDG_RESET

LSI_HZ = 40_000
LSI = UNITS_HZ // LSI_HZ
UPDATE_CYCLES = 5


class Iwdg(Block):
    LAYOUT: ClassVar[Layout] = {0x00: ("KR", 0, 0), 0x04: ("PR", 0, 7), 0x08: ("RLR", 0xFFF, 0xFFF), 0x0C: ("SR", 0, 0)}

    def reset(self) -> None:
        super().reset()
        self.started = self.unlocked = False
        self.fed = 0

    def write_KR(self, value: int) -> None:
        self.unlocked = value == 0x5555
        if value == 0xCCCC:
            self.started = True
            self.chip.rcc.start_lsi()
        if value in (0xAAAA, 0xCCCC):
            self._reload()

    def _reload(self) -> None:
        self.fed += 1
        if self.started:
            fed = self.fed
            length = (self.value["RLR"] + 1) * (4 << min(self.value["PR"], 6)) * LSI
            self.chip.after(length, lambda: self._expire(fed))

    def _expire(self, fed: int) -> None:
        if fed == self.fed:
            self.chip.ask_reset(flags=IWDG_RESET)

    def write_PR(self, value: int) -> None:
        self._update("PR", value & 7, 1)

    def write_RLR(self, value: int) -> None:
        self._update("RLR", value & 0xFFF, 2)

    def _update(self, name: str, value: int, busy: int) -> None:
        if not self.unlocked:
            return
        self.value["SR"] |= busy

        def updated() -> None:
            self.value[name] = value
            self.value["SR"] &= ~busy

        if self.started:  # without its oscillator nothing is taken over
            self.chip.after(UPDATE_CYCLES * LSI, updated)


class Wwdg(Block):
    """Counts down from T on PCLK1 / 4096 / 2^WDGTB; 0x3F resets, and so does a refresh while T is above W."""

    LAYOUT: ClassVar[Layout] = {0x00: ("CR", 0x7F, 0xFF), 0x04: ("CFR", 0x7F, 0x3FF), 0x08: ("SR", 0, 0)}
    CLOCK = ("APB1ENR", 11)

    def reset(self) -> None:
        super().reset()
        self.written_at = self.fed = 0

    def _step(self) -> int:
        return self.chip.rcc.pclk1() * 4096 << self.bit("CFR", 7, 2)

    def _count(self) -> int:
        """The prescaler runs freely, so the first count of a refresh may be short."""
        if not self.value["CR"] & 0x80:
            return self.value["CR"] & 0x7F
        gone = self.chip.now // self._step() - self.written_at // self._step()
        return max(0x3F, (self.value["CR"] & 0x7F) - gone)

    def read_CR(self) -> int:
        return self.value["CR"] & 0x80 | self._count()

    def write_CR(self, value: int) -> None:
        running = self.value["CR"] & 0x80
        if running and self._count() > self.value["CFR"] & 0x7F:
            self.chip.ask_reset(flags=WWDG_RESET)
            return
        self.value["CR"] = running | value & 0xFF
        self.written_at = self.chip.now
        self.fed += 1
        if self.value["CR"] & 0x80:
            fed, step = self.fed, self._step()
            counts = max(0, (value & 0x7F) - 0x3F)
            end = (self.chip.now // step + counts) * step if value & 0x40 else self.chip.now
            self.chip.after(end - self.chip.now, lambda: self._expire(fed))

    def write_CFR(self, value: int) -> None:
        self.value["CFR"] = value & 0x1FF | self.value["CFR"] & 0x200 | value & 0x200

    def _expire(self, fed: int) -> None:
        if fed == self.fed:
            self.chip.ask_reset(flags=WWDG_RESET)
