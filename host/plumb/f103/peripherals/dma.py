"""DMA1 (RM0008 chapter 13). A peripheral moves units through its channel in bursts, with the exact time of each unit;
bus arbitration takes no time. Enabling a channel whose requests are not modelled stops the simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.cpu import RAM_BASE

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

EN, TCIE, HTIE, TEIE, DIR, CIRC, PINC, MINC, MEM2MEM = 1, 2, 4, 8, 16, 32, 64, 128, 1 << 14
IRQ_CHANNEL1 = 11


def _registers() -> tuple[Register, ...]:
    rows = [Register("isr", 0x00, 0, 0), Register("ifcr", 0x04)]
    for i in range(7):
        rows += [
            Register(f"{name}{i + 1}", 8 + 20 * i + 4 * j) for j, name in enumerate(("ccr", "cndtr", "cpar", "cmar"))
        ]
    return tuple(rows)


class Channel:
    """One channel. `served`: address of the data register of the peripheral that owns the channel."""

    def __init__(self, dma: Dma, number: int) -> None:
        self.dma = dma
        self.number = number
        self.served = 0
        self.settle: Callable[[], None] = lambda: None
        self.changed: Callable[[], None] = lambda: None
        self.reset()

    def reset(self) -> None:
        self.ccr = self.left = self.reload = self.cpar = self.cmar = 0
        self.done = 0

    @property
    def enabled(self) -> bool:
        return bool(self.ccr & EN)

    @property
    def ready(self) -> bool:
        return bool(self.ccr & EN) and self.left > 0

    def until_flag(self) -> int:
        """Units until the next event that raises an interrupt or ends the transfer; 0: there is none."""
        half = self.left - (self.reload - self.reload // 2)
        if self.ccr & HTIE and half > 0:
            return half
        if self.ccr & TCIE or not self.ccr & CIRC:
            return self.left
        if self.ccr & HTIE:
            return self.left + self.reload // 2
        return 0

    def _advance(self, units: int) -> None:
        half = self.reload - self.reload // 2
        if self.left > half >= self.left - units:
            self.dma.flag(self, 4)
        self.left -= units
        self.done += units
        if self.left == 0:
            self.dma.flag(self, 2)
            if self.ccr & CIRC:
                self.left, self.done = self.reload, 0

    def _place(self, units: int, width: int) -> int | None:
        """Offset in RAM of the next `units`, or None after a transfer error."""
        address = self.cmar + (self.done * width if self.ccr & MINC else 0)
        offset = address - RAM_BASE
        if offset >= 0 and offset + units * width <= len(self.dma.machine.cpu.ram):
            return offset
        return None

    def _error(self) -> None:
        self.dma.machine.warn(f"DMA1 channel {self.number}: CMAR 0x{self.cmar:08X} does not lead to memory")
        self.ccr &= ~EN
        self.dma.flag(self, 8)

    def put(self, values: Sequence[int]) -> int:
        """Peripheral to memory; returns how many were taken (all, unless the channel stopped)."""
        width = 1 << ((self.ccr >> 10) & 3)
        taken = 0
        ram = self.dma.machine.cpu.ram
        while taken < len(values) and self.ready:
            units = min(len(values) - taken, self.left)
            offset = self._place(units, width)
            if offset is None:
                self._error()
                break
            part = values[taken : taken + units]
            if not self.ccr & MINC:
                part = part[-1:]
            if width == 1:
                ram[offset : offset + len(part)] = bytes(part)
            else:
                ram[offset : offset + width * len(part)] = b"".join(v.to_bytes(width, "little") for v in part)
            self._advance(units)
            taken += units
        return taken

    def read_memory(self, units: int) -> bytes:
        """Memory to an eight-bit peripheral: up to `units` bytes."""
        width = 1 << ((self.ccr >> 10) & 3)
        out = bytearray()
        while units > 0 and self.ready:
            count = min(units, self.left)
            address = self.cmar + (self.done * width if self.ccr & MINC else 0)
            span = count * width if self.ccr & MINC else width
            try:
                data = self.dma.machine.cpu.read(address, span)[::width]
            except SimulationError:
                self._error()
                break
            out += data if self.ccr & MINC else data * count
            self._advance(count)
            units -= count
        return bytes(out)


class Dma(Peripheral):
    REGISTERS = _registers()
    NARROW = "refuse"

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "DMA1", 0x40020000)
        self.channels = [Channel(self, i + 1) for i in range(7)]
        self.lazy: list[Channel] = []
        """Channels whose owner moves units only when its state is read."""
        self.flags = 0

    def settle_before_reading(self, *numbers: int) -> None:
        """Add channels, by index from 0, to `lazy`: their owner brings them up to date before a register is read."""
        self.lazy += [self.channels[number] for number in numbers]

    def reset(self) -> None:
        self.flags = 0
        for channel in self.channels:
            channel.reset()

    def flag(self, channel: Channel, bits: int) -> None:
        self.flags |= (bits | 1) << (4 * (channel.number - 1))
        self._update_line(channel)

    def _update_line(self, channel: Channel) -> None:
        active = self.flags >> (4 * (channel.number - 1)) & channel.ccr & 0xE
        self.machine.nvic.set_line(IRQ_CHANNEL1 + channel.number - 1, bool(active))

    def read_isr(self) -> int:
        for channel in self.lazy:
            channel.settle()
        return self.flags

    def write_ifcr(self, value: int) -> None:
        for channel in self.channels:
            group = value >> (4 * (channel.number - 1)) & 0xF
            if group:
                channel.settle()
                self.flags &= ~((0xF if group & 1 else group) << (4 * (channel.number - 1)))
                if not self.flags >> (4 * (channel.number - 1)) & 0xE:
                    self.flags &= ~(1 << (4 * (channel.number - 1)))
                self._update_line(channel)

    def write_isr(self, value: int) -> None:
        """Read-only: flags are cleared through IFCR."""

    def read_ifcr(self) -> int:
        return 0

    def plain_reader(self, register: Register) -> Callable[[], int]:
        kind, channel = register.name[:-1], self.channels[int(register.name[-1]) - 1]

        def read() -> int:
            channel.settle()
            return {"ccr": channel.ccr, "cndtr": channel.left, "cpar": channel.cpar, "cmar": channel.cmar}[kind]

        return read

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        kind, channel = register.name[:-1], self.channels[int(register.name[-1]) - 1]

        def write(value: int) -> None:
            channel.settle()
            if kind == "ccr":
                self._write_ccr(channel, value & 0x7FFF)
            elif channel.ccr & EN:
                self.machine.warn(f"DMA1_{register.name.upper()} is written while the channel is enabled; ignored")
            elif kind == "cndtr":
                channel.left = channel.reload = value & 0xFFFF
                channel.done = 0
            elif kind == "cpar":
                channel.cpar = value
            else:
                channel.cmar = value

        return write

    def _write_ccr(self, channel: Channel, value: int) -> None:
        starts = value & EN and not channel.ccr & EN
        channel.ccr = value
        if starts:
            if not channel.served or value & MEM2MEM:
                raise SimulationError(f"DMA1 channel {channel.number} is enabled: its requests are not modelled")
            if channel.cpar != channel.served:
                raise SimulationError(
                    f"DMA1 channel {channel.number}: CPAR is 0x{channel.cpar:08X}, its modelled request "
                    f"comes from 0x{channel.served:08X}"
                )
            # Enabling starts again at CMAR, with the count that is left.
            channel.done = 0
            channel.reload = channel.left
        self._update_line(channel)
        channel.changed()
