"""Interface of the simulated chip towards its parts, and through the chip to the other parts.

`plumb.f103.machine.Machine` builds the parts and knows them all. A part knows only these protocols: it imports neither
the machine nor a part that it only queries. What a peripheral offers to other parts beyond its registers is listed
here. Times are ticks of `timeline`; `..._ticks` is the length of a clock period.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from plumb.f103.core.probe import Probe
from plumb.f103.core.program_fault import ProgramFault
from plumb.f103.core.timeline import Timeline


class Variant(Protocol):
    """The part number of the chip."""

    @property
    def name(self) -> str: ...
    @property
    def flash_kib(self) -> int: ...
    @property
    def idcode(self) -> int: ...


class Core(Protocol):
    """The processor: its memories, and slices of instructions."""

    @property
    def flash(self) -> memoryview: ...
    @property
    def ram(self) -> memoryview: ...
    def read(self, address: int, size: int, /) -> bytes: ...
    def end_slice(self) -> None: ...
    def set_clock(self, hclk_ticks: int, wait_states: int, /) -> None: ...


class Interrupts(Protocol):
    """The NVIC. pending, enabled: a bit for each exception number. active: the innermost last."""

    pending: int
    enabled: int
    group_mask: int

    @property
    def active(self) -> Sequence[int]: ...
    @property
    def priority(self) -> list[int]: ...
    def set_line(self, interrupt: int, high: bool, /) -> None: ...
    def pend(self, number: int, /) -> None: ...
    def changed(self) -> None: ...
    def candidate(self) -> int: ...
    def enter(self, number: int, /) -> None: ...
    def leave(self) -> int: ...
    def group_priority(self, number: int, /) -> int: ...
    def execution_priority(self) -> int: ...


class SystemControl(Protocol):
    """The SCB, its registers."""

    ccr: int
    cfsr: int
    hfsr: int
    bfar: int
    scr: int
    vtor: int


class Clocks(Protocol):
    """RCC: its registers, and the periods of the clocks that it makes."""

    cr: int
    bdcr: int

    @property
    def hclk_ticks(self) -> int: ...
    @property
    def pclk1_ticks(self) -> int: ...
    @property
    def pclk2_ticks(self) -> int: ...
    @property
    def timer1_ticks(self) -> int: ...
    @property
    def adc_ticks(self) -> int: ...


class Clocked(Protocol):
    """Any peripheral, for RCC, which gives it its clock and resets it."""

    def reset(self) -> None: ...
    def switch_clock(self, on: bool, /) -> None: ...
    def clock_changing(self, now: int, /) -> None: ...
    def clock_changed(self, now: int, /) -> None: ...


class Peripherals(Protocol):
    """The bus, for RCC."""

    @property
    def peripherals(self) -> Sequence[Clocked]: ...


class DmaChannel(Protocol):
    """One channel, for the peripheral that owns it. served: the address of the peripheral's data register."""

    served: int
    settle: Callable[[], None]
    changed: Callable[[], None]
    ccr: int
    left: int
    done: int

    @property
    def ready(self) -> bool: ...
    def put(self, values: Sequence[int], /) -> int: ...
    def read_memory(self, units: int, /) -> bytes: ...
    def until_flag(self) -> int: ...


class DmaRequests(Protocol):
    """DMA1."""

    @property
    def channels(self) -> Sequence[DmaChannel]: ...
    def settle_before_reading(self, *numbers: int) -> None: ...


class Port(Protocol):
    """A GPIO port."""

    odr: int

    @property
    def outside(self) -> list[bool | None]: ...
    def read_idr(self) -> int: ...
    def mode(self, pin: int, /) -> int: ...
    def is_output(self, pin: int, /) -> bool: ...
    def is_alternate_output(self, pin: int, /) -> bool: ...
    def is_analog(self, pin: int, /) -> bool: ...


class Remapping(Protocol):
    """AFIO."""

    mapr: int

    @property
    def swj_cfg(self) -> int: ...
    def line_ports(self) -> list[int]: ...


class FlashControl(Protocol):
    """The flash controller. takes: whether it is unlocked for a write of that size."""

    acr: int

    def takes(self, size: int, /) -> bool: ...
    def program(self, address: int, value: int, /) -> None: ...


class PowerControl(Protocol):
    """PWR."""

    cr: int


class Trace(Protocol):
    """CoreDebug, which switches the cycle counter on."""

    demcr: int


class CycleCounter(Protocol):
    """DWT."""

    def settle(self) -> None: ...
    def restart(self) -> None: ...


class Converter(Protocol):
    """ADC1 or ADC2, for the timers that start it, and for the other one."""

    @property
    def asks(self) -> bool: ...
    def armed_for_timer(self) -> bool: ...
    def trigger(self, time: int, /) -> None: ...


class AnalogInputs(Protocol):
    """Voltages of the analog pins."""

    def sampled(self, pin: str, time_s: float, /) -> float: ...


class PulseTimer(Protocol):
    """TIM4, for the USART that shares its pin."""

    clocked: bool
    ccer: int


class BridgeTimer(Protocol):
    """TIM1, whose outputs stop when the clock fails."""

    def clock_failed(self) -> None: ...


class Watchdog(Protocol):
    """IWDG, which keeps the slow oscillator running."""

    @property
    def running(self) -> bool: ...


class BusLines(Protocol):
    """I2C1, which its bus tells of edges."""

    def lines_changed(self, scl: bool, sda: bool, /) -> None: ...


class Mcu(Protocol):
    """The chip, as its parts see it."""

    debugger_attached: bool

    @property
    def part(self) -> Variant: ...
    @property
    def chance(self) -> random.Random: ...
    @property
    def powered(self) -> bool: ...
    @property
    def warnings(self) -> Sequence[str]:
        """The texts passed to `warn` so far."""

    @property
    def timeline(self) -> Timeline: ...

    @property
    def cpu(self) -> Core: ...
    @property
    def nvic(self) -> Interrupts: ...
    @property
    def scb(self) -> SystemControl: ...
    @property
    def core_debug(self) -> Trace: ...
    @property
    def dwt(self) -> CycleCounter: ...

    @property
    def bus(self) -> Peripherals: ...
    @property
    def by_name(self) -> Mapping[str, Clocked]: ...
    @property
    def rcc(self) -> Clocks: ...
    @property
    def flash(self) -> FlashControl: ...
    @property
    def pwr(self) -> PowerControl: ...
    @property
    def dma(self) -> DmaRequests: ...
    @property
    def afio(self) -> Remapping: ...
    @property
    def ports(self) -> Sequence[Port]: ...
    @property
    def adc(self) -> AnalogInputs: ...
    @property
    def adc1(self) -> Converter: ...
    @property
    def converters(self) -> Sequence[Converter]: ...
    @property
    def tim1(self) -> BridgeTimer: ...
    @property
    def tim4(self) -> PulseTimer: ...
    @property
    def i2c1(self) -> BusLines: ...
    @property
    def iwdg(self) -> Watchdog: ...

    @property
    def probe(self) -> Probe | None: ...
    @property
    def now(self) -> int: ...
    def awake_ticks(self) -> int:
        """Time during which the core ran."""

    def request_reset(self, cause: str, /) -> None: ...
    def enter_rom(self) -> None: ...
    def power_cut(self) -> None: ...

    def port(self, pin: str, /) -> Port:
        """'PB6' -> port B."""

    def pin(self, pin: str, /) -> bool | None:
        """Level of a pin; None where it floats."""

    def pins_changed(self) -> None:
        """Tell the observers of levels that a pin may have changed."""

    def host_waits_no_more(self) -> None:
        """End the call that waits for the board to send: it has begun to send."""

    def warn(self, text: str, /) -> None:
        """Record that the firmware did something that silicon tolerates but that is wrong."""

    def program_faulted(self, fault: ProgramFault, /) -> None:
        """The program took a fault: note it, and end the run unless it is to go on."""

    def where(self) -> str:
        """Time and place in the program, for messages."""
