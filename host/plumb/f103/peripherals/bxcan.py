"""bxCAN (RM0008 chapter 24): modes, bit timing, three transmit mailboxes, fourteen filter banks, two FIFOs of three,
error counters and bus-off. Which frames the filters accept is in bxcan_filters.py, the bus itself in canwire.py.

Not modelled: time-triggered communication, wake-up by bus activity. In loop back and silent mode the model is off the
bus.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from plumb.f103.attached.canwire import ACK, CanWire, WireFrame
from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.f103.peripherals.bxcan_filters import BANKS, IDE, RTR, Filters, identifier_word, match

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

INRQ, SLEEP, TXFP, RFLM, NART, ABOM, RESET = 1, 2, 4, 8, 16, 64, 1 << 15
INAK, SLAK, ERRI = 1, 2, 4
RFOM, FOVR, FULL = 32, 16, 8
TMEIE, ERRIE = 1, 1 << 15
EWGF, EPVF, BOFF = 1, 2, 4
TXRQ = 1
TX_IRQ, RX0_IRQ, RX1_IRQ, SCE_IRQ = 19, 20, 21, 22
MAILBOXES, DEPTH = 3, 3
TX_WORDS, RX_WORDS = ("ti", "tdt", "tdl", "tdh"), ("ri", "rdt", "rdl", "rdh")
TEST_MODES = 3 << 30
"""SILM and LBKM of BTR: silent and loop back."""
IDLE_BITS = 11
RECOVERY_BITS = 128 * 11
TME = 7 << 26
"""Bits of TSR: all mailboxes are empty."""
TSR_CLEAR = {n: (1 << 8 * n, 0x0F << 8 * n) for n in range(MAILBOXES)}
"""For each mailbox: its bit RQCP in TSR, and the bits that clearing RQCP clears."""


@dataclass
class Mailbox:
    """A transmit mailbox. order: number of its request, for TXFP. empty: its registers may be written."""

    words: list[int] = field(default_factory=lambda: [0, 0, 0, 0])
    pending: bool = False
    abort: bool = False
    order: int = 0

    def frame(self) -> WireFrame:
        head, length = self.words[0], self.words[1] & 15
        data = (self.words[2] | self.words[3] << 32).to_bytes(8, "little")[: min(length, 8)]
        extended = bool(head & IDE)
        return WireFrame(head >> 3 if extended else head >> 21, data, extended, bool(head & RTR))


def _registers() -> tuple[Register, ...]:
    rows = [
        Register("mcr", 0x00, 0x00010002, 0x000180FF),
        Register("msr", 0x04, 0x00000C02),
        Register("tsr", 0x08, 0x1C000000),
        Register("rf0r", 0x0C),
        Register("rf1r", 0x10),
        Register("ier", 0x14, 0, 0x00038F7F),
        Register("esr", 0x18, 0, 0),
        Register("btr", 0x1C, 0x01230000, 0xC37F03FF),
    ]
    for n in range(MAILBOXES):
        rows += [Register(f"{name}{n}r", 0x180 + 16 * n + 4 * i) for i, name in enumerate(TX_WORDS)]
    for n in range(2):
        rows += [Register(f"{name}{n}r", 0x1B0 + 16 * n + 4 * i, 0, 0) for i, name in enumerate(RX_WORDS)]
    rows += [
        Register("fmr", 0x200, 0x2A1C0E01, 1),
        Register("fm1r", 0x204, 0, 0x3FFF),
        Register("fs1r", 0x20C, 0, 0x3FFF),
        Register("ffa1r", 0x214, 0, 0x3FFF),
        Register("fa1r", 0x21C, 0, 0x3FFF),
    ]
    rows += [Register(f"f{bank}r{i + 1}", 0x240 + 8 * bank + 4 * i) for bank in range(BANKS) for i in range(2)]
    return tuple(rows)


class Bxcan(Peripheral):
    """wire: its bus. release_ticks: time that the release of a received frame takes (RM0008 gives no figure; the bit
    RFOM shows that it is under way)."""

    REGISTERS = _registers()
    NARROW = "refuse"
    mcr: int
    btr: int
    ier: int
    fmr: int
    fm1r: int
    fs1r: int
    ffa1r: int
    fa1r: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "CAN", 0x40006400)
        self.wire = CanWire(machine, self)
        self.release_ticks = 0
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.mailbox = [Mailbox() for _ in range(MAILBOXES)]
        self.sending: int | None = None
        self.results = 0
        """RQCP, TXOK, ALST, TERR of the three mailboxes, at their places in TSR."""
        self.fifo: list[list[tuple[WireFrame, int]]] = [[], []]
        self.overrun = [False, False]
        self.releasing = [False, False]
        self.tec = self.rec = self.lec = 0
        self.bus_off = False
        self.asleep, self.initialising, self.joining, self.recovering = True, False, False, False
        self.error_interrupt = False
        self.requests = 0
        self._matches: dict[tuple[int, bool, bool], tuple[int, int] | None] = {}
        for event in ("can join", "can recover", "can release 0", "can release 1"):
            self.machine.timeline.cancel(event)
        for interrupt in (TX_IRQ, RX0_IRQ, RX1_IRQ, SCE_IRQ):
            self.machine.nvic.set_line(interrupt, False)
        self.wire.board_lost()

    # The node, as the wire sees it

    @property
    def listening(self) -> bool:
        """On the bus: sees frames and acknowledges them."""
        return (
            self.clocked
            and self.machine.powered
            and not (self.asleep or self.initialising or self.joining or self.bus_off or self.btr & TEST_MODES)
        )

    @property
    def quanta(self) -> int:
        return 1 + ((self.btr >> 16) & 15) + 1 + ((self.btr >> 20) & 7) + 1

    @property
    def bit_ticks(self) -> int:
        """APB1 cycles of a bit, in ticks of the timeline."""
        return self.machine.rcc.pclk1_ticks * ((self.btr & 0x3FF) + 1) * self.quanta

    @property
    def kbit(self) -> float:
        return TICKS_PER_S / self.bit_ticks / 1000

    @property
    def sample_point(self) -> float:
        return (2 + ((self.btr >> 16) & 15)) / self.quanta

    def offer(self) -> WireFrame | None:
        """The frame that this node would send now; stores its mailbox."""
        waiting = [n for n in range(MAILBOXES) if self.mailbox[n].pending] if self.listening else []
        if not waiting:
            self.sending = None
            return None
        if self.mcr & TXFP:
            self.sending = min(waiting, key=lambda n: self.mailbox[n].order)
        else:
            self.sending = min(waiting, key=lambda n: (self.mailbox[n].frame().urgency, n))
        self._pin_works()
        return self.mailbox[self.sending].frame()

    def _pin_works(self) -> None:
        remap = self.machine.afio.mapr >> 13 & 3
        port, pin = {0: (0, 12), 2: (1, 9), 3: (3, 1)}.get(remap, (0, 12))
        if not self.machine.ports[port].is_alternate_output(pin):
            self.machine.warn(f"CAN sends, but P{'ABCDE'[port]}{pin} is not an alternate-function output")

    def sent(self) -> None:
        self.tec = max(0, self.tec - 1)
        self.lec = 0
        self._finish(0b0011)

    def send_failed(self, kind: int) -> None:
        """An attempt ended in an error: the frame is repeated, except with NART or an abort."""
        self.lec = kind
        if not (kind == ACK and self.tec > 127):
            self.tec += 8
        if self.tec > 255:
            self.bus_off = True
        assert self.sending is not None
        if self.mcr & NART or self.mailbox[self.sending].abort:
            self._finish(0b1001)
        self._note_errors()

    def _finish(self, result: int) -> None:
        assert self.sending is not None
        box = self.mailbox[self.sending]
        box.pending = box.abort = False
        self.results = self.results & ~TSR_CLEAR[self.sending][1] | result << 8 * self.sending
        self._update_lines()

    def receive_failed(self, kind: int) -> None:
        if self.listening:
            self.lec = kind
            self.rec = min(255, self.rec + 1)
            self._note_errors()

    def receive(self, frame: WireFrame) -> None:
        self.rec = 127 if self.rec > 127 else max(0, self.rec - 1)
        self.lec = 0
        found = self.match(frame)
        if found is None:
            return
        number, index = found
        fifo = self.fifo[number]
        if len(fifo) < DEPTH:
            fifo.append((frame, index))
        else:
            self.overrun[number] = True
            if not self.mcr & RFLM:
                fifo[-1] = (frame, index)
        self._update_lines()

    def frame_over(self) -> None:
        """Carry out a request that waited for the end of the frame on the bus."""
        self.sending = None
        if self.mcr & INRQ and not self.initialising:
            self._enter_initialisation()

    def bus_changed(self) -> None:
        """The bus became recessive again, or dominant."""
        if self.joining:
            self._join()
        elif self.recovering:
            self._recover()

    # Filters

    def match(self, frame: WireFrame) -> tuple[int, int] | None:
        """(FIFO, filter match index) of the filter of highest priority that accepts the frame; None when none does."""
        if self.fmr & 1:
            return None
        key = (frame.identifier, frame.extended, frame.remote)
        if key not in self._matches:
            self._matches[key] = self._search(frame)
        return self._matches[key]

    def _search(self, frame: WireFrame) -> tuple[int, int] | None:
        banks = [(getattr(self, f"f{bank}r1"), getattr(self, f"f{bank}r2")) for bank in range(BANKS)]
        return match(Filters(banks, self.fm1r, self.fs1r, self.ffa1r, self.fa1r), frame)

    # Modes

    def _enter_initialisation(self) -> None:
        self.initialising, self.asleep, self.joining, self.recovering = True, False, False, False
        self.machine.timeline.cancel("can join")
        self.machine.timeline.cancel("can recover")

    def _join(self) -> None:
        """Leave initialisation mode: INAK stays set until eleven recessive bits."""
        self.joining = True
        self._when_recessive("can join", IDLE_BITS, self._joined)

    def _joined(self, _time: int) -> None:
        self.joining = False
        if self.bus_off:
            self._recover()
        self.wire.look()

    def _recover(self) -> None:
        """Recover from bus-off: BOFF stays set until 128 times eleven recessive bits."""
        self.recovering = True
        self._when_recessive("can recover", RECOVERY_BITS - IDLE_BITS, self._recovered)

    def _recovered(self, _time: int) -> None:
        self.bus_off, self.recovering, self.tec, self.rec = False, False, 0, 0
        self.wire.look()

    def _when_recessive(self, event: str, bits: int, then: Callable[[int], None]) -> None:
        """Call then() after this number of recessive bits; the count restarts when the bus was held dominant."""
        self.machine.timeline.cancel(event)
        if not self.wire.dominant:
            self.machine.timeline.at(event, self.machine.now + bits * self.bit_ticks, then)

    def _note_errors(self) -> None:
        enabled = self.ier & 0x0F00
        state = (self.tec > 95 or self.rec > 95) << 8 | (self.tec > 127 or self.rec > 127) << 9
        state |= self.bus_off << 10 | bool(self.lec) << 11
        if enabled & state:
            self.error_interrupt = True
        if self.bus_off and self.mcr & ABOM and not self.recovering:
            self._recover()
        self._update_lines()

    def _update_lines(self) -> None:
        done = any(self.results & flag for flag, _ in TSR_CLEAR.values())
        line = self.machine.nvic.set_line
        line(TX_IRQ, bool(done and self.ier & TMEIE))
        for number, interrupt in enumerate((RX0_IRQ, RX1_IRQ)):
            fifo = self.fifo[number]
            state = bool(fifo) | (len(fifo) == DEPTH) << 1 | self.overrun[number] << 2
            line(interrupt, bool(state & (self.ier >> 1 + 3 * number) & 7))
        line(SCE_IRQ, bool(self.ier & ERRIE and self.error_interrupt))

    # Registers

    def write_mcr(self, value: int) -> None:
        if value & RESET:
            self.reset()
            return
        if value & (1 << 7 | 1 << 5):
            raise SimulationError(
                f"CAN_MCR = 0x{value:05X}: time-triggered mode and automatic wake-up are not modelled"
            )
        self.mcr = value & 0x000100FF
        if value & INRQ:
            if not self.initialising and not self.wire.board_sends:
                self._enter_initialisation()
            return
        if value & SLEEP:
            self.asleep, self.initialising = True, False
            return
        if self.initialising or self.asleep:
            self.initialising = self.asleep = False
            self._join()

    def read_msr(self) -> int:
        present = INAK if self.initialising or self.joining else 0
        return 0xC00 | present | (SLAK if self.asleep else 0) | (ERRI if self.error_interrupt else 0)

    def write_msr(self, value: int) -> None:
        if value & ERRI:
            self.error_interrupt = False
            self._update_lines()

    def read_tsr(self) -> int:
        boxes = self.mailbox
        waiting = [n for n in range(MAILBOXES) if boxes[n].pending]
        if not waiting:  # nearly always
            return self.results | TME
        empty = [n for n in range(MAILBOXES) if n not in waiting]
        value = self.results | sum(1 << 26 + n for n in empty)
        last = max(
            waiting, key=lambda n: (boxes[n].order if self.mcr & TXFP else boxes[n].frame().urgency[0], n), default=0
        )
        value |= (empty[0] if empty else last) << 24
        if len(waiting) > 1:
            value |= 1 << 29 + last
        return value | sum(1 << 7 + 8 * n for n in waiting if boxes[n].abort)

    def write_tsr(self, value: int) -> None:
        for n, (flag, clears) in TSR_CLEAR.items():
            if value & flag:
                self.results &= ~clears
            if value & 1 << 7 + 8 * n and self.mailbox[n].pending:
                if self.sending == n and self.wire.board_sends:
                    self.mailbox[n].abort = True
                else:
                    self.mailbox[n].pending = False
                    self.results = self.results & ~clears | flag
        self._update_lines()

    def _read_fifo_status(self, number: int) -> int:
        count = len(self.fifo[number])
        state = (FULL if count == DEPTH else 0) | (FOVR if self.overrun[number] else 0)
        return count | state | (RFOM if self.releasing[number] else 0)

    def _release(self, number: int) -> None:
        """Release the first frame of a FIFO: at once, or after release_ticks."""
        if self.releasing[number] or not self.fifo[number]:
            return
        self.releasing[number] = True
        if self.release_ticks:
            due = self.machine.now + self.release_ticks
            self.machine.timeline.at(f"can release {number}", due, lambda _time: self._released(number))
        else:
            self._released(number)

    def _released(self, number: int) -> None:
        self.releasing[number] = False
        if self.fifo[number]:
            self.fifo[number].pop(0)
        self._update_lines()

    def _write_fifo_status(self, number: int, value: int) -> None:
        if value & RFOM:
            self._release(number)
        if value & FOVR:
            self.overrun[number] = False
        self._update_lines()

    def read_rf0r(self) -> int:
        return self._read_fifo_status(0)

    def read_rf1r(self) -> int:
        return self._read_fifo_status(1)

    def write_rf0r(self, value: int) -> None:
        self._write_fifo_status(0, value)

    def write_rf1r(self, value: int) -> None:
        self._write_fifo_status(1, value)

    def write_ier(self, value: int) -> None:
        self.ier = value & 0x00038F7F
        self._update_lines()

    def read_esr(self) -> int:
        tec = self.tec & 0xFF
        value = (EWGF if self.tec > 95 or self.rec > 95 else 0) | (EPVF if self.tec > 127 or self.rec > 127 else 0)
        return self.rec << 24 | tec << 16 | self.lec << 4 | (BOFF if self.bus_off else 0) | value

    def write_esr(self, value: int) -> None:
        """Only the last error code can be written, so that the software sees when the next one is set (RM0008
        24.9.2)."""
        self.lec = value >> 4 & 7

    def write_btr(self, value: int) -> None:
        if not self.initialising:
            self.machine.warn("CAN_BTR is written outside initialisation mode; the write is ignored")
            return
        if value & TEST_MODES:
            self.machine.warn(
                f"CAN_BTR = 0x{value:08X}: loop back or silent mode; the model neither sends to the bus nor hears it"
            )
        self.btr = value & (TEST_MODES | 0x037F03FF)

    def _write_filter(self, name: str, value: int, bank: int | None = None) -> None:
        if not (self.fmr & 1 or (bank is not None and not self.fa1r >> bank & 1)):
            self.machine.warn(f"CAN_{name.upper()} is written outside filter initialisation; the write is ignored")
            return
        setattr(self, name, value if bank is not None else value & 0x3FFF)
        self._matches.clear()

    def write_fa1r(self, value: int) -> None:
        self.fa1r = value & 0x3FFF
        self._matches.clear()

    def plain_reader(self, register: Register) -> Callable[[], int]:
        kind = register.name[:-2]
        if kind in TX_WORDS:
            box, place = int(register.name[-2]), TX_WORDS.index(kind)
            return lambda: self.mailbox[box].words[place] | (self.mailbox[box].pending if place == 0 else 0)
        if kind in RX_WORDS:
            return self._fifo_reader(kind, int(register.name[-2]))
        return super().plain_reader(register)

    def _fifo_reader(self, kind: str, number: int) -> Callable[[], int]:
        def read() -> int:
            if not self.fifo[number]:
                self.machine.warn(f"CAN FIFO {number} is read while it is empty")
                return 0
            frame, index = self.fifo[number][0]
            if kind == "ri":
                return identifier_word(frame)
            if kind == "rdt":
                return index << 8 | len(frame.data)
            low = 0 if kind == "rdl" else 4
            return int.from_bytes(frame.data[low : low + 4], "little")

        return read

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        name = register.name
        if name[:-2] in TX_WORDS:
            return self._mailbox_writer(int(name[-2]), TX_WORDS.index(name[:-2]))
        if name in ("fm1r", "fs1r", "ffa1r"):
            return lambda value: self._write_filter(name, value)
        if name[0] == "f" and name[-2:] in ("r1", "r2"):
            bank = int(name[1:-2])
            return lambda value: self._write_filter(name, value, bank)
        return super().plain_writer(register)

    def _mailbox_writer(self, number: int, place: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            box = self.mailbox[number]
            if box.pending:
                self.machine.warn(f"CAN mailbox {number} is written while it is pending; the write is ignored")
                return
            box.words[place] = value & ~TXRQ if place == 0 else value
            if place == 0 and value & TXRQ:
                box.pending, box.order = True, self.requests
                self.requests += 1
                self.results &= ~TSR_CLEAR[number][1]
                self._update_lines()
                self.wire.look()

        return write
