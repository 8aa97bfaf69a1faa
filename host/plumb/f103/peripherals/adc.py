"""ADC1 and ADC2 (RM0008 chapter 11): regular group, single or scan, by software or TIM3 TRGO; of ADC1 one value at a
time to DMA. ADC2 has neither DMA nor the internal channels, and shares ADC1's interrupt.

Conversion of a channel takes its sampling time plus 12.5 ADC cycles; the voltage of the pin is taken when sampling
ends. The codes are ideal (transitions half a step off, 3.3 V full scale): noise and offsets belong to the voltage
source. Without calibration after power-up the codes are off by UNCALIBRATED_LSB. Not modelled: injected group, analog
watchdog, discontinuous mode, dual mode.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

EOC, STRT = 2, 16
EOCIE, SCAN = 1 << 5, 1 << 8
ADON, CONT, CAL, RSTCAL, DMA, ALIGN = 1, 2, 4, 8, 1 << 8, 1 << 11
EXTTRIG, SWSTART, TSVREFE = 1 << 20, 1 << 22, 1 << 23
EXTSEL_TIM3_TRGO, EXTSEL_SWSTART = 4, 7
SAMPLE_HALF_CYCLES = (3, 15, 27, 57, 83, 111, 143, 479)
CONVERT_HALF_CYCLES = 25
CALIBRATION_CYCLES, RESET_CALIBRATION_CYCLES = 83, 4
START_US = 1
FULL_SCALE_V = 3.3
UNCALIBRATED_LSB = 23
REFERENCE_V, TEMPERATURE_V = 1.20, 1.43
IRQ = 18
PINS = tuple([f"PA{i}" for i in range(8)] + ["PB0", "PB1"] + [f"PC{i}" for i in range(6)])
_PLACES = tuple(("ABC".index(pin[1]), int(pin[2:])) for pin in PINS)


class Adc(Peripheral):
    REGISTERS = (
        Register("sr", 0x00),
        Register("cr1", 0x04, 0, 0x00CFFFFF),
        Register("cr2", 0x08),
        Register("smpr1", 0x0C, 0, 0x00FFFFFF),
        Register("smpr2", 0x10, 0, 0x3FFFFFFF),
        *(Register(f"jofr{i + 1}", 0x14 + 4 * i, 0, 0xFFF) for i in range(4)),
        Register("htr", 0x24, 0xFFF, 0xFFF),
        Register("ltr", 0x28, 0, 0xFFF),
        Register("sqr1", 0x2C, 0, 0x00FFFFFF),
        Register("sqr2", 0x30, 0, 0x3FFFFFFF),
        Register("sqr3", 0x34, 0, 0x3FFFFFFF),
        Register("jsqr", 0x38, 0, 0x003FFFFF),
        *(Register(f"jdr{i + 1}", 0x3C + 4 * i, 0, 0) for i in range(4)),
        Register("dr", 0x4C, 0, 0),
    )
    sr: int
    cr1: int
    cr2: int
    smpr1: int
    smpr2: int
    sqr1: int
    sqr2: int
    sqr3: int
    dr: int

    def __init__(self, machine: Mcu, name: str, base: int) -> None:
        super().__init__(machine, name, base)
        self.dma = machine.dma.channels[0] if name == "ADC1" else None
        if self.dma is not None:
            self.dma.served = self.base + 0x4C
        self.events = (f"{name} scan", f"{name} cal")
        self.silent = False
        self.scans = 0
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.ready_at = 0
        self.calibrated = False
        self.busy = False
        for name in self.events:
            self.machine.timeline.cancel(name)

    def sequence(self) -> list[int]:
        """Channel numbers, in order."""
        length = ((self.sqr1 >> 20) & 15) + 1 if self.cr1 & SCAN else 1
        rows = self.sqr3 | self.sqr2 << 30 | self.sqr1 << 60
        return [(rows >> (5 * i)) & 31 for i in range(length)]

    def half_cycles(self, channel: int) -> int:
        """Sampling time of a channel, in half ADC cycles."""
        code = self.smpr2 >> (3 * channel) if channel < 10 else self.smpr1 >> (3 * (channel - 10))
        return SAMPLE_HALF_CYCLES[code & 7]

    def armed_for_timer(self) -> bool:
        return self.cr2 & (ADON | EXTTRIG) == ADON | EXTTRIG and (self.cr2 >> 17) & 7 == EXTSEL_TIM3_TRGO

    def trigger(self, time: int) -> None:
        """Start the sequence. A trigger while one runs is lost, as on silicon."""
        if not self.cr2 & ADON or self.busy:
            return
        if time < self.ready_at:
            self.machine.warn(f"{self.name} is triggered less than 1 us after power-up; ignored")
            return
        clock = self.machine.rcc.adc_ticks
        if clock * 14 < TICKS_PER_US:
            raise SimulationError("the ADC clock is above 14 MHz: set RCC_CFGR.ADCPRE")
        self.busy = True
        self.sr |= STRT
        self._times = []
        end = time
        for channel in self.sequence():
            sampled = end + self.half_cycles(channel) * clock // 2
            end = sampled + CONVERT_HALF_CYCLES * clock // 2
            self._times.append((channel, sampled))
        if not self.silent:
            self.machine.timeline.at(self.events[0], end, self._finish)

    def _finish(self, time: int) -> None:
        self.busy = False
        self.scans += 1
        for channel, sampled in self._times:
            self.dr = self._convert(channel, sampled) << (4 if self.cr2 & ALIGN else 0)
            if self.cr2 & DMA and self.dma is not None:
                taken = self.dma.put([self.dr])
                self.sr = self.sr & ~EOC if taken else self.sr | EOC
            else:
                self.sr |= EOC
        self._update_line()
        if self.cr2 & CONT:
            self.trigger(time)

    def _convert(self, channel: int, time: int) -> int:
        machine = self.machine
        if channel < len(PINS):
            pin, (port, number) = PINS[channel], _PLACES[channel]
            if not machine.ports[port].is_analog(number):
                machine.warn(f"{self.name} converts {pin}, which is not configured as an analog input")
            volts = machine.adc.sampled(pin, time / TICKS_PER_S)
            if machine.probe is not None:
                machine.probe.volts(pin, time, volts)
        elif channel in (16, 17) and self.cr2 & TSVREFE and self.dma is not None:
            volts = TEMPERATURE_V if channel == 16 else REFERENCE_V
        else:
            raise SimulationError(f"{self.name} sequence names channel {channel}, which is not connected")
        if not volts == volts:
            raise SimulationError(f"ADC channel {channel} was driven with {volts} V")
        code = int(min(max(volts / FULL_SCALE_V, -1.0), 2.0) * 4096 + 4096.5) - 4096
        return min(max(code + (0 if self.calibrated else UNCALIBRATED_LSB), 0), 4095)

    def _update_line(self) -> None:
        self.machine.nvic.set_line(IRQ, any(adc.asks for adc in self.machine.converters))

    @property
    def asks(self) -> bool:
        """Whether it asks for the interrupt."""
        return bool(self.sr & EOC and self.cr1 & EOCIE)

    # Registers

    def write_sr(self, value: int) -> None:
        self.sr &= value
        self._update_line()

    def read_dr(self) -> int:
        self.sr &= ~EOC
        self._update_line()
        return self.dr

    def peek_dr(self) -> int:
        return self.dr

    def write_cr1(self, value: int) -> None:
        if value & 0x00CF_F8C0:
            raise SimulationError(f"{self.name}_CR1 = 0x{value:08X}: only EOCIE and SCAN are modelled")
        self.cr1 = value
        self._update_line()

    def write_cr2(self, value: int) -> None:
        if value & 0x1 << 15 | value & 1 << 21:
            raise SimulationError(f"{self.name}_CR2 = 0x{value:08X}: the injected group is not modelled")
        now = self.machine.now
        old = self.cr2
        self.cr2 = value & 0x009E_7903 | (old & (CAL | RSTCAL)) | value & (CAL | RSTCAL)
        if value & ADON and not old & ADON:
            self.ready_at = now + START_US * TICKS_PER_US
            self.calibrated = False
        elif not value & ADON:
            self.busy = False
            self.machine.timeline.cancel(self.events[0])
        if value & ~old & (CAL | RSTCAL):
            self._calibrate(now, bool(value & CAL), bool(old & ADON))
        elif value & ADON and old & ADON and not (value ^ old) & 0x009E_0902:
            self.trigger(now)  # writing ADON again, with nothing else changed, starts a conversion
        if value & SWSTART and value & EXTTRIG and (value >> 17) & 7 == EXTSEL_SWSTART:
            self.trigger(now)

    def _calibrate(self, now: int, start: bool, powered: bool) -> None:
        if not powered or now < self.ready_at:
            self.machine.warn(f"{self.name} calibration is asked for before the converter has powered up")
        if self.silent:
            return
        cycles = CALIBRATION_CYCLES if start else RESET_CALIBRATION_CYCLES

        def done(_time: int) -> None:
            self.cr2 &= ~(CAL | RSTCAL)
            self.calibrated = self.calibrated or (start and powered)

        self.machine.timeline.at(self.events[1], now + cycles * self.machine.rcc.adc_ticks, done)
