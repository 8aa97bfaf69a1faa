"""USART1 to USART3 (RM0008 chapter 27), each with its line in both directions, byte times from BRR, by polling or
interrupt, USART1 by DMA, too.

Bytes on DMA are moved in bursts: every access to the state (a status register, CNDTR, an event, the host) first brings
it up to date. Not modelled: parity, half duplex, synchronous, LIN, smartcard and IrDA modes, flow control, mute.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from plumb.f103.core.mcu import DmaChannel, Mcu

PE, FE, NE, ORE, IDLE, RXNE, TC, TXE = 1, 2, 4, 8, 16, 32, 64, 128
RE, TE, IDLEIE, RXNEIE, TCIE, TXEIE, PEIE, M9, UE = 4, 8, 16, 32, 64, 128, 256, 1 << 12, 1 << 13
EIE, DMAR, DMAT = 1, 64, 128
BAUD_TOLERANCE = 0.035
"""Relative difference of the two baud rates beyond which a receiver samples wrong bits (ten-bit frames, 16x
sampling)."""


@dataclass
class Burst:
    """Bytes back to back on the line; the first is complete at `start + byte_ticks`."""

    start: int
    byte_ticks: int
    data: bytes
    errors: int = 0
    used: int = 0

    def complete(self, now: int) -> int:
        """Number of bytes that have arrived and were not used yet."""
        return max(0, min((now - self.start) // self.byte_ticks, len(self.data)) - self.used)

    @property
    def end(self) -> int:
        return self.start + self.byte_ticks * len(self.data)


class NoDma:
    """In place of a DMA channel where none is modelled: it is never ready."""

    ready, left = False, 0

    def put(self, values: Sequence[int]) -> int:
        return 0

    def read_memory(self, units: int) -> bytes:
        return b""

    def until_flag(self) -> int:
        return 0


class Usart(Peripheral, ABC):
    """A USART. host_baud: of the other end of its line."""

    REGISTERS = (
        Register("sr", 0x00, 0x00C0),
        Register("dr", 0x04),
        Register("brr", 0x08, 0, 0xFFFF),
        Register("cr1", 0x0C, 0, 0x3FFF),
        Register("cr2", 0x10, 0, 0x7F7F),
        Register("cr3", 0x14, 0, 0x07FF),
        Register("gtpr", 0x18, 0, 0xFFFF),
    )
    brr: int
    cr1: int
    cr2: int
    cr3: int

    CR3 = EIE
    """The bits of CR3 that are modelled."""
    TRACED = True
    """A probe records its lines."""

    def __init__(self, machine: Mcu, name: str, base: int, interrupt: int) -> None:
        super().__init__(machine, name, base)
        self.interrupt = interrupt
        self.host_baud = 921600
        self.tx_dma: DmaChannel | NoDma = NoDma()
        self.rx_dma: DmaChannel | NoDma = NoDma()
        self.to_host: deque[Burst] = deque()
        self.from_host: deque[Burst] = deque()
        self.host_line_free = 0

    def reset(self) -> None:
        super().reset()
        self._cut_off(self.machine.now)
        self._set_byte_time()
        self.tx_free = 0  # when the shift register and TDR will both be empty
        self.tc, self.sending = True, False
        self.rx_flags = 0
        self.rdr = 0
        self.flags_read = 0
        self.idle_at = 0  # when the line will have been idle for a frame; 0: IDLE was already signalled
        self.tx_dma_from = 0
        for what in ("tx", "tc", "rx"):
            self.machine.timeline.cancel(self._event(what))

    def _event(self, what: str) -> str:
        """Name of an event of this USART in the timeline."""
        return f"{self.name} {what}"

    @property
    def _bus_ticks(self) -> int:
        """Period of the clock of its bus: APB2 for USART1, else APB1."""
        return self.machine.rcc.pclk2_ticks if self.name == "USART1" else self.machine.rcc.pclk1_ticks

    @abstractmethod
    def _pins(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Port and pin of the transmitter, and of the receiver."""

    def _cut_off(self, now: int) -> None:
        """Drop the bytes that have not reached the host by now."""
        for burst in self.to_host:
            burst.data = burst.data[: burst.used + burst.complete(now)]

    # Time on the line

    def _set_byte_time(self) -> None:
        bits = 10 + bool(self.cr1 & M9) + (self.cr2 >> 12 & 3 == 2)
        self.byte_ticks = bits * max(self.brr, 1) * self._bus_ticks

    @property
    def baud(self) -> float:
        """Baud rate that the program set; 0.0 before it wrote BRR."""
        return TICKS_PER_S / (self.brr * self._bus_ticks) if self.brr else 0.0

    def _heard(self, data: bytes) -> tuple[bytes, int]:
        """Bytes as the other end receives them, garbled when the two baud rates differ, and the receiver's error
        flags."""
        if abs(self.baud - self.host_baud) <= BAUD_TOLERANCE * self.host_baud:
            return data, 0
        return bytes((0xA5 ^ byte << 1) & 0xFF for byte in data), FE

    def _pin_works(self) -> bool:
        port, pin = self._pins()[0]
        works = self.machine.ports[port].is_alternate_output(pin)
        if not works:
            self.machine.warn(f"{self.name} sends, but P{'ABCDE'[port]}{pin} is not an alternate-function output")
        return works

    def _hears(self) -> bool:
        port, pin = self._pins()[1]
        return self.cr1 & (UE | RE) == UE | RE and not self.machine.ports[port].is_output(pin)

    # Transmitter

    def _send(self, data: bytes, at: int) -> None:
        start = max(self.tx_free, at)
        self.tx_free = start + len(data) * self.byte_ticks
        self.tc, self.sending = False, True
        if self._pin_works():
            if self.machine.probe is not None and self.TRACED:
                self.machine.probe.uart("TX", start, self.byte_ticks, data)
            self.to_host.append(Burst(start, self.byte_ticks, self._heard(data)[0]))
            self.machine.host_waits_no_more()

    def _tx_on(self) -> bool:
        return self.cr1 & (UE | TE) == UE | TE

    def _settle_tx(self, now: int) -> None:
        """Let the DMA feed TDR up to now: one byte at once when the line is free, then one per byte time."""
        channel = self.tx_dma
        if not self.sending and not channel.left:
            return
        while self.cr3 & DMAT and channel.ready and self._tx_on():
            byte_ticks = self.byte_ticks
            first = max(self.tx_dma_from, self.tx_free - byte_ticks)
            if first > now:
                break
            start = max(self.tx_free, first)
            count = 1 + (now - start) // byte_ticks + 1 if now >= start else 1
            data = channel.read_memory(count)
            if not data:
                break
            self._send(data, first)
        if self.sending and self.tx_free <= now:
            self.tc, self.sending = True, False

    def _plan_tx(self) -> None:
        timeline, channel = self.machine.timeline, self.tx_dma
        if self.cr3 & DMAT and channel.ready and self._tx_on():
            units = channel.until_flag()
            start = max(self.tx_free, self.tx_dma_from)
            # The last unit moves into TDR when the shift register takes the one before it.
            last = start + (units - 2) * self.byte_ticks if units > 1 else start - self.byte_ticks
            timeline.at(self._event("tx"), max(last, self.tx_dma_from, self.tx_free - self.byte_ticks), self._on_event)
            self.machine.host_waits_no_more()
        elif self.cr1 & TXEIE and self.tx_free - self.byte_ticks > self.machine.now:
            timeline.at(self._event("tx"), self.tx_free - self.byte_ticks, self._on_event)
        else:
            timeline.cancel(self._event("tx"))
        if self.cr1 & TCIE and self.sending:
            timeline.at(self._event("tc"), self.tx_free, self._on_event)
        else:
            timeline.cancel(self._event("tc"))

    def settle(self, now: int) -> None:
        """Bring the transmitter up to date."""
        self._settle_tx(now)

    def bytes_out(self, now: int) -> bytes:
        """The bytes that have reached the host since the last call."""
        self._settle_tx(now)
        out = bytearray()
        while self.to_host:
            burst = self.to_host[0]
            count = burst.complete(now)
            out += burst.data[burst.used : burst.used + count]
            burst.used += count
            if burst.used < len(burst.data):
                break
            self.to_host.popleft()
        return bytes(out)

    def time_of_byte(self, count: int) -> int | None:
        """Time at which the host will have `count` more bytes, or all that are on the line; None: there are none."""
        remaining = count
        end = None
        for burst in self.to_host:
            left = len(burst.data) - burst.used
            if left >= remaining:
                return burst.start + (burst.used + remaining) * burst.byte_ticks
            remaining -= left
            end = burst.end
        if self.cr3 & DMAT and self.tx_dma.ready and self._tx_on():
            end = max(self.tx_free, self.tx_dma_from) + min(remaining, self.tx_dma.left) * self.byte_ticks
        return end

    # Receiver

    def receive(self, data: bytes, errors: int = 0) -> None:
        """The host sends bytes, as soon as its line is free."""
        now = self.machine.now
        byte_ticks = 10 * TICKS_PER_S // self.host_baud
        start = max(self.host_line_free, now)
        self.host_line_free = start + byte_ticks * len(data)
        if self.machine.powered and data:
            if self.machine.probe is not None and self.TRACED:
                self.machine.probe.uart("RX", start, byte_ticks, data)
            data, garbled = self._heard(data)
            self.from_host.append(Burst(start, byte_ticks, data, errors | garbled))
            self._plan()

    def _settle_rx(self, now: int) -> None:
        while self.from_host:
            burst = self.from_host[0]
            count = burst.complete(now)
            if count:
                self._take_in(burst, count)
            if burst.used < len(burst.data):
                break
            self.from_host.popleft()
        if self.idle_at and now >= self.idle_at and not (self.from_host and self.from_host[0].start < self.idle_at):
            self.rx_flags |= IDLE
            self.idle_at = 0

    def _take_in(self, burst: Burst, count: int) -> None:
        data = burst.data[burst.used : burst.used + count]
        if self.idle_at and burst.used == 0 and burst.start >= self.idle_at:
            self.rx_flags |= IDLE
        burst.used += count
        if not self._hears():
            return
        self.idle_at = burst.start + burst.used * burst.byte_ticks + self.byte_ticks
        self.rx_flags |= burst.errors
        if burst.errors & ORE:
            return  # fault injection: lost
        if self.cr3 & DMAR and not self.rx_flags & RXNE:
            data = data[self.rx_dma.put(data) :]
        for byte in data:  # the bytes that the DMA did not take
            if self.rx_flags & RXNE:
                self.rx_flags |= ORE
            else:
                self.rdr = byte
                self.rx_flags |= RXNE

    def _fetch_waiting(self) -> None:
        """The DMA was switched on: give it a byte that already waits in RDR."""
        if self.cr3 & DMAR and self.rx_flags & RXNE and self.rx_dma.put([self.rdr]):
            self.rx_flags &= ~RXNE

    def _plan_rx(self) -> None:
        """Plan an event at the next time at which the receiver may raise an interrupt."""
        times = []
        if self.from_host:
            burst = self.from_host[0]
            if self.cr3 & DMAR and self.rx_dma.ready:
                units = self.rx_dma.until_flag()
                if burst.errors and self.cr3 & EIE:
                    units = 1
                if units and units <= len(burst.data) - burst.used:
                    times.append(burst.start + (burst.used + units) * burst.byte_ticks)
                else:
                    times.append(burst.end)
            else:
                times.append(burst.start + (burst.used + 1) * burst.byte_ticks)
        if self.idle_at and self.cr1 & IDLEIE and not (self.from_host and self.from_host[0].start < self.idle_at):
            times.append(self.idle_at)
        if times:
            self.machine.timeline.at(self._event("rx"), min(times), self._on_event)
        else:
            self.machine.timeline.cancel(self._event("rx"))

    # Both

    def _settle_tx_now(self) -> None:
        self._settle_tx(self.machine.now)

    def _settle_rx_now(self) -> None:
        self._settle_rx(self.machine.now)

    def _on_event(self, time: int) -> None:
        self._settle_tx(time)
        self._settle_rx(time)
        self._plan()

    def _restart_dma(self) -> None:
        """Plan anew after a channel or a control register has changed; both lines are up to date."""
        self.tx_dma_from = self.machine.now
        self._fetch_waiting()
        self._plan()

    def _plan(self) -> None:
        self._plan_tx()
        self._plan_rx()
        self._update_line()

    def _update_line(self) -> None:
        status = self._status()
        request = (
            status & self.cr1 & (IDLE | RXNE | TC | TXE)
            or (status & ORE and self.cr1 & RXNEIE)
            or (status & (FE | NE | ORE) and self.cr3 & EIE and self.cr3 & DMAR)
        )
        self.machine.nvic.set_line(self.interrupt, bool(request) and bool(self.cr1 & UE))

    def _status(self) -> int:
        status = self.rx_flags | (TC if self.tc else 0)
        empty = self.tx_free - self.byte_ticks <= self.machine.now
        fed = self.cr3 & DMAT and self.tx_dma.ready
        return status | (TXE if empty and not fed else 0)

    def clock_changing(self, now: int) -> None:
        self._settle_tx(now)
        self._settle_rx(now)

    def clock_changed(self, now: int) -> None:
        self._set_byte_time()
        self._plan()

    # Registers

    def read_sr(self) -> int:
        now = self.machine.now
        self._settle_tx(now)
        self._settle_rx(now)
        self.flags_read = self._status()
        self._plan()
        return self.flags_read

    def peek_sr(self) -> int:
        return self._status()

    def write_sr(self, value: int) -> None:
        self._settle_tx_now()
        self._settle_rx_now()
        self.tc &= bool(value & TC)
        self.rx_flags &= value | ~RXNE
        self._plan()

    def read_dr(self) -> int:
        """Reading DR after SR clears the flags that were read in SR, and removes the byte."""
        self._settle_rx_now()
        self.rx_flags &= ~(self.flags_read & (PE | FE | NE | ORE | IDLE) | RXNE)
        self.flags_read = 0
        self._plan()
        return self.rdr

    def peek_dr(self) -> int:
        return self.rdr

    def write_dr(self, value: int) -> None:
        now = self.machine.now
        self._settle_tx(now)
        if self._tx_on():
            if self.tx_free - self.byte_ticks > now:
                self.machine.warn(f"{self.name}_DR is written while TXE is 0; the byte is lost")
            else:
                self._send(bytes([value & 0xFF]), now)
        self._plan()

    def _configure(self, name: str, value: int) -> None:
        self._settle_tx_now()
        self._settle_rx_now()
        setattr(self, name, value)
        self._set_byte_time()
        self._restart_dma()

    def write_brr(self, value: int) -> None:
        if self.cr1 & UE and value < 16:
            raise SimulationError(f"{self.name}_BRR = {value}: a divider below 16 does not work")
        self._configure("brr", value & 0xFFFF)

    def write_cr1(self, value: int) -> None:
        if value & (1 << 10 | 1 << 1 | 1):
            raise SimulationError(f"{self.name}_CR1 = 0x{value:04X}: parity, mute mode and break are not modelled")
        if value & UE and self.brr < 16:
            raise SimulationError(f"{self.name} is enabled with BRR = {self.brr}: a divider below 16 does not work")
        self._configure("cr1", value & 0x3FFF)

    def write_cr2(self, value: int) -> None:
        if value & 0x4F60:
            raise SimulationError(f"{self.name}_CR2 = 0x{value:04X}: LIN and synchronous modes are not modelled")
        self._configure("cr2", value & 0x7F7F)

    def write_cr3(self, value: int) -> None:
        if value & ~self.CR3:
            raise SimulationError(f"{self.name}_CR3 = 0x{value:04X}: only DMA and the error interrupt are modelled")
        self._configure("cr3", value & 0x07FF)


class Usart1(Usart):
    """USART1, with its two DMA channels."""

    CR3 = EIE | DMAR | DMAT

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "USART1", 0x40013800, 37)
        channels = machine.dma.channels[3], machine.dma.channels[4]
        for channel, settle in zip(channels, (self._settle_tx_now, self._settle_rx_now), strict=True):
            channel.served = self.base + 4
            channel.settle, channel.changed = settle, self._restart_dma
        self.tx_dma, self.rx_dma = channels
        machine.dma.settle_before_reading(3, 4)
        self.reset()

    def _pins(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return ((1, 6), (1, 7)) if self.machine.afio.mapr & 4 else ((0, 9), (0, 10))

    def _pin_works(self) -> bool:
        port, _ = self._pins()[0]
        if port == 1 and not self.machine.afio.mapr & 2:
            self.machine.warn("USART1 is remapped while I2C1 is not: it does not come out of PB6")
            return False
        tim4 = self.machine.tim4
        if port == 1 and tim4.clocked and tim4.ccer & 1:
            self.machine.warn("USART1 and channel 1 of TIM4 are both switched to PB6")
        return super()._pin_works()


class Usart2(Usart):
    """USART2 on PA2 and PA3, or PD5 and PD6; its DMA channels are not modelled."""

    TRACED = False

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "USART2", 0x40004400, 38)
        self.reset()

    def _pins(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return ((3, 5), (3, 6)) if self.machine.afio.mapr & 1 << 3 else ((0, 2), (0, 3))


class Usart3(Usart):
    """USART3 on PB10 and PB11, where it is not remapped; its DMA channels are not modelled."""

    TRACED = False

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "USART3", 0x40004800, 39)
        self.host_baud = 420000
        self.reset()

    def _pins(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return (1, 10), (1, 11)

    def _hears(self) -> bool:
        return super()._hears() and not self.machine.afio.mapr & 3 << 4
