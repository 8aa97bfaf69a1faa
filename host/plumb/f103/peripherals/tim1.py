"""TIM1 (RM0008 chapter 14): centre-aligned PWM on three complementary pairs, dead time, break, preloaded commutation.
Counting up it captures rising edges of PA8 on channel 1, behind its filter.

No event is planned for the waveform: the outputs are computed when they are read. With `trace` set, every edge of every
output is recorded, in order. One assumption is conservative for tests of shoot-through: when the enable bits of a pair
change, its outputs follow at once, without dead time, because the manual guarantees dead time only for edges of OCxREF
while both outputs are enabled. Not modelled: channel 4, other captures and interrupts, slave modes, polarity, idle
levels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from plumb.f103.core.bus import Register, SimulationError
from plumb.f103.peripherals.tim import (
    ARPE,
    CC1E,
    CC1I,
    CC1OF,
    CEN,
    FILTERS,
    FORCED_HIGH,
    FORCED_LOW,
    PWM1,
    UG,
    UIF,
    Timer,
)

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

CMS, DIR, CCPC, COMG, BG, BIF, COMIF = 0x60, 0x10, 1, 0x20, 0x80, 0x80, 0x20
OSSI, OSSR, BKE, BKP, AOE, MOE = 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15
LOCK, LOCKED_1, LOCKED_2 = 3 << 8, 0xFF | BKE | BKP | AOE, OSSI | OSSR
PHASES = 3
HIGH_PINS, LOW_PINS, BREAK_PIN = ("PA8", "PA9", "PA10"), ("PB13", "PB14", "PB15"), "PB12"
CAPTURE_PIN, CC1S_TI1, CAPTURE_IRQ = "PA8", 1, 27
LONG_AGO = -(1 << 62)


class Edge(NamedTuple):
    """An edge of an output. side: 'high' or 'low'; on: the new level, None when the timer stops driving the pin."""

    time: int
    phase: int
    side: str
    on: bool | None


class Bridge(NamedTuple):
    """Present drive of a three-phase bridge. duty: of each phase's high side, 0 to 1; None: both switches off."""

    duty: tuple[float | None, float | None, float | None]
    enabled: bool
    """Main output enable, MOE."""


class Tim1(Timer):
    REGISTERS = (
        *(register for register in Timer.REGISTERS if register.name not in ("cr2", "ccer")),
        Register("cr2", 0x04, 0, 0x7FFD),
        Register("ccer", 0x20, 0, 0x3FFF),
        Register("rcr", 0x30, 0, 0xFF),
        Register("bdtr", 0x44, 0, 0xFFFF),
    )
    rcr: int
    bdtr: int

    def __init__(self, machine: Mcu) -> None:
        self.trace: list[Edge] | None = None
        self._shown: dict[tuple[int, str], bool | None] = {}
        super().__init__(machine, "TIM1", 0x40012C00, 25)

    def reset(self) -> None:
        super().reset()
        self.down = False
        self.active_modes, self.active_ccer = 0, 0
        self._ref = [False] * PHASES
        self._ref_since = [LONG_AGO] * PHASES
        self._scanned = 0
        self.level = self.filtering = False
        """TI1 after its filter, and whether another level is being looked at."""
        self.machine.timeline.cancel("TIM1 filter")
        self.machine.nvic.set_line(CAPTURE_IRQ, False)
        self._look(self.machine.now)

    # Counting

    @property
    def step_ticks(self) -> int:
        return (self.active_psc + 1) * self.machine.rcc.pclk2_ticks

    @property
    def period_ticks(self) -> int:
        """Time between two update events: half a period of the centre-aligned PWM; of counting up, a whole one."""
        return (self.active_arr + (0 if self.cr1 & CMS else 1)) * self.step_ticks

    def settle(self, now: int) -> None:
        while self.cr1 & CEN and self.active_arr and now >= self.zero_at + self.period_ticks:
            end = self.zero_at + self.period_ticks
            self._scan(end)
            before = self.period_ticks
            self.zero_at, self.down = end, not self.down and bool(self.cr1 & CMS)
            self.sr |= UIF
            self._preload()
            if self.bdtr & AOE and not self.break_active:
                self.bdtr |= MOE
            self._look(end)
            if (self.trace is None or not self.bdtr & MOE) and before == self.period_ticks:
                halves = (now - self.zero_at) // before
                self.zero_at += halves * before
                self.down ^= bool(halves & 1 and self.cr1 & CMS)
        self._scan(now)

    def count(self, now: int) -> int:
        if not self.cr1 & CEN:
            return self.cnt
        steps = (now - self.zero_at) // self.step_ticks
        return self.active_arr - steps if self.down else steps

    def write_cr1(self, value: int) -> None:
        if value & DIR or (not value & CMS and self.bdtr & MOE):
            raise SimulationError(f"TIM1_CR1 = 0x{value:04X}: PWM is modelled for centre-aligned counting alone")
        now = self.machine.now
        self.settle(now)
        if value & CEN and not self.cr1 & CEN:
            self.zero_at, self.down = now, False
        self.cr1 = value & 0x3FF
        self._look(now)

    def write_arr(self, value: int) -> None:
        self.settle(self.machine.now)
        self.arr = value & 0xFFFF
        if not self.cr1 & (ARPE | CEN):
            self.active_arr = self.arr
        elif not self.cr1 & ARPE:
            raise SimulationError("TIM1_ARR is written while counting, without its preload: not modelled")

    def write_rcr(self, value: int) -> None:
        if value:
            raise SimulationError("TIM1_RCR: repetition is not modelled")

    def write_cr2(self, value: int) -> None:
        if value & ~CCPC:
            raise SimulationError(f"TIM1_CR2 = 0x{value:04X}: only CCPC is modelled")
        self.settle(self.machine.now)
        self.cr2 = value
        self._take_modes(self.machine.now)

    # Modes and enables of the outputs: preloaded while CCPC is set

    def write_ccmr1(self, value: int) -> None:
        self.ccmr1 = value & 0xFFFF
        self._check_modes()
        if not self.cr2 & CCPC:
            self._take_modes(self.machine.now)

    def write_ccmr2(self, value: int) -> None:
        self.ccmr2 = value & 0xFFFF
        self._check_modes()
        if not self.cr2 & CCPC:
            self._take_modes(self.machine.now)

    def _check_modes(self) -> None:
        for index in range(PHASES):
            byte = self._output_mode(index)
            if index == 0 and byte & 0xF == CC1S_TI1:
                continue
            if byte & 3 or byte >> 4 not in (0, FORCED_LOW, FORCED_HIGH, PWM1):
                raise SimulationError(f"TIM1: output mode 0x{byte:02X} of channel {index + 1} is not modelled")

    def write_ccer(self, value: int) -> None:
        if value & 0x2AAA or value & 0x1000:
            raise SimulationError(f"TIM1_CCER = 0x{value:04X}: polarity and channel 4 are not modelled")
        self.ccer = value & 0x3FFF
        if not self.cr2 & CCPC:
            self._take_modes(self.machine.now)

    def _take_modes(self, now: int) -> None:
        self.settle(now)
        changed = self.active_ccer ^ self.ccer
        self.active_modes = self.ccmr1 | self.ccmr2 << 16
        self.active_ccer = self.ccer
        for phase in range(PHASES):
            if changed >> (4 * phase) & 5:
                self._ref[phase] = self._reference(phase, now)
                self._ref_since[phase] = LONG_AGO
        self._look(now)

    def write_egr(self, value: int) -> None:
        if value & ~(UG | COMG | BG):
            raise SimulationError(f"TIM1_EGR = 0x{value:02X}: only UG, COMG and BG are modelled")
        now = self.machine.now
        if value & UG:
            self.settle(now)
            self._preload()
            self.zero_at, self.down, self.cnt = now, False, 0
            self.sr |= UIF
            self._look(now)
        if value & COMG:
            self.sr |= COMIF
            self._take_modes(now)
        if value & BG:
            self.break_now(now)

    # Capture

    @property
    def filter_ticks(self) -> int:
        divider, samples = FILTERS[self.ccmr1 >> 4 & 15]
        return self.machine.rcc.pclk2_ticks * (1 << (self.cr1 >> 8 & 3)) * divider * samples

    def _look_at_input(self) -> None:
        """A new level of PA8 takes effect when it lasts as long as the filter requires."""
        if not (self.clocked and self.cr1 & CEN and self.ccmr1 & 3 == CC1S_TI1):
            return
        differs = bool(self.machine.pin(CAPTURE_PIN)) != self.level
        if differs and not self.filtering:
            self.machine.timeline.at("TIM1 filter", self.machine.now + self.filter_ticks, self._captures)
        elif not differs:
            self.machine.timeline.cancel("TIM1 filter")
        self.filtering = differs

    def _captures(self, time: int) -> None:
        self.level, self.filtering = not self.level, False
        if self.level and self.ccer & CC1E:
            self.settle(time)
            self.ccr1 = self.count(time)
            self.sr |= CC1I | (CC1OF if self.sr & CC1I else 0)
            self._plan()

    def read_ccr1(self) -> int:
        """Reading what was captured takes the request back."""
        if self.ccmr1 & 3 == CC1S_TI1:
            self.sr &= ~CC1I
            self._plan()
        return self.ccr1

    def peek_ccr1(self) -> int:
        return self.ccr1

    def write_dier(self, value: int) -> None:
        if value & ~CC1I:
            raise SimulationError(f"TIM1_DIER = 0x{value:04X}: only the interrupt of channel 1 is modelled")
        self.dier = value
        self._plan()

    def _plan(self) -> None:
        self.machine.nvic.set_line(CAPTURE_IRQ, bool(self.sr & self.dier & CC1I))

    # Break

    @property
    def break_active(self) -> bool:
        """True while the break input is active, by its polarity; a floating pin counts as active."""
        if not self.bdtr & BKE:
            return False
        level = self.machine.pin(BREAK_PIN)
        return level is None or level == bool(self.bdtr & BKP)

    def break_now(self, now: int) -> None:
        """Break: clear the main output enable, whatever the core is doing."""
        self.settle(now)
        self.bdtr &= ~MOE
        self.sr |= BIF
        self._look(now)

    def pins_changed(self) -> None:
        if self.clocked and self.break_active:
            self.break_now(self.machine.now)
        self._look_at_input()

    def clock_failed(self) -> None:
        """The clock has failed: the clock security system triggers a break."""
        if self.clocked and self.bdtr & BKE:
            self.break_now(self.machine.now)

    def write_bdtr(self, value: int) -> None:
        now = self.machine.now
        self.settle(now)
        level = (self.bdtr & LOCK) >> 8
        frozen = (LOCK if level else 0) | (LOCKED_1 if level >= 1 else 0) | (LOCKED_2 if level >= 2 else 0)
        self.bdtr = self.bdtr & frozen | value & 0xFFFF & ~frozen
        if self.break_active:
            self.bdtr &= ~MOE
            self.sr |= BIF
        self._look(now)

    def write_sr(self, value: int) -> None:
        super().write_sr(value)
        if self.break_active:
            self.sr |= BIF

    # Outputs

    @property
    def dead_ticks(self) -> int:
        """Dead time by DTG, in ticks, with CKD 0 (14.4.18)."""
        code = self.bdtr & 0xFF
        if code < 0x80:
            units = code
        elif code < 0xC0:
            units = (64 + (code & 63)) * 2
        elif code < 0xE0:
            units = (32 + (code & 31)) * 8
        else:
            units = (32 + (code & 31)) * 16
        return units * self.machine.rcc.pclk2_ticks

    def _mode(self, phase: int) -> int:
        return self.active_modes >> (8 * phase + 4) & 7

    def _reference(self, phase: int, now: int) -> bool:
        """OCxREF. A compare value of n counts is n counts on either side of the valley."""
        mode = self._mode(phase)
        if mode != PWM1 or not self.cr1 & CEN:
            return mode == FORCED_HIGH
        into, on = now - self.zero_at, self.active_ccr[phase] * self.step_ticks
        return into >= self.period_ticks - on if self.down else into < on

    def _output(self, phase: int, now: int) -> tuple[bool | None, bool | None]:
        """Levels of OCx and OCxN (table 83); None where the timer does not drive."""
        enables = self.active_ccer >> (4 * phase) & 5
        run = bool(self.bdtr & MOE)
        off = False if enables and self.bdtr & (OSSR if run else OSSI) else None
        if not run or not enables:
            return off, off
        ref = self._ref[phase]
        if enables == 1:
            return ref, off
        if enables == 4:
            return off, ref
        passed = now - self._ref_since[phase] >= self.dead_ticks
        return ref and passed, not ref and passed

    def _look(self, now: int) -> None:
        """Bring the trace up to date with OCxREF."""
        for phase in range(PHASES):
            ref = self._reference(phase, now)
            if ref != self._ref[phase]:
                self._ref[phase], self._ref_since[phase] = ref, now
            if self.trace is None:
                continue
            for side, level in zip(("high", "low"), self._output(phase, now), strict=True):
                if self._shown.get((phase, side), None) != level:
                    self._shown[phase, side] = level
                    self.trace.append(Edge(now, phase, side, level))

    def _scan(self, now: int) -> None:
        """Record every edge since the last call; the settings have not changed in between."""
        if self.trace is None or not self.cr1 & CEN or not self.bdtr & MOE:  # counting moves no output
            self._scanned = now
            return
        instants = {now}
        for phase in range(PHASES):
            on = self.active_ccr[phase] * self.step_ticks
            flip = self.zero_at + (self.period_ticks - on if self.down else on)
            instants |= {flip, flip + self.dead_ticks, self._ref_since[phase] + self.dead_ticks}
        for instant in sorted(instants):
            if self._scanned < instant <= now:
                self._look(instant)
        self._scanned = now

    def levels(self, phase: int, now: int) -> tuple[bool | None, bool | None]:
        """Level of a phase's high and low gate at `now`; None where the timer does not drive."""
        self.settle(now)
        return self._output(phase, now)

    def bridge(self, now: int) -> Bridge:
        """Mean drive of each phase, without the effect of dead time."""
        self.settle(now)
        duty: list[float | None] = []
        for phase in range(PHASES):
            enables = self.active_ccer >> (4 * phase) & 5
            mode, driven = self._mode(phase), self.bdtr & MOE and enables == 5
            driven = driven and self._wired(HIGH_PINS[phase]) and self._wired(LOW_PINS[phase])
            share = (
                self.active_ccr[phase] / self.active_arr if mode == PWM1 and self.active_arr else mode == FORCED_HIGH
            )
            duty.append(min(float(share), 1.0) if driven else None)
        return Bridge((duty[0], duty[1], duty[2]), bool(self.bdtr & MOE))

    def alone(self, pin: str, now: int) -> float | None:
        """Share of the time that a low side is high whose high side is disabled: its output is OCxREF (table 83)."""
        self.settle(now)
        phase = LOW_PINS.index(pin)
        driven = self.active_ccer >> (4 * phase) & 5 == 4 and self.bdtr & MOE and self.cr1 & CEN
        if not driven or self._mode(phase) != PWM1 or not self.active_arr or not self._wired(pin):
            return None
        return min(self.active_ccr[phase] / self.active_arr, 1.0)

    def gate(self, pin: str, now: int) -> bool | None:
        """Level of a gate's pin by the timer; None while the pin is not its output or the timer does not drive it."""
        self.settle(now)
        phase = (HIGH_PINS if pin in HIGH_PINS else LOW_PINS).index(pin)
        return self._output(phase, now)[pin in LOW_PINS] if self._wired(pin) else None

    def _wired(self, pin: str) -> bool:
        return self.machine.port(pin).is_alternate_output(int(pin[2:])) and not self.machine.afio.mapr >> 6 & 3
