"""DMA1, USART1 and USART3 (RM0008 13.3 to 13.4, 27.3 and 27.6)."""

from __future__ import annotations

from collections import deque
from typing import ClassVar

from second_chip.block import Block, Layout
from second_chip.clocks import UNITS_HZ

FRAME_BITS = 10
CHANNEL_1_IRQ, USART1_IRQ, USART3_IRQ = 11, 37, 39
TC, HT = 2, 4
"""Of a channel's four flags; bit 0 says that there is one."""
PE, FE, NE, ORE, IDLE, RXNE, TXDONE, TXE = (1 << n for n in range(8))


class Dma(Block):
    """Seven channels, 1 to 7. A peripheral asks with request(channel), for one transfer at a time."""

    LAYOUT: ClassVar[Layout] = {0x00: ("ISR", 0, 0), 0x04: ("IFCR", 0, 0)} | {
        0x08 + 20 * (n - 1) + 4 * i: (f"{name}{n}", 0, mask)
        for n in range(1, 8)
        for i, (name, mask) in enumerate(
            (("CCR", 0x7FFF), ("CNDTR", 0xFFFF), ("CPAR", 0xFFFFFFFF), ("CMAR", 0xFFFFFFFF))
        )
    }
    CLOCK = ("AHBENR", 0)

    def reset(self) -> None:
        super().reset()
        self.length = [0] * 8
        self.done = [0] * 8

    def write(self, offset: int, value: int) -> None:
        channel, register = (offset - 8) // 20 + 1, (offset - 8) % 20
        if offset < 8 or not self.clocked():
            super().write(offset, value)
            return
        before = self.value[f"CCR{channel}"]
        if register != 0 and before & 1:
            return  # protected while the channel is on
        super().write(offset, value)
        if register == 0:
            if value & 1 and not before & 1:
                self.length[channel], self.done[channel] = self.value[f"CNDTR{channel}"], 0
                feed = {3: self.chip.spi.feed, 4: self.chip.uart.feed}.get(channel)
                if feed is not None:
                    feed()
            self._raise(channel)

    def write_IFCR(self, value: int) -> None:
        for channel in range(1, 8):
            clear = value >> 4 * (channel - 1) & 15
            flags = self.value["ISR"] >> 4 * (channel - 1) & 14
            flags = 0 if clear & 1 else flags & ~clear
            self._set(channel, flags)

    def _set(self, channel: int, flags: int) -> None:
        shift = 4 * (channel - 1)
        self.value["ISR"] = self.value["ISR"] & ~(15 << shift) | (flags | (flags != 0)) << shift
        self._raise(channel)

    def _raise(self, channel: int) -> None:
        flags = self.value["ISR"] >> 4 * (channel - 1) & 14
        self.chip.nvic.line(CHANNEL_1_IRQ + channel - 1, flags & self.value[f"CCR{channel}"] & 14 != 0)

    def left(self, channel: int) -> int:
        """Transfers until the channel ends, 0 where it is off."""
        return self.value[f"CNDTR{channel}"] if self.value[f"CCR{channel}"] & 1 else 0

    def request(self, channel: int) -> bool:
        """One transfer; False when the channel is off or has ended."""
        control = self.value[f"CCR{channel}"]
        if not self.left(channel):
            return False
        sizes = (1, 2, 4)[control >> 8 & 3], (1, 2, 4)[control >> 10 & 3]
        done = self.done[channel]
        peripheral = self.value[f"CPAR{channel}"] + (done * sizes[0] if control & 0x40 else 0)
        memory = self.value[f"CMAR{channel}"] + (done * sizes[1] if control & 0x80 else 0)
        self.done[channel] += 1
        self.value[f"CNDTR{channel}"] -= 1
        left = self.value[f"CNDTR{channel}"]
        if control & 0x10:
            self.chip.store(peripheral, sizes[0], self.chip.load(memory, sizes[1]))
        else:
            self.chip.store(memory, sizes[1], self.chip.load(peripheral, sizes[0]))
        flags = self.value["ISR"] >> 4 * (channel - 1) & 14
        if self.done[channel] == self.length[channel] // 2:
            flags |= HT
        if left == 0:
            flags |= TC
            if control & 0x20:
                self.value[f"CNDTR{channel}"], self.done[channel] = self.length[channel], 0
        self._set(channel, flags)
        return True


class Usart(Block):
    LAYOUT: ClassVar[Layout] = {
        0x00: ("SR", 0xC0, 0),
        0x04: ("DR", 0, 0),
        0x08: ("BRR", 0, 0xFFFF),
        0x0C: ("CR1", 0, 0x3FFF),
        0x10: ("CR2", 0, 0x7F6F),
        0x14: ("CR3", 0, 0x7FF),
    }
    CLOCK = ("APB2ENR", 14)
    IRQ = USART1_IRQ
    LINE_BAUD = 921600
    """Of the other end."""
    RECEIVES: int | None = 5
    SENDS: int | None = 4
    """Channels of the DMA."""

    def bus_clock(self) -> int:
        """Period of the clock of its bus."""
        return self.chip.rcc.pclk2()

    def reset(self) -> None:
        if not self.value:
            self.sent = bytearray()
            """What came out of the pin and nobody has read yet."""
            self._line: deque[int] = deque()
        super().reset()
        self._data: int | None = None
        self._shifting: int | None = None
        self._received = 0
        self._status_read = False
        self._silence = 0

    # ---- the line from the host ----

    def put(self, data: bytes) -> None:
        idle = not self._line
        self._line.extend(data)
        if idle and data:
            self._next_byte()

    def listen_again(self) -> None:
        if self._line:
            self._next_byte()

    def _next_byte(self) -> None:
        self._silence += 1
        self.chip.after(FRAME_BITS * UNITS_HZ // self.LINE_BAUD, self._arrived)

    def _arrived(self) -> None:
        self._receive(self._line.popleft())
        silence = self._silence
        if self._line:
            self._next_byte()
        else:
            self.chip.after(FRAME_BITS * UNITS_HZ // self.LINE_BAUD, lambda: self._idle(silence))

    def _pins(self) -> tuple[tuple[str, int], tuple[str, int]]:
        remapped = self.chip.afio.bit("MAPR", 2)
        return (("B", 6), ("B", 7)) if remapped else (("A", 9), ("A", 10))

    def _receives(self) -> bool:
        port, pin = self._pins()[1]
        return self.value["CR1"] & 0x2004 == 0x2004 and self.chip.ports[port].input(pin)

    def _receive(self, byte: int) -> None:
        if not self._receives():
            return
        bit = self.value["BRR"] * self.bus_clock()
        good = abs(bit * self.LINE_BAUD / UNITS_HZ - 1) < 0.03
        if self.value["SR"] & RXNE:
            self.value["SR"] |= ORE
        else:
            self._received = byte if good else byte ^ 0xFF
            self.value["SR"] |= RXNE | (0 if good else FE)
            if self.value["CR3"] & 1 << 6 and self.RECEIVES:
                self.chip.dma.request(self.RECEIVES)
        self._raise()

    def _idle(self, silence: int) -> None:
        if silence == self._silence and self._receives():
            self.value["SR"] |= IDLE
            self._raise()

    # ---- registers ----

    def _raise(self) -> None:
        status, control = self.value["SR"], self.value["CR1"]
        wanted = control & (IDLE | RXNE | TXDONE | TXE)
        high = status & wanted or (control & RXNE and status & ORE)
        errors = self.value["CR3"] & 1 and self.value["CR3"] & 1 << 6 and status & (FE | NE | ORE)
        self.chip.nvic.line(self.IRQ, bool(high or errors))

    def read_SR(self) -> int:
        self._status_read = True
        return self.value["SR"]

    def write_SR(self, value: int) -> None:
        self.value["SR"] &= value | ~(TXDONE | RXNE)
        self._raise()

    def read_DR(self) -> int:
        self.value["SR"] &= ~RXNE
        if self._status_read:
            self.value["SR"] &= ~(IDLE | ORE | NE | FE | PE)
            self._status_read = False
        self._raise()
        return self._received

    def write_CR1(self, value: int) -> None:
        self.value["CR1"] = value & 0x3FFF
        self.feed()
        self._raise()

    def write_CR3(self, value: int) -> None:
        self.value["CR3"] = value & 0x7FF
        self.feed()
        self._raise()

    def write_DR(self, value: int) -> None:
        self._data = value & 0xFF
        self.value["SR"] &= ~(TXE | TXDONE)
        self._shift()

    def feed(self) -> None:
        while self.value["CR1"] & 0x2008 == 0x2008 and self.value["SR"] & TXE and self.value["CR3"] & 1 << 7:
            if not self.SENDS or not self.chip.dma.request(self.SENDS):
                break

    def _shift(self) -> None:
        if self._shifting is None and self._data is not None:
            self._shifting, self._data = self._data, None
            self.value["SR"] |= TXE
            self.chip.after(FRAME_BITS * self.value["BRR"] * self.bus_clock(), self._shifted)
        self._raise()

    def _shifted(self) -> None:
        port, pin = self._pins()[0]
        assert self._shifting is not None
        if self.chip.ports[port].alternate(pin):
            self.sent.append(self._shifting)
        self._shifting = None
        if self._data is None:
            self.value["SR"] |= TXDONE
        self._shift()
        self.feed()


class Usart3(Usart):
    """Not remapped. Its DMA channels, 2 and 3, are left to SPI1 here."""

    CLOCK = ("APB1ENR", 18)
    IRQ = USART3_IRQ
    LINE_BAUD = 420000
    RECEIVES = SENDS = None

    def bus_clock(self) -> int:
        return self.chip.rcc.pclk1()

    def _pins(self) -> tuple[tuple[str, int], tuple[str, int]]:
        return ("B", 10), ("B", 11)
