"""Independent watchdog (RM0008 chapter 19) with its own oscillator: 30 to 60 kHz by the data sheet, 40 kHz by
default."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register
from plumb.f103.core.timeline import TICKS_PER_S

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

START, RELOAD, UNLOCK = 0xCCCC, 0xAAAA, 0x5555
PVU, RVU = 1, 2
UPDATE_CYCLES = 5


class Iwdg(Peripheral):
    REGISTERS = (
        Register("kr", 0x00),
        Register("pr", 0x04, 0, 7),
        Register("rlr", 0x08, 0xFFF, 0xFFF),
        Register("sr", 0x0C, 0, 0),
    )
    pr: int
    rlr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "IWDG", 0x40003000)
        self.lsi_hz = 40_000
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.running = self.unlocked = False
        self.busy_until = {PVU: 0, RVU: 0}
        self.machine.timeline.cancel("iwdg")

    @property
    def timeout_ticks(self) -> int:
        prescaler = 4 << min(self.pr, 6)
        return (self.rlr + 1) * prescaler * TICKS_PER_S // self.lsi_hz

    def _reload(self) -> None:
        if self.running:
            self.machine.timeline.at("iwdg", self.machine.now + self.timeout_ticks, self._bite)

    def _bite(self, _time: int) -> None:
        self.machine.request_reset("iwdg")

    def read_kr(self) -> int:
        return 0

    def write_kr(self, value: int) -> None:
        key = value & 0xFFFF
        self.unlocked = key == UNLOCK
        if key == START and not self.running:
            self.running = True
            self._reload()
        elif key == RELOAD:
            self._reload()

    def _write_slow(self, name: str, flag: int, value: int) -> None:
        """PR and RLR reach the clock domain of LSI after a few of its cycles; until then they refuse a new value."""
        now = self.machine.now
        if not self.unlocked:
            self.machine.warn(f"IWDG_{name.upper()} is written while locked")
        elif now < self.busy_until[flag]:
            self.machine.warn(f"IWDG_{name.upper()} is written while its update is under way")
        else:
            setattr(self, name, value)
            self.busy_until[flag] = now + UPDATE_CYCLES * TICKS_PER_S // self.lsi_hz

    def write_pr(self, value: int) -> None:
        self._write_slow("pr", PVU, value & 7)

    def write_rlr(self, value: int) -> None:
        self._write_slow("rlr", RVU, value & 0xFFF)

    def read_sr(self) -> int:
        now = self.machine.now
        return sum(flag for flag, until in self.busy_until.items() if now < until)
