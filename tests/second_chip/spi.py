"""SPI1 as a master with DMA both ways (RM0008 25.3, 25.5). Nothing is on its bus: the input is pulled up."""

from __future__ import annotations

from typing import ClassVar

from second_chip.block import Block, Layout

RXNE, TXE = 1, 2


class Spi(Block):
    LAYOUT: ClassVar[Layout] = {
        0x00: ("CR1", 0, 0xFFFF),
        0x04: ("CR2", 0, 0xE7),
        0x08: ("SR", 0x2, 0),
        0x0C: ("DR", 0, 0),
    }
    CLOCK = ("APB2ENR", 12)

    def feed(self) -> None:
        while self.value["CR1"] & 0x40 and self.value["CR2"] & 2 and self.value["SR"] & TXE:
            if not self.chip.dma.request(3):
                break

    def write_DR(self, value: int) -> None:
        self.value["SR"] &= ~TXE
        bits = 8 * (2 << self.bit("CR1", 3, 3))
        self.chip.after(bits * self.chip.rcc.pclk2(), self._exchanged)

    def _exchanged(self) -> None:
        self.value["DR"] = 0xFF
        self.value["SR"] |= RXNE | TXE
        if self.value["CR2"] & 1:
            self.chip.dma.request(2)
        self.feed()

    def read_DR(self) -> int:
        self.value["SR"] &= ~RXNE
        return self.value["DR"]
