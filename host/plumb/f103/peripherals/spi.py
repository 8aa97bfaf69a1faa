"""SPI1 as master, eight bits, full duplex, by DMA or by hand (RM0008 chapter 25), and the chips behind select pins.

Not modelled: slave, 16 bits, one-way modes, CRC, I2S, hardware NSS, the receive and transmit interrupts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_US

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

MSTR, SPE, SSI, SSM = 1 << 2, 1 << 6, 1 << 8, 1 << 9
MODE = 3
"""CPOL and CPHA."""
RXDMAEN, TXDMAEN = 1, 2
RXNE, TXE, OVR, BSY = 1, 2, 64, 128


class Device(Protocol):
    """A chip with a select line."""

    SPI_MHZ: float
    """Highest clock that the chip accepts."""

    def select(self) -> None: ...

    def exchange(self, byte: int, now: int) -> int:
        """The chip receives `byte`; the byte that it sends at the same time."""

    def deselect(self) -> None: ...

    def brown_out(self) -> None:
        """The supply of the chip was interrupted."""


class Spi(Peripheral):
    REGISTERS = (
        Register("cr1", 0x00),
        Register("cr2", 0x04, 0, 0xE7),
        Register("sr", 0x08, 2),
        Register("dr", 0x0C),
    )
    cr1: int
    cr2: int
    sr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "SPI1", 0x40013000)
        self.rx_dma, self.tx_dma = machine.dma.channels[1], machine.dma.channels[2]
        self.rx_dma.served = self.tx_dma.served = self.base + 0x0C
        self.tx_dma.changed, self.rx_dma.changed = self._go_on, self._hand_over
        self.devices: dict[int, Device] = {}
        """Chips by the pin of port A that selects them, active low."""
        self.selected: Device | None = None
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.machine.timeline.cancel("spi")
        self.shifting: int | None = None
        self.waiting: int | None = None
        self.received = 0
        self.dr_read = False

    def pins_changed(self) -> None:
        """Port A was written: update which chip is selected."""
        port = self.machine.ports[0]
        low = [d for pin, d in self.devices.items() if port.is_output(pin) and not port.odr >> pin & 1]
        chosen = low[0] if low else None
        if chosen is not self.selected:
            if self.selected is not None:
                self.selected.deselect()
            self.selected = chosen
            if chosen is not None:
                chosen.select()

    def _byte_ticks(self) -> int:
        return 8 * (2 << (self.cr1 >> 3 & 7)) * self.machine.rcc.pclk2_ticks

    def _go_on(self) -> None:
        """Start the next byte if one waits and none is on the line."""
        if not self.cr1 & SPE or self.shifting is not None:
            return
        if self.waiting is not None:
            self.shifting, self.waiting = self.waiting, None
        elif self.cr2 & TXDMAEN and self.tx_dma.ready:
            self.shifting = self.tx_dma.read_memory(1)[0]
        else:
            return
        self.sr |= TXE | BSY
        self.machine.timeline.at("spi", self.machine.now + self._byte_ticks(), self._shifted)

    def _shifted(self, time: int) -> None:
        assert self.shifting is not None
        answer = 0xFF
        mhz = 8 * TICKS_PER_US / self._byte_ticks()
        if self.selected is not None and mhz > self.selected.SPI_MHZ:
            self.machine.warn(f"SPI1 runs at {mhz:g} MHz; the chip takes {self.selected.SPI_MHZ:g}")
        if self.selected is not None and self.cr1 & MODE == MODE:
            answer = self.selected.exchange(self.shifting, time)
        elif self.selected is not None:
            self.machine.warn(f"SPI1 has CPOL, CPHA = {self.cr1 >> 1 & 1}, {self.cr1 & 1}; the chips need 1, 1")
        if self.machine.probe is not None:
            self.machine.probe.spi(time, self._byte_ticks(), self.shifting, answer)
        self.shifting = None
        self.sr &= ~BSY
        if self.sr & (RXNE | OVR):
            self.sr |= OVR  # this byte is lost, and all that follow until OVR is cleared
        else:
            self.sr |= RXNE
            self.received = answer
        self._hand_over()
        self._go_on()

    def _hand_over(self) -> None:
        """Pass the byte in DR to the DMA if its channel is enabled."""
        if self.sr & RXNE and self.cr2 & RXDMAEN and self.rx_dma.put([self.received]):
            self.sr &= ~RXNE

    def write_cr1(self, value: int) -> None:
        wanted = MSTR | SSM | SSI
        if (value & SPE and value & wanted != wanted) or value & 0xEC80:
            raise SimulationError(f"SPI1_CR1 = 0x{value:04X}: only a software-selected 8-bit master is modelled")
        self.cr1 = value & 0xFFFF
        self._go_on()

    def write_cr2(self, value: int) -> None:
        if value & ~(RXDMAEN | TXDMAEN):
            raise SimulationError(f"SPI1_CR2 = 0x{value:02X}: only its DMA requests are modelled")
        self.cr2 = value
        self._hand_over()
        self._go_on()

    def read_sr(self) -> int:
        value = self.sr
        if self.dr_read:
            self.sr &= ~OVR
        self.dr_read = False
        return value

    def peek_sr(self) -> int:
        return self.sr

    def write_sr(self, value: int) -> None:
        """Writes have no effect: the modelled bits are read-only."""

    def read_dr(self) -> int:
        self.sr &= ~RXNE
        self.dr_read = True
        return self.received

    def peek_dr(self) -> int:
        return self.received

    def write_dr(self, value: int) -> None:
        self.waiting = value & 0xFF
        self.sr &= ~TXE
        self._go_on()
