"""bxCAN (RM0008 24) and the bus it is on: one frame at a time, the lowest identifier first, acknowledged by `listeners`
other nodes."""

from __future__ import annotations

from collections import deque
from typing import ClassVar

from second_chip.block import Block, Layout
from second_chip.clocks import UNITS_HZ

Frame = tuple[int, bytes]
TX_IRQ, RX0_IRQ = 19, 20
BANKS = 14
FRAME_BITS = 47
"""Of a frame without data and stuff bits, the pause behind it included (ISO 11898-1)."""
IDLE_BITS = 11


class BxCan(Block):
    LAYOUT: ClassVar[Layout] = (
        {
            0x00: ("MCR", 0x00010002, 0x000100FF),
            0x04: ("MSR", 0x00000C02, 0),
            0x08: ("TSR", 0x1C000000, 0),
            0x0C: ("RF0R", 0, 0),
            0x10: ("RF1R", 0, 0),
            0x14: ("IER", 0, 0x00038F7F),
            0x18: ("ESR", 0, 0x70),
            0x1C: ("BTR", 0x01230000, 0xC37F03FF),
            0x200: ("FMR", 0x2A1C0E01, 1),
            0x204: ("FM1R", 0, (1 << BANKS) - 1),
            0x20C: ("FS1R", 0, (1 << BANKS) - 1),
            0x214: ("FFA1R", 0, (1 << BANKS) - 1),
            0x21C: ("FA1R", 0, (1 << BANKS) - 1),
        }
        | {
            0x180 + 16 * box + 4 * i: (f"T{name}{box}R", 0, mask)
            for box in range(3)
            for i, (name, mask) in enumerate(
                (("I", 0xFFFFFFFE), ("DT", 0xFFFF010F), ("DL", 0xFFFFFFFF), ("DH", 0xFFFFFFFF))
            )
        }
        | {
            0x1B0 + 16 * fifo + 4 * i: (f"R{name}{fifo}R", 0, 0)
            for fifo in range(2)
            for i, name in enumerate(("I", "DT", "DL", "DH"))
        }
        | {0x240 + 8 * bank + 4 * i: (f"F{bank}R{i + 1}", 0, 0xFFFFFFFF) for bank in range(BANKS) for i in range(2)}
    )
    CLOCK = ("APB1ENR", 25)

    def reset(self) -> None:
        if not self.value:
            self.sent: list[Frame] = []
            """Frames of the board that other nodes received and no test has read yet."""
            self.bus_kbit = 500
            self.listeners = 1
            self._outside: deque[Frame] = deque()
        super().reset()
        self.fifo: deque[tuple[Frame, int]] = deque()
        self._order: list[int] = []
        self._busy = False

    # ---- the bus ----

    def put(self, frame: Frame) -> None:
        """Another node's frame, to go out when the bus is free."""
        self._outside.append(frame)
        self._arbitrate()

    def listen_again(self) -> None:
        self._arbitrate()

    def _takes_part(self) -> bool:
        """Out of initialisation and sleep, not bus-off, with its pins set up."""
        port = self.chip.ports["A"]
        ready = not self.value["MSR"] & 3 and not self.value["ESR"] & 4
        return ready and self.clocked() and port.alternate(12) and port.input(11)

    def _bit(self) -> int:
        timing = self.value["BTR"]
        quanta = 3 + (timing >> 16 & 15) + (timing >> 20 & 7)
        return (timing & 0x3FF) * self.chip.rcc.pclk1() * quanta + self.chip.rcc.pclk1() * quanta

    def _same_rate(self) -> bool:
        return abs(self._bit() * self.bus_kbit * 1000 / UNITS_HZ - 1) < 0.005

    def _mailbox(self) -> int | None:
        if not self._order or not self._takes_part():
            return None
        if self.value["MCR"] & 4:  # TXFP
            return self._order[0]
        return min(self._order, key=lambda box: (self.value[f"TI{box}R"] >> 21, box))

    def _arbitrate(self) -> None:
        if self._busy:
            return
        box = self._mailbox()
        mine = None if box is None else (self.value[f"TI{box}R"] >> 21, self._data(f"T{{}}{box}R"))
        theirs = self._outside[0] if self._outside else None
        if mine is None and theirs is None:
            return
        self._busy = True
        if mine is not None and box is not None and (theirs is None or mine[0] < theirs[0]):
            self._after_frame(mine, lambda: self._transmitted(box, mine))
        else:
            assert theirs is not None
            self._outside.popleft()
            self._after_frame(theirs, lambda: self._received(theirs))

    def _after_frame(self, frame: Frame, then: object) -> None:
        bits = FRAME_BITS + 8 * len(frame[1])

        def end() -> None:
            self._busy = False
            then()  # type: ignore[operator]
            self._arbitrate()

        self.chip.after(bits * UNITS_HZ // (self.bus_kbit * 1000), end)

    def _data(self, name: str) -> bytes:
        both = self.value[name.format("DL")] | self.value[name.format("DH")] << 32
        return both.to_bytes(8, "little")[: min(8, self.value[name.format("DT")] & 15)]

    def _transmitted(self, box: int, frame: Frame) -> None:
        if box not in self._order:
            return
        if self.listeners and self._same_rate():
            self.sent.append(frame)
            self._errors(transmit=-1)
            self._free(box, 1 << 1)  # TXOK
        else:  # repeated for ever; an unacknowledged frame counts up to error passive only (24.7.6)
            passive = self._counters()[0] >= 128
            self._errors(transmit=0 if passive and not self.listeners else 8, code=3 if not self.listeners else 4)

    def _received(self, frame: Frame) -> None:
        if not self._takes_part():
            return
        if not self._same_rate():
            self._errors(receive=1, code=1)
            return
        self._errors(receive=-1)
        match = self._match(frame)
        if match is None:
            return
        if len(self.fifo) == 3:
            self.value["RF0R"] |= 1 << 4  # FOVR0; the last frame is overwritten unless RFLM
            if not self.value["MCR"] & 8:
                self.fifo[-1] = (frame, match)
        else:
            self.fifo.append((frame, match))
            if len(self.fifo) == 3:
                self.value["RF0R"] |= 1 << 3
        self._show()

    def _match(self, frame: Frame) -> int | None:
        """Number of the filter of FIFO 0 that lets a standard data frame through (24.7.4)."""
        if self.value["FMR"] & 1:
            return None
        number = 0
        word, half = frame[0] << 21, frame[0] << 5
        for bank in range(BANKS):
            wide, a_list = self.bit("FS1R", bank), self.bit("FM1R", bank)
            first, second = self.value[f"F{bank}R1"], self.value[f"F{bank}R2"]
            if wide:
                pairs = [(first, ~1), (second, ~1)] if a_list else [(first, second & ~1)]
                hits = [(word ^ wanted) & mask & 0xFFFFFFFF == 0 for wanted, mask in pairs]
            else:
                halves = [first & 0xFFFF, first >> 16, second & 0xFFFF, second >> 16]
                pairs = [(h, 0xFFFF) for h in halves] if a_list else [(halves[0], halves[1]), (halves[2], halves[3])]
                hits = [(half ^ wanted) & mask == 0 for wanted, mask in pairs]
            if self.bit("FFA1R", bank):
                continue
            if self.bit("FA1R", bank) and any(hits):
                return number + hits.index(True)
            number += len(hits)
        return None

    def _counters(self) -> tuple[int, int]:
        return self.value["ESR"] >> 16 & 0xFF, self.value["ESR"] >> 24

    def _errors(self, transmit: int = 0, receive: int = 0, code: int = 0) -> None:
        sent, got = self._counters()
        sent, got = max(0, sent + transmit), min(max(0, got + receive), 255)
        off = sent > 255
        state = (sent >= 96 or got >= 96) | (sent >= 128 or got >= 128) << 1 | off << 2
        self.value["ESR"] = min(sent, 255) << 16 | got << 24 | code << 4 | state

    # ---- registers ----

    def _raise(self) -> None:
        enable = self.value["IER"]
        done = self.value["TSR"] & 0x010101
        self.chip.nvic.line(TX_IRQ, bool(enable & 1 and done))
        waits = (enable & 2 and self.fifo) or (enable & 4 and self.value["RF0R"] & 8)
        self.chip.nvic.line(RX0_IRQ, bool(waits or (enable & 8 and self.value["RF0R"] & 16)))

    def _show(self) -> None:
        self.value["RF0R"] = self.value["RF0R"] & ~0x23 | len(self.fifo)
        if self.fifo:
            (identifier, data), match = self.fifo[0]
            self.value["RI0R"] = identifier << 21
            self.value["RDT0R"] = len(data) | match << 8
            whole = int.from_bytes(data.ljust(8, b"\0"), "little")
            self.value["RDL0R"], self.value["RDH0R"] = whole & 0xFFFFFFFF, whole >> 32
        self._raise()

    def write(self, offset: int, value: int) -> None:
        """A mailbox that waits to be sent is write-protected (24.9.3)."""
        box = (offset - 0x180) // 16
        if not (0 <= box < 3 and box in self._order):
            super().write(offset, value)

    def write_MCR(self, value: int) -> None:
        before = self.value["MCR"]
        if value >> 15 & 1:
            self.reset()
            return
        self.value["MCR"] = value & 0x100FF
        bits = IDLE_BITS * self._bit()
        if (value ^ before) & 3:
            self.chip.after(bits if before & 1 and not value & 1 else self._bit(), self._change_mode)

    def _change_mode(self) -> None:
        """Initialisation wins over sleep; what left either has seen eleven recessive bits."""
        wanted = self.value["MCR"] & 3
        acknowledged = 1 if wanted & 1 else 2 if wanted & 2 else 0
        if self.value["MSR"] & 1 and not acknowledged:  # a new start: also the way back from bus-off (24.7.6)
            self.value["ESR"] &= 0x70
        self.value["MSR"] = self.value["MSR"] & ~3 | acknowledged
        self._arbitrate()

    def write_MSR(self, value: int) -> None:
        self.value["MSR"] &= ~(value & 0x1C)

    def write_BTR(self, value: int) -> None:
        if self.value["MSR"] & 1:
            self.value["BTR"] = value & 0xC37F03FF

    def write_IER(self, value: int) -> None:
        self.value["IER"] = value & 0x38F7F
        self._raise()

    def read_TSR(self) -> int:
        status = self.value["TSR"]
        empty = [box for box in range(3) if status >> 26 + box & 1]
        code = empty[0] if empty else self._order[-1] if self._order else 0
        return status & ~(3 << 24) | code << 24

    def write_TSR(self, value: int) -> None:
        for box in range(3):
            if value >> 8 * box & 1:
                self.value["TSR"] &= ~(15 << 8 * box)  # RQCP, TXOK, ALST, TERR
            if value >> 8 * box & 0x80 and box in self._order:
                self._free(box, 0)
        self._raise()

    def _free(self, box: int, result: int) -> None:
        self._order.remove(box)
        self.value[f"TI{box}R"] &= ~1
        self.value["TSR"] = self.value["TSR"] & ~(15 << 8 * box) | (1 | result) << 8 * box | 1 << 26 + box
        self._raise()

    def _request(self, box: int, value: int) -> None:
        self.value[f"TI{box}R"] = value
        if value & 1 and box not in self._order:
            self.value["TSR"] &= ~(1 << 26 + box | 15 << 8 * box)
            self._order.append(box)
            self._raise()
            self._arbitrate()

    def write_TI0R(self, value: int) -> None:
        self._request(0, value)

    def write_TI1R(self, value: int) -> None:
        self._request(1, value)

    def write_TI2R(self, value: int) -> None:
        self._request(2, value)

    def write_RF0R(self, value: int) -> None:
        self.value["RF0R"] &= ~(value & 0x18)
        if value & 0x20 and self.fifo:
            self.fifo.popleft()
            self.value["RF0R"] &= ~8
        self._show()
