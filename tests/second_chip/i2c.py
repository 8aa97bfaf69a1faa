"""I2C1 as a master (RM0008 26.3.3, 26.6), and two sensors of the bus."""

from __future__ import annotations

from typing import ClassVar, Protocol

from second_chip.block import Block, Layout

EVENT_IRQ, ERROR_IRQ = 31, 32
SB, ADDR, BTF, RXNE, TXE, AF = 1, 2, 4, 1 << 6, 1 << 7, 1 << 10
START, STOP, ACK, SWRST = 1 << 8, 1 << 9, 1 << 10, 1 << 15
BYTE_BITS = 9


class Slave(Protocol):
    def begin(self, reading: bool) -> None: ...
    def put(self, byte: int) -> None: ...
    def get(self) -> int: ...


class RegisterSlave:
    """A chip of byte registers: the first byte written is the register, which then counts up."""

    def __init__(self, registers: dict[int, int]) -> None:
        self.registers = registers
        self.at: int | None = None
        self.log: list[tuple[int, int]] = []
        """Registers written, in order."""

    def begin(self, reading: bool) -> None:
        self.at = self.at if reading else None

    def put(self, byte: int) -> None:
        if self.at is None:
            self.at = byte
        else:
            self.registers[self.at] = byte
            self.log.append((self.at, byte))
            self.at += 1

    def get(self) -> int:
        assert self.at is not None
        self.at += 1
        return self.read(self.at - 1)

    def read(self, register: int) -> int:
        return self.registers.get(register, 0)


class Adxl345(RegisterSlave):
    """Accelerometer at 0x53: counts of the three axes, low byte first, alive only while it measures."""

    ADDRESS = 0x53

    def __init__(self) -> None:
        super().__init__({0x00: 0xE5, 0x2C: 0x0A})
        self.counts = (0, 0, 256)

    def read(self, register: int) -> int:
        measures = self.registers.get(0x2D, 0) & 8
        if register == 0x30:
            return 0x83 if measures else 0x02
        if 0x32 <= register <= 0x37:
            low_first = b"".join(count.to_bytes(2, "little", signed=True) for count in self.counts)
            return low_first[register - 0x32] if measures else 0
        return super().read(register)


class Itg3205(RegisterSlave):
    """Gyro at 0x68: counts of the three axes, high byte first, asleep until a write wakes it."""

    ADDRESS = 0x68

    def __init__(self) -> None:
        super().__init__({0x00: 0x68})
        self.counts = (0, 0, 0)

    def read(self, register: int) -> int:
        awake = not self.registers.get(0x3E, 0) & 0x40
        if register == 0x1A:
            return int(awake and self.registers.get(0x17, 0) & 1)
        if 0x1D <= register <= 0x22:
            return b"".join(count.to_bytes(2, "big", signed=True) for count in self.counts)[register - 0x1D]
        return super().read(register)


class Mpu6050(RegisterSlave):
    """Gyro and accelerometer at 0x68: accelerations, temperature, rates, high byte first; asleep after power-up."""

    ADDRESS = 0x68

    def __init__(self) -> None:
        super().__init__({0x75: 0x68, 0x6B: 0x40})
        self.counts = (0, 0, 2048, 0, 0, 0)
        """Accelerations, then rates."""

    def read(self, register: int) -> int:
        awake = not self.registers[0x6B] & 0x40
        if register == 0x3A:
            return int(awake and self.registers.get(0x38, 0) & 1)
        if 0x3B <= register <= 0x48:
            words = (*self.counts[:3], -521, *self.counts[3:])
            return b"".join(count.to_bytes(2, "big", signed=True) for count in words)[register - 0x3B]
        return super().read(register)


class I2c(Block):
    """slaves: chips by their 7-bit address."""

    LAYOUT: ClassVar[Layout] = {
        0x00: ("CR1", 0, 0),
        0x04: ("CR2", 0, 0x1F3F),
        0x08: ("OAR1", 0, 0x83FF),
        0x0C: ("OAR2", 0, 0xFF),
        0x10: ("DR", 0, 0),
        0x14: ("SR1", 0, 0),
        0x18: ("SR2", 0, 0),
        0x1C: ("CCR", 0, 0xCFFF),
        0x20: ("TRISE", 2, 0x3F),
    }
    CLOCK = ("APB1ENR", 21)

    def reset(self) -> None:
        if not self.value:
            self.slaves: dict[int, Slave] = {}
        super().reset()
        self._go = getattr(self, "_go", 0) + 1
        self._slave: Slave | None = None
        self._reading = self._moving = False
        self._waiting: int | None = None
        self._status_read = False
        self._stop_next = False

    def _after_bits(self, bits: int, then: object) -> None:
        """Low and high time of the clock: 1 + 1, or 2 + 1 in fast mode, or 16 + 9 with DUTY (26.6.8)."""
        divider = self.value["CCR"] & 0xFFF
        parts = 2 if not self.value["CCR"] >> 15 else 25 if self.value["CCR"] >> 14 & 1 else 3
        go = self._go

        def end() -> None:
            if go == self._go:
                then()  # type: ignore[operator]
                self._raise()

        self.chip.after(bits * parts * divider * self.chip.rcc.pclk1(), end)

    def _raise(self) -> None:
        status, control = self.value["SR1"], self.value["CR2"]
        events = status & (SB | ADDR | BTF) or (control & 1 << 10 and status & (TXE | RXNE))
        self.chip.nvic.line(EVENT_IRQ, bool(control & 1 << 9 and events))
        self.chip.nvic.line(ERROR_IRQ, bool(control & 1 << 8 and status & 0xDF00))

    def wired(self) -> bool:
        remapped = self.chip.afio.bit("MAPR", 1)
        port = self.chip.ports["B"]
        return all(port.mode(pin) & 0xC == 0xC and port.mode(pin) & 3 for pin in ((8, 9) if remapped else (6, 7)))

    # ---- registers ----

    def write_CR1(self, value: int) -> None:
        if value & SWRST:
            self.reset()
            self.value["CR1"] = SWRST
            self._raise()
            return
        self.value["CR1"] = value & 0xBFFB
        if not value & 1:
            self._go += 1
            self.value["SR1"] = self.value["SR2"] = 0
            self._moving = False
        elif value & START and not self._moving:
            self._after_bits(1, self._started)
        elif value & STOP:
            if self._moving:
                self._stop_next = True
            else:
                self._after_bits(1, self._stopped)
        self._raise()

    def write_CR2(self, value: int) -> None:
        self.value["CR2"] = value & 0x1F3F
        self._raise()

    def _started(self) -> None:
        self.value["CR1"] &= ~START
        self.value["SR1"] = SB
        self.value["SR2"] = 3  # MSL, BUSY
        self._waiting = None

    def _stopped(self) -> None:
        self.value["CR1"] &= ~STOP
        self.value["SR1"] &= ~(BTF | TXE)
        self.value["SR2"] = 0
        self._stop_next = False

    def read_SR1(self) -> int:
        self._status_read = True
        return self.value["SR1"]

    def write_SR1(self, value: int) -> None:
        self.value["SR1"] &= value | ~0xDF00
        self._raise()

    def read_SR2(self) -> int:
        if self._status_read and self.value["SR1"] & ADDR:
            self.value["SR1"] &= ~ADDR
            if self._reading:
                self._fetch()
            else:
                self.value["SR1"] |= TXE
        self._status_read = False
        self._raise()
        return self.value["SR2"]

    def write_DR(self, value: int) -> None:
        byte = value & 0xFF
        if self.value["SR1"] & SB:
            if self._status_read:
                self.value["SR1"] &= ~SB
                self._moving = True
                self._after_bits(BYTE_BITS, lambda: self._addressed(byte))
        elif self._slave is not None and not self._reading:
            self.value["SR1"] &= ~(TXE | BTF)
            self._waiting = byte
            if not self._moving:
                self._send()
        self._raise()

    def _addressed(self, byte: int) -> None:
        self._moving = False
        self._slave = self.slaves.get(byte >> 1) if self.wired() else None
        self._reading = bool(byte & 1)
        if self._slave is None:
            self.value["SR1"] |= AF
            return
        self._slave.begin(self._reading)
        self.value["SR1"] |= ADDR
        self.value["SR2"] = 3 | (0 if self._reading else 4)

    def _send(self) -> None:
        byte, self._waiting = self._waiting, None
        assert byte is not None
        self._moving = True
        self.value["SR1"] |= TXE
        self._after_bits(BYTE_BITS, lambda: self._sent(byte))

    def _sent(self, byte: int) -> None:
        self._moving = False
        assert self._slave is not None
        self._slave.put(byte)
        if self._waiting is not None:
            self._send()
        elif self._stop_next:
            self._stopped()
        else:
            self.value["SR1"] |= BTF | TXE

    def _fetch(self) -> None:
        self._moving = True
        self._after_bits(BYTE_BITS, self._fetched)

    def _fetched(self) -> None:
        """A byte is in. Answered with NACK where ACK is off, or where DMA says that it is its last (LAST)."""
        self._moving = False
        assert self._slave is not None
        by_dma = self.value["CR2"] >> 11 & 1
        last = by_dma and self.value["CR2"] >> 12 & 1 and self.chip.dma.left(7) == 1
        goes_on = self.value["CR1"] & ACK and not last and not self._stop_next
        self.value["DR"] = self._slave.get()
        self.value["SR1"] |= RXNE
        if by_dma:
            self.chip.dma.request(7)
        if self._stop_next:
            self._stopped()
        elif goes_on:
            if self.value["SR1"] & RXNE:
                self.value["SR1"] |= BTF  # the clock is held until DR has been read
            else:
                self._fetch()

    def read_DR(self) -> int:
        held = self.value["SR1"] & BTF and self._reading
        self.value["SR1"] &= ~(RXNE | BTF)
        if held:
            self._fetch()
        self._raise()
        return self.value["DR"]
