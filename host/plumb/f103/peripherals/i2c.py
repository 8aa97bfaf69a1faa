"""I2C1 as master (RM0008 chapter 26), its bus, and the slaves on it: conditions and bytes take their time from CCR.

Every event that the hardware announces (SB, ADDR, BTF) holds the clock until it is answered in the documented order,
as on silicon: a master that does not answer is stuck. Lines are open drain: they are low when a pin in output mode, a
slave, or the outside pulls. Not modelled: slave mode, 10-bit addresses, SMBus, PEC, POS.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_US

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

PE, START, STOP, ACK, SWRST = 1, 1 << 8, 1 << 9, 1 << 10, 1 << 15
ITERREN, ITEVTEN, ITBUFEN, DMAEN, LAST = 1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12
SB, ADDR, BTF, RXNE, TXE, BERR, ARLO, AF = 1, 2, 4, 64, 128, 1 << 8, 1 << 9, 1 << 10
ERRORS = 0xDF00
MSL, BUSY, TRA = 1, 2, 4
FAST, DUTY = 1 << 15, 1 << 14
EVENT_IRQ, ERROR_IRQ = 31, 32
BITS = 9
"""Clocks of a byte: eight bits and the acknowledge."""
SCL, SDA = 8, 9
"""Pins of port B: only the remapped pins are modelled."""
REMAP = 1 << 1
FAST_KHZ = 400


class Slave(Protocol):
    """A chip on the bus."""

    address: int

    def begin(self, reading: bool, now: int) -> bool:
        """The chip is addressed; True when it acknowledges."""

    def write(self, byte: int, now: int) -> bool:
        """The chip receives a byte; True when it acknowledges."""

    def read(self, now: int) -> int:
        """The chip's next byte."""

    def end(self) -> None:
        """The access ends: STOP, or the START of another one."""

    def brown_out(self) -> None:
        """The supply of the chip was interrupted."""


class I2cBus:
    """The two lines and the slaves. held: clocks until a stuck slave releases SDA (0: it does not hold it)."""

    def __init__(self, machine: Mcu) -> None:
        self.machine = machine
        self.slaves: list[Slave] = []
        self.held = 0
        self.shorted = False
        """True: SDA is shorted to ground, and no clock frees it."""
        self._scl, self._sda = True, True

    def sda(self) -> bool:
        return not self.shorted and not self.held and self._pin(SDA)

    def scl(self) -> bool:
        return self._pin(SCL)

    def _pin(self, pin: int) -> bool:
        """False when the pin pulls its line: as an output that is low."""
        port = self.machine.ports[1]
        pulls = port.is_output(pin) and not port.is_alternate_output(pin) and not port.odr >> pin & 1
        return not pulls

    def pins_changed(self) -> None:
        """Port B was written: a bit-banged clock may free a stuck slave."""
        scl = self.scl()
        if self._scl and not scl and self.held:
            self.held -= 1
        port = self.machine.ports[1]
        port.outside[SCL], port.outside[SDA] = True, not self.shorted and not self.held
        sda = self.sda()
        self.machine.i2c1.lines_changed(scl != self._scl, sda != self._sda)
        self._scl, self._sda = scl, sda

    def stick(self, clocks: int = 9) -> None:
        """Make a slave, in the middle of a byte, hold SDA low for this number of clocks."""
        self.held = clocks
        self.pins_changed()

    def short(self, shorted: bool) -> None:
        self.shorted = shorted
        self.pins_changed()


class I2c(Peripheral):
    REGISTERS = (
        Register("cr1", 0x00),
        Register("cr2", 0x04, 0, 0x1F3F),
        Register("oar1", 0x08, 0, 0xC3FF),
        Register("oar2", 0x0C, 0, 0xFF),
        Register("dr", 0x10),
        Register("sr1", 0x14),
        Register("sr2", 0x18, 0, 0),
        Register("ccr", 0x1C, 0, 0xCFFF),
        Register("trise", 0x20, 2, 0x3F),
    )
    cr1: int
    cr2: int
    sr1: int
    ccr: int
    trise: int

    def __init__(self, machine: Mcu, bus: I2cBus) -> None:
        super().__init__(machine, "I2C1", 0x40005400)
        self.bus = bus
        self.dma = machine.dma.channels[6]
        self.dma.served = self.base + 0x10
        self.filters_locked = {"scl": False, "sda": False}
        """True: the analog filter of a line is stuck low after power-up, so that the bus seems busy until the line
        moves (errata)."""
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.machine.timeline.cancel("i2c")
        self._clear()

    def _clear(self) -> None:
        """State behind the registers."""
        self.phase = "idle"
        """idle; waiting for a free bus; starting; addressing (SB, then the address byte); sending; receiving;
        stretched: the clock is held until software acts; stopping; dead."""
        self.slave: Slave | None = None
        self.reading = False
        self.byte = 0
        self.data: int | None = None
        """The byte in DR that waits to be sent."""
        self.received = self.overflow = 0
        """The received byte in DR, and the one that follows it."""
        self.refused = False
        self.sr1_read = 0
        self._lines()

    # Time

    @property
    def clock_ticks(self) -> int:
        """One period of SCL."""
        ccr = max(self.ccr & 0xFFF, 1)
        times = (25 if self.ccr & DUTY else 3) if self.ccr & FAST else 2
        return ccr * times * self.machine.rcc.pclk1_ticks

    def _after(self, clocks: int, then: str) -> None:
        now = self.machine.now
        self.machine.timeline.at("i2c", now + clocks * self.clock_ticks, lambda time: getattr(self, then)(time))

    def _check_settings(self) -> None:
        mhz = TICKS_PER_US // self.machine.rcc.pclk1_ticks
        if self.cr2 & 0x3F != mhz:
            raise SimulationError(f"I2C1_CR2.FREQ is {self.cr2 & 0x3F}; PCLK1 is {mhz} MHz")
        khz = 1000 * TICKS_PER_US / self.clock_ticks
        if khz > FAST_KHZ * 1.001:
            raise SimulationError(f"I2C1_CCR makes {khz:.0f} kHz; {FAST_KHZ} is the limit")
        if self.trise > mhz * (300 if self.ccr & FAST else 1000) // 1000 + 1:
            self.machine.warn(f"I2C1_TRISE is {self.trise}, longer than the rise the mode allows")
        if not self._pins_work():
            self.machine.warn("I2C1 sends, but PB8 and PB9 are not its open-drain outputs (AFIO_MAPR, GPIOB_CRH)")

    def _pins_work(self) -> bool:
        port = self.machine.ports[1]
        open_drain = all(port.is_alternate_output(pin) and port.mode(pin) & 4 for pin in (SCL, SDA))
        return bool(self.machine.afio.mapr & REMAP) and open_drain

    # The bus

    def _busy(self) -> bool:
        bus = self.bus
        low = not bus.sda() or not bus.scl() or any(self.filters_locked.values())
        return self.phase not in ("idle", "waiting") or low

    def lines_changed(self, scl: bool, sda: bool) -> None:
        """An edge on a line unlocks its filter; a bus that becomes free lets a waiting START begin."""
        self.filters_locked["scl"] &= not scl
        self.filters_locked["sda"] &= not sda
        if self.phase == "waiting" and not self._busy():
            self._start()

    def _start(self) -> None:
        self._check_settings()
        if self.phase != "stretched" and (self._busy() or not self._pins_work()):
            self.phase = "waiting"
            return
        self.phase = "starting"
        self._after(1, "_started")

    def _show(self, what: str, time: int, acknowledged: bool = False, byte: int = 0) -> None:
        if self.machine.probe is not None:
            self.machine.probe.i2c(what, time, self.clock_ticks, byte, acknowledged)

    def _started(self, time: int) -> None:
        self._show("start", time)
        if self.slave is not None:
            self.slave.end()
            self.slave = None
        self.phase = "addressing"
        self.cr1 &= ~START
        self.sr1 = self.sr1 & ~(BTF | TXE) | SB
        self.data = None
        self._lines()

    def _addressed(self, time: int) -> None:
        self.reading = bool(self.byte & 1)
        found = [slave for slave in self.bus.slaves if slave.address == self.byte >> 1]
        if found and found[0].begin(self.reading, time):
            self.slave = found[0]
            self.sr1 |= ADDR | (0 if self.reading else TXE)
        else:
            self.sr1 |= AF
        self._show("byte", time, not self.sr1 & AF, self.byte)
        self.phase = "stretched"
        self._lines()
        self._go_on()

    def _sent(self, time: int) -> None:
        assert self.slave is not None
        self.phase = "stretched"
        acknowledged = self.slave.write(self.byte, time)
        self._show("byte", time, acknowledged, self.byte)
        if not acknowledged:
            self.sr1 |= AF
        elif self.data is None:
            self.sr1 |= BTF
        self._lines()
        self._go_on()

    def _received(self, time: int) -> None:
        assert self.slave is not None
        self.phase = "stretched"
        byte = self.slave.read(time)
        by_dma = bool(self.cr2 & DMAEN)
        # The DMA marks the last byte together with the one before it, so a single byte is not marked.
        last = self.dma.left == 1 and self.dma.done > 0 and bool(self.cr2 & LAST)
        self.refused = not self.cr1 & ACK or (by_dma and last)
        self._show("byte", time, not self.refused, byte)
        if self.sr1 & RXNE:
            self.sr1 |= BTF  # the second byte waits behind the one in DR
            self.overflow = byte
        elif by_dma and self.dma.put([byte]):
            pass
        else:
            self.received = byte
            self.sr1 |= RXNE
        self._lines()
        self._go_on()

    def _go_on(self) -> None:
        """The bus is idle: start the next condition or byte, if the state allows it."""
        if self.phase != "stretched":
            return
        if self.cr1 & STOP:
            self.phase = "stopping"
            self._after(1, "_stopped")
        elif self.cr1 & START:
            self._start()
        elif self.sr1 & (SB | ADDR | AF) or self.slave is None:
            return
        elif self.reading:
            if not self.refused and not self.sr1 & BTF:
                self.phase = "receiving"
                self._after(BITS, "_received")
        elif self.data is not None:
            self.byte, self.data = self.data, None
            self.sr1 = self.sr1 & ~BTF | TXE
            self.phase = "sending"
            self._after(BITS, "_sent")
            self._lines()

    def _stopped(self, time: int) -> None:
        self._show("stop", time)
        if self.slave is not None:
            self.slave.end()
            self.slave = None
        self.cr1 &= ~STOP
        self.sr1 &= ~(BTF | TXE)
        self.phase = "idle"
        self._lines()
        if self.cr1 & START:
            self._start()

    def bus_error(self) -> None:
        """A misplaced STOP from outside: BERR, and no START again until SWRST (errata)."""
        self.machine.timeline.cancel("i2c")
        self.phase = "dead"
        self.sr1 |= BERR
        self._lines()

    def _lines(self) -> None:
        events = self.sr1 & (SB | ADDR | BTF) | (self.sr1 & (RXNE | TXE) if self.cr2 & ITBUFEN else 0)
        nvic = self.machine.nvic
        nvic.set_line(EVENT_IRQ, bool(events and self.cr2 & ITEVTEN))
        nvic.set_line(ERROR_IRQ, bool(self.sr1 & ERRORS and self.cr2 & ITERREN))

    # Registers

    def write_cr1(self, value: int) -> None:
        if value & 0x38FE & ~ACK:
            raise SimulationError(f"I2C1_CR1 = 0x{value:04X}: only PE, START, STOP, ACK and SWRST are modelled")
        pending = self.cr1 & (START | STOP)
        if pending and not self.cr1 & SWRST and value & PE and value & pending != pending:
            self.machine.warn("I2C1_CR1 is written while START or STOP is pending")
        if value & SWRST:
            self.machine.timeline.cancel("i2c")
            if self.slave is not None:
                self.slave.end()
            super().reset()
            self._clear()
            self.cr1 = SWRST
            return
        self.cr1 = value & (PE | START | STOP | ACK)
        if not value & PE:
            self.machine.timeline.cancel("i2c")
            self.cr1 = 0
            self.sr1 = 0
            dead = self.phase == "dead"
            self._clear()
            self.phase = "dead" if dead else "idle"
        elif self.phase == "idle":
            self.cr1 &= ~STOP
            if value & START:
                self._start()
        else:
            self._go_on()

    def write_cr2(self, value: int) -> None:
        self.cr2 = value & 0x1F3F
        self._lines()

    def read_sr1(self) -> int:
        self.sr1_read = self.sr1
        return self.sr1

    def peek_sr1(self) -> int:
        return self.sr1

    def write_sr1(self, value: int) -> None:
        self.sr1 &= value | ~ERRORS
        self._lines()

    def read_sr2(self) -> int:
        if self.sr1_read & self.sr1 & ADDR:
            self.sr1 &= ~ADDR
            self.refused = False
            self._lines()
            self._go_on()
        return self.peek_sr2()

    def peek_sr2(self) -> int:
        if not self.cr1 & PE:
            return 0
        master = self.phase not in ("idle", "waiting", "dead")
        return (MSL if master else 0) | (BUSY if self._busy() else 0) | (TRA if master and not self.reading else 0)

    def write_dr(self, value: int) -> None:
        value &= 0xFF
        if self.phase == "addressing" and self.sr1 & SB and self.sr1_read & SB:
            self.sr1 &= ~SB
            self.byte = value
            self._lines()
            self._after(BITS, "_addressed")
            return
        if not self.sr1 & TXE or self.data is not None:
            self.machine.warn("I2C1_DR is written while no byte is to be sent")
            return
        self.data = value
        self.sr1 &= ~(TXE | BTF)
        self._lines()
        self._go_on()

    def read_dr(self) -> int:
        value = self.received
        self.sr1 &= ~RXNE
        if self.sr1 & BTF and self.reading:
            self.sr1 = self.sr1 & ~BTF | RXNE
            self.received = self.overflow
        self._lines()
        self._go_on()
        return value

    def peek_dr(self) -> int:
        return self.received
