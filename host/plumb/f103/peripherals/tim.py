"""General-purpose timers TIM3 and TIM4 (RM0008 chapter 15): up-counting, update event to interrupt or TRGO, and PWM
with preload. The count is computed when it is read. As an encoder the counter follows two inputs, whose edges are taken
to last as long as their filter asks. Not modelled: capture, compare flags, other slave modes, DMA."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_US

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

CEN, UDIS, URS, OPM, ARPE = 1, 2, 4, 8, 128
UIE, UIF, UG = 1, 1, 1
TRGO_ENABLE, TRGO_UPDATE = 1, 2
FORCED_LOW, FORCED_HIGH, PWM1, PWM2 = 4, 5, 6, 7
CC1E, CC1I, CC1OF = 1, 2, 1 << 9
SMS_BOTH, ENCODER_INPUTS, FILTER_BITS = 3, 0x0101, 0xF0F0
"""SMCR.SMS: the edges of both inputs count; CCMR1: channel 1 is TI1, channel 2 is TI2; and its filters."""
FILTERS = (
    (1, 1),
    (1, 2),
    (1, 4),
    (1, 8),
    (2, 6),
    (2, 8),
    (4, 6),
    (4, 8),
    (8, 6),
    (8, 8),
    (16, 5),
    (16, 6),
    (16, 8),
    (32, 5),
    (32, 6),
    (32, 8),
)
"""IC1F -> divider of the sampling clock, number of equal samples that make an edge."""


class Pwm(NamedTuple):
    """Waveform of an output pin. enabled: the timer drives the pin with pulses of this length."""

    pulse_us: float
    period_us: float
    enabled: bool


class Timer(Peripheral):
    REGISTERS = (
        Register("cr1", 0x00),
        Register("cr2", 0x04, 0, 0xF8),
        Register("smcr", 0x08),
        Register("dier", 0x0C),
        Register("sr", 0x10),
        Register("egr", 0x14),
        Register("ccmr1", 0x18, 0, 0xFFFF),
        Register("ccmr2", 0x1C, 0, 0xFFFF),
        Register("ccer", 0x20, 0, 0x3333),
        Register("cnt", 0x24),
        Register("psc", 0x28, 0, 0xFFFF),
        Register("arr", 0x2C, 0xFFFF, 0xFFFF),
        *(Register(f"ccr{i + 1}", 0x34 + 4 * i, 0, 0xFFFF) for i in range(4)),
    )
    cr1: int
    cr2: int
    smcr: int
    dier: int
    sr: int
    ccmr1: int
    ccmr2: int
    ccer: int
    cnt: int
    psc: int
    arr: int
    ccr1: int
    ccr2: int
    ccr3: int
    ccr4: int

    def __init__(self, machine: Mcu, name: str, base: int, interrupt: int) -> None:
        super().__init__(machine, name, base)
        self.interrupt = interrupt
        self.turned = 0
        """Position of the encoder on its inputs, in a quarter of a period; a reset does not move it."""
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.active_psc, self.active_arr = 0, 0xFFFF
        self.active_ccr = [0, 0, 0, 0]
        self.zero_at = 0
        """Time at which the running count was, or will be, 0; counts are modulo 65536."""
        self.started_at = 0
        """Time at which the counter was last enabled, in ticks."""
        self.machine.timeline.cancel(self.name)
        self.machine.nvic.set_line(self.interrupt, False)

    @property
    def step_ticks(self) -> int:
        return (self.active_psc + 1) * self.machine.rcc.timer1_ticks

    @property
    def period_ticks(self) -> int:
        return (self.active_arr + 1) * self.step_ticks

    def _preload(self) -> None:
        """Update event: preloaded registers take effect."""
        self.active_psc, self.active_arr = self.psc, self.arr
        self.active_ccr = [getattr(self, f"ccr{i + 1}") for i in range(4)]

    def settle(self, now: int) -> None:
        """Handle the update events up to now."""
        probe = self.machine.probe
        while self.cr1 & CEN and not self.smcr & 7 and self.active_arr and now >= self.zero_at + self.period_ticks:
            if probe is not None:
                probe.timer(self, self.zero_at + self.period_ticks)
            self.zero_at += self.period_ticks
            before = self.period_ticks
            if not self.cr1 & UDIS:  # else the count restarts without an update event (15.4.1)
                self.sr |= UIF
                self._preload()
            if self.cr1 & OPM:
                self.cr1 &= ~CEN
                self.cnt = 0
            elif before == self.period_ticks:
                self.zero_at += (now - self.zero_at) // before * before
        if probe is not None:
            probe.timer(self, now)

    def count(self, now: int) -> int:
        runs = self.cr1 & CEN and not self.smcr & 7
        return ((now - self.zero_at) // self.step_ticks) & 0xFFFF if runs else self.cnt

    def encoded(self, counts: int) -> None:
        """So many edges of both inputs, positive where TI1 leads: table 85 (15.3.12) with both polarities plain."""
        listens = self.clocked and self.cr1 & CEN and self.smcr & 7 == SMS_BOTH
        if listens and self.ccmr1 & 0x0303 == ENCODER_INPUTS:
            self.cnt = (self.cnt + counts) % (self.active_arr + 1)

    def _plan(self) -> None:
        self.machine.nvic.set_line(self.interrupt, bool(self.sr & UIF and self.dier & UIE))
        wanted = self.dier & UIE or (self.cr2 >> 4) & 7 == TRGO_UPDATE
        if self.cr1 & CEN and wanted and not self.cr1 & UDIS and self.active_arr:
            self.machine.timeline.at(self.name, self.zero_at + self.period_ticks, self._update)
        else:
            self.machine.timeline.cancel(self.name)

    def _update(self, time: int) -> None:
        self.settle(time)
        self._trigger_out(TRGO_UPDATE, time)
        self._plan()

    def _trigger_out(self, source: int, time: int) -> None:
        if (self.cr2 >> 4) & 7 == source and self.name == "TIM3" and self.machine.adc1.armed_for_timer():
            self.machine.adc1.trigger(time)

    def clock_changing(self, now: int) -> None:
        self.settle(now)
        self.cnt = self.count(now)

    def clock_changed(self, now: int) -> None:
        self.zero_at = now - self.cnt * self.step_ticks
        self._plan()

    # Registers

    def write_cr1(self, value: int) -> None:
        if value & 0x70:
            raise SimulationError(f"{self.name}_CR1 = 0x{value:04X}: only edge-aligned up-counting is modelled")
        now = self.machine.now
        self.settle(now)
        self.cnt = self.count(now)
        starts = value & ~self.cr1 & CEN
        self.cr1 = value & 0x3FF
        self.zero_at = now - self.cnt * self.step_ticks
        if starts:
            self.started_at = now
            self._trigger_out(TRGO_ENABLE, now)
        self._plan()

    def write_cr2(self, value: int) -> None:
        self.settle(self.machine.now)
        self.cr2 = value & 0xF8
        self._plan()

    def write_smcr(self, value: int) -> None:
        if value not in (0, SMS_BOTH):
            raise SimulationError(f"{self.name}_SMCR = 0x{value:04X}: of the slave modes encoders alone are modelled")
        if value != self.smcr and self.cr1 & CEN:
            raise SimulationError(f"{self.name}_SMCR is written while counting: not modelled")
        self.smcr = value

    def write_dier(self, value: int) -> None:
        if value & ~UIE:
            raise SimulationError(f"{self.name}_DIER = 0x{value:04X}: only the update interrupt is modelled")
        self.settle(self.machine.now)
        self.dier = value
        self._plan()

    def read_sr(self) -> int:
        self.settle(self.machine.now)
        return self.sr

    def write_sr(self, value: int) -> None:
        self.settle(self.machine.now)
        self.sr &= value
        self._plan()

    def write_egr(self, value: int) -> None:
        if value & ~UG:
            raise SimulationError(f"{self.name}_EGR = 0x{value:02X}: only UG is modelled")
        if value & UG:
            now = self.machine.now
            self.settle(now)
            self.cnt, self.zero_at = 0, now
            if not self.cr1 & UDIS:
                self._preload()
                if not self.cr1 & URS:
                    self.sr |= UIF
                self._trigger_out(TRGO_UPDATE, now)
            self._plan()

    def read_egr(self) -> int:
        return 0

    def read_cnt(self) -> int:
        now = self.machine.now
        self.settle(now)
        return self.count(now)

    def write_cnt(self, value: int) -> None:
        now = self.machine.now
        self.settle(now)
        self.cnt = value & 0xFFFF
        self._restart_count(now)

    def _restart_count(self, now: int) -> None:
        """Count on from `cnt`; from a value beyond ARR it counts to 65535 first."""
        start = self.cnt - (65536 if self.cnt > self.active_arr else 0)
        self.zero_at = now - start * self.step_ticks
        self._plan()

    def write_psc(self, value: int) -> None:
        self.settle(self.machine.now)
        self.psc = value & 0xFFFF

    def write_arr(self, value: int) -> None:
        now = self.machine.now
        self.settle(now)
        self.cnt = self.count(now)
        self.arr = value & 0xFFFF
        if not self.cr1 & ARPE:
            self.active_arr = self.arr
            self._restart_count(now)

    def _write_ccr(self, index: int, value: int) -> None:
        self.settle(self.machine.now)
        setattr(self, f"ccr{index + 1}", value & 0xFFFF)
        if not self._output_mode(index) & 8:  # OCxPE
            self.active_ccr[index] = value & 0xFFFF

    def write_ccr1(self, value: int) -> None:
        self._write_ccr(0, value)

    def write_ccr2(self, value: int) -> None:
        self._write_ccr(1, value)

    def write_ccr3(self, value: int) -> None:
        self._write_ccr(2, value)

    def write_ccr4(self, value: int) -> None:
        self._write_ccr(3, value)

    def _output_mode(self, index: int) -> int:
        """The byte of CCMR for a channel: OCxM in bits 6:4, OCxPE 3, CCxS 1:0."""
        return ((self.ccmr1, self.ccmr2)[index >> 1] >> (8 * (index & 1))) & 0xFF

    def output(self, index: int, now: int) -> Pwm:
        """Waveform of channel `index` (0 to 3), whatever the mode of its pin."""
        self.settle(now)
        return self._waveform(index)

    def high_ticks(self, index: int) -> int | None:
        """Time that channel `index` is high from the beginning of a period on; None while it gives no pulses."""
        wave = self._waveform(index)
        return round(wave.pulse_us * TICKS_PER_US) if wave.enabled else None

    def _waveform(self, index: int) -> Pwm:
        mode = self._output_mode(index)
        enable = (self.ccer >> (4 * index)) & 3
        period, duty = self.active_arr + 1, min(self.active_ccr[index], self.active_arr + 1)
        kind = (mode >> 4) & 7
        high = {PWM1: duty, PWM2: period - duty, FORCED_HIGH: period}.get(kind, 0)
        if enable & 2:
            high = period - high
        running = bool(self.cr1 & CEN and enable & 1 and not mode & 3 and kind in (PWM1, PWM2))
        scale = self.step_ticks / TICKS_PER_US
        return Pwm(high * scale, period * scale, running)
