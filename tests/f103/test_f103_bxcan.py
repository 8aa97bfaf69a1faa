"""The register model of bxCAN and its bus, poked register by register (RM0008 chapter 24)."""

from __future__ import annotations

import random
from typing import Any

import pytest

from plumb.f103 import Machine
from plumb.f103.attached.canwire import WireFrame
from support.f103_program import NewBoard

CAN = 0x40006400
MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR = range(CAN, CAN + 0x20, 4)
FMR, FM1R, FS1R, FFA1R, FA1R = (CAN + offset for offset in (0x200, 0x204, 0x20C, 0x214, 0x21C))
INRQ, TXFP, RFLM, NART, ABOM = 1, 4, 8, 16, 64
BOFF, EPVF, EWGF = 4, 2, 1
BIT_8MHZ_500K = 0 << 0 | 4 << 20 | 9 << 16
"""At APB1 = 8 MHz: 16 quanta, prescaler 1."""


class Controller:
    def __init__(self, machine: Machine) -> None:
        self.machine, self.wire = machine, machine.can.wire
        machine.rcc.write_apb1enr(1 << 25)

    def read(self, address: int) -> int:
        return self.machine.bus.read(address, 4)

    def write(self, address: int, value: int) -> None:
        self.machine.bus.write(address, 4, value)

    def start(self, mcr: int = 0) -> None:
        """On the bus at 500 kbit/s, everything into FIFO 0."""
        self.write(MCR, INRQ | mcr)
        self.write(BTR, BIT_8MHZ_500K)
        self.write(FS1R, 1)
        self.write(FA1R, 1)
        self.write(FMR, 0)
        self.write(MCR, mcr)
        self.machine.advance_us(100)
        assert self.machine.can.listening

    def fill(self, box: int, identifier: int, data: bytes = b"\0" * 8) -> None:
        base = CAN + 0x180 + 16 * box
        self.write(base + 4, len(data))
        words = data.ljust(8, b"\0")
        self.write(base + 8, int.from_bytes(words[:4], "little"))
        self.write(base + 12, int.from_bytes(words[4:], "little"))
        self.write(base, identifier << 21 | 1)

    def frames_on_bus(self, us: int = 1000) -> list[int]:
        self.machine.advance_us(us)
        return [frame.identifier for frame in self.wire.pop_frames()]

    def received(self, number: int = 0) -> tuple[int, int, bytes]:
        """The first frame of a FIFO, released: identifier, filter match index, data."""
        base = CAN + 0x1B0 + 16 * number
        identifier, length = self.read(base) >> 21, self.read(base + 4)
        data = self.read(base + 8).to_bytes(4, "little") + self.read(base + 12).to_bytes(4, "little")
        self.write(RF0R + 4 * number, 32)
        return identifier, length >> 8, data[: length & 15]


@pytest.fixture
def can(board: NewBoard) -> Controller:
    machine = board("polled").machine
    machine.advance_us(10)
    return Controller(machine)


def frame(identifier: int, data: bytes = b"\0" * 8, **kind: Any) -> WireFrame:
    return WireFrame(identifier, data, **kind)


def test_it_sleeps_after_reset_and_joins_after_eleven_recessive_bits(can: Controller) -> None:
    assert can.read(MCR) == 0x00010002 and can.read(MSR) & 3 == 2
    can.write(MCR, INRQ)
    assert can.read(MSR) & 3 == 1
    can.write(BTR, BIT_8MHZ_500K)
    assert can.machine.can.kbit == 500 and can.machine.can.sample_point == 11 / 16
    can.write(MCR, 0)
    can.machine.advance_us(20)
    assert can.read(MSR) & 1
    can.machine.advance_us(3)
    assert not can.read(MSR) & 1


def test_what_silicon_ignores_is_ignored_and_said(can: Controller) -> None:
    can.start()
    can.write(BTR, 0)
    can.write(FM1R, 1)
    can.fill(0, 0x100)
    can.write(CAN + 0x184, 3)
    assert can.machine.can.kbit == 500 and can.read(FM1R) == 0
    said = "; ".join(can.machine.warnings)
    for where in (
        "BTR is written outside initialisation",
        "FM1R is written outside filter",
        "mailbox 0 is written while",
    ):
        assert where in said
    assert can.frames_on_bus() == [0x100]


def test_the_test_modes_take_the_node_off_the_bus_and_time_goes_on(can: Controller) -> None:
    """All ones, as from a wild write while the controller is being set up."""
    can.start()
    can.write(MCR, 1)
    can.machine.advance_us(100)
    can.write(BTR, 0xFFFFFFFF)
    assert can.read(BTR) == 0xC37F03FF
    can.write(MCR, 0)
    can.fill(0, 0x100)
    can.machine.advance_us(100_000)
    assert can.frames_on_bus() == []
    assert any("loop back or silent mode" in text for text in can.machine.warnings)
    can.write(MCR, 1)
    can.machine.advance_us(100)
    can.write(BTR, BIT_8MHZ_500K)
    can.write(MCR, 0)
    can.machine.advance_us(10_000)
    assert can.frames_on_bus() == [0x100], "the frame that waited"


def bits_by_the_book(identifier: int, data: bytes) -> int:
    """ISO 11898-1, bit after bit."""
    bits = [0, *(identifier >> i & 1 for i in range(10, -1, -1)), 0, 0, 0, *(len(data) >> i & 1 for i in (3, 2, 1, 0))]
    bits += [byte >> i & 1 for byte in data for i in range(7, -1, -1)]
    crc = 0
    for bit in bits:
        crc = (crc << 1 ^ (0x4599 if bit ^ crc >> 14 & 1 else 0)) & 0x7FFF
    bits += [crc >> i & 1 for i in range(14, -1, -1)]
    sent: list[int] = []
    for bit in bits:
        if len(sent) >= 5 and len(set(sent[-5:])) == 1:
            sent.append(1 - sent[-1])
        sent.append(bit)
    if len(set(sent[-5:])) == 1:
        sent.append(1 - sent[-1])
    return len(sent) + 1 + 2 + 7 + 3


def test_a_frame_takes_its_exact_bits() -> None:
    from plumb.f103.attached.canwire import frame_bits

    chance = random.Random(1)
    lengths = set()
    for _ in range(3000):
        identifier, size = chance.randrange(0x800), chance.randrange(9)
        data = chance.choice([chance.randbytes(size), b"\0" * size, b"\xff" * size, b"\xf8" * size])
        bits = frame_bits(frame(identifier, data))
        assert bits == bits_by_the_book(identifier, data)
        lengths |= {bits} if size == 8 else set()
    assert min(lengths) >= 111 and max(lengths) <= 135


def test_time_on_the_wire(can: Controller) -> None:
    from plumb.f103.attached.canwire import frame_bits

    can.start()
    can.fill(0, 0x123, b"\xaa" * 8)
    bits = frame_bits(frame(0x123, b"\xaa" * 8))
    assert can.frames_on_bus(2 * bits - 1) == []
    assert can.frames_on_bus(2) == [0x123]


@pytest.mark.parametrize(("mode", "order"), [(0, [0x100, 0x200, 0x300]), (TXFP, [0x300, 0x100, 0x200])])
def test_order_of_the_mailboxes(can: Controller, mode: int, order: list[int]) -> None:
    can.start(mode)
    can.wire.babble(frame(0))
    can.machine.advance_us(50)
    for box, identifier in enumerate((0x300, 0x100, 0x200)):
        can.fill(box, identifier)
    assert can.read(TSR) >> 26 & 7 == 0
    can.wire.babble(None)
    assert can.frames_on_bus(2000) == order
    assert can.read(TSR) >> 26 & 7 == 7
    assert can.read(TSR) & 0x030303 == 0x030303  # RQCP and TXOK of all three
    can.write(TSR, 0x010101)
    assert can.read(TSR) & 0x0F0F0F == 0


def test_the_lower_identifier_wins_the_bus(can: Controller) -> None:
    can.start()
    can.wire.babble(frame(0x200))
    can.fill(0, 0x201)
    assert can.frames_on_bus(3000) == []
    can.fill(1, 0x1FF)
    assert can.frames_on_bus(3000) == [0x1FF]


def test_an_abort_empties_a_mailbox_that_waits(can: Controller) -> None:
    can.start()
    can.wire.babble(frame(0))
    can.machine.advance_us(50)
    can.fill(0, 0x300)
    can.write(TSR, 1 << 7)
    assert can.read(TSR) & 0x0F == 1  # RQCP without TXOK
    can.wire.babble(None)
    assert can.frames_on_bus() == []


def test_one_shot(can: Controller) -> None:
    can.start(NART)
    can.wire.fail_sending.append(4)
    can.fill(0, 0x300)
    assert can.frames_on_bus() == []
    assert can.read(TSR) & 0x0F == 9  # RQCP, TERR
    assert can.read(ESR) >> 16 & 0xFF == 8


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("listed", [False, True])
def test_filters(can: Controller, wide: bool, listed: bool) -> None:
    can.start()
    can.write(FMR, 1)
    can.write(FA1R, 0)
    can.write(FS1R, 2 * wide)
    can.write(FM1R, 2 * listed)
    can.write(FFA1R, 2)
    shift, ones = (21, 0xFFFFFFFF) if wide else (5, 0xFFFF)
    first, second = 0x123 << shift, (0x456 << shift if listed else ones & ~(0xF << shift))
    if wide:
        can.write(CAN + 0x248, first)
        can.write(CAN + 0x24C, second)
    else:
        can.write(CAN + 0x248, first | second << 16)
        can.write(CAN + 0x24C, first | second << 16)
    can.write(FA1R, 2)
    can.write(FMR, 0)
    for identifier in range(0x800):
        expected = identifier in (0x123, 0x456) if listed else identifier >> 4 == 0x12
        found = can.machine.can.match(frame(identifier))
        assert (found is not None) == expected
        assert not expected or found == (1, 1 if listed and identifier == 0x456 else 0)
    assert can.machine.can.match(frame(0x123, remote=True)) is None
    assert can.machine.can.match(frame(0x123 << 18, extended=True)) is None


def test_of_filters_that_accept_a_frame_the_one_of_highest_priority_counts(can: Controller) -> None:
    """32 bits before 16, then a list before a mask, then the lower number (RM0008 24.7.4)."""
    can.start()
    can.write(FMR, 1)
    can.write(FA1R, 0)
    can.write(FS1R, 0b0110)  # banks 1 and 2 have 32 bits
    can.write(FM1R, 0b1101)  # bank 1 is a mask, the others are lists
    can.write(FFA1R, 0)
    narrow, wide = 0x123 << 5, 0x123 << 21
    for bank, words in enumerate([(narrow, narrow), (wide, 0xFFFFFFFF), (0, wide), (narrow, narrow)]):
        for place, word in enumerate(words):
            can.write(CAN + 0x240 + 8 * bank + 4 * place, word)
    for active, index in ((0b1111, 6), (0b1011, 4), (0b1001, 0), (0b1000, 7)):
        can.write(FMR, 1)
        can.write(FA1R, active)
        can.write(FMR, 0)
        assert can.machine.can.match(frame(0x123)) == (0, index)


@pytest.mark.parametrize(("mode", "last"), [(0, 5), (RFLM, 3)])
def test_a_full_fifo(can: Controller, mode: int, last: int) -> None:
    can.start(mode)
    can.write(IER, 2 | 8)
    for number in range(1, 6):
        can.wire.send(frame(0x100 + number, bytes([number] * number)))
    can.machine.advance_us(2000)
    assert can.read(RF0R) == 0x10 | 8 | 3
    assert [can.received()[0] for _ in range(3)] == [0x101, 0x102, 0x100 + last]
    assert can.read(RF0R) == 0x10
    can.write(RF0R, 0x10)
    assert can.read(RF0R) == 0
    can.wire.send(frame(0x7FF, b"12345"))
    can.machine.advance_us(500)
    assert can.received() == (0x7FF, 0, b"12345")


def test_a_release_may_take_its_time(can: Controller) -> None:
    can.start()
    can.machine.can.release_ticks = 40320  # 1 us
    for identifier in (0x101, 0x102):
        can.wire.send(frame(identifier))
    can.machine.advance_us(1000)
    assert can.received()[0] == 0x101
    assert can.read(RF0R) == 32 | 2  # under way, and still the same frame
    can.write(RF0R, 32)  # once is enough
    can.machine.advance_us(2)
    assert can.read(RF0R) == 1
    assert can.received()[0] == 0x102


def test_error_states_and_bus_off(can: Controller) -> None:
    can.start()
    can.fill(0, 0x100)
    states: list[tuple[int, int]] = []
    can.wire.fail_sending.extend([5] * 32)
    for _ in range(2000):
        can.machine.advance_us(10)
        value = can.read(ESR)
        if not states or states[-1][1] != value & 7:
            states.append((value >> 16 & 0xFF, value & 7))
    assert states == [(0, 0), (96, EWGF), (128, EWGF | EPVF), (0, EWGF | EPVF | BOFF)]
    can.machine.advance_us(100_000)
    assert can.read(ESR) & BOFF  # for ever, without software
    can.write(MCR, INRQ)
    can.write(MCR, 0)
    can.machine.advance_us(11 * 2 + 4)
    assert not can.read(MSR) & INRQ  # out of initialisation, not yet on the bus
    can.machine.advance_us(128 * 11 * 2 - 40)
    assert can.read(ESR) & BOFF
    assert can.frames_on_bus(1000) == [0x100]
    assert can.read(ESR) & ~(7 << 4) == 0


def test_automatic_recovery_from_bus_off(can: Controller) -> None:
    can.start(ABOM)
    can.fill(0, 0x100)
    can.wire.fail_sending.extend([5] * 32)
    assert can.frames_on_bus(30_000) == [0x100]
    assert can.read(ESR) & BOFF == 0


def test_alone_on_the_bus_it_never_goes_off(can: Controller) -> None:
    can.start()
    can.wire.acknowledged = False
    can.fill(0, 0x100)
    assert can.frames_on_bus(200_000) == []
    assert can.read(ESR) == 128 << 16 | 3 << 4 | EPVF | EWGF
    can.wire.acknowledged = True
    assert can.frames_on_bus(1000) == [0x100]


def test_receive_errors_count_up_and_down(can: Controller) -> None:
    can.start()
    can.wire.fail_receiving.extend([1] * 5)
    for number in range(8):
        can.wire.send(frame(number))
    can.machine.advance_us(1600)
    assert can.read(ESR) >> 24 == 5
    can.machine.advance_us(5000)
    assert can.read(ESR) >> 24 == 0


def test_a_dominant_bus_lets_nobody_join(can: Controller) -> None:
    can.wire.short(True)
    can.write(MCR, INRQ)
    can.write(BTR, BIT_8MHZ_500K)
    can.write(MCR, 0)
    can.machine.advance_us(10_000)
    assert can.read(MSR) & 1
    can.wire.short(False)
    can.machine.advance_us(23)
    assert not can.read(MSR) & 1


def test_interrupts(can: Controller) -> None:
    from plumb.f103.peripherals.bxcan import RX0_IRQ, SCE_IRQ, TX_IRQ

    can.start()

    def level(irq: int) -> bool:
        return bool(can.machine.nvic.level >> 16 + irq & 1)

    can.write(IER, 1 | 2 | 1 << 10 | 1 << 15)
    can.fill(0, 0x100)
    assert not level(TX_IRQ)
    can.machine.advance_us(500)
    assert level(TX_IRQ)
    can.write(TSR, 1)
    assert not level(TX_IRQ)
    can.wire.send(frame(0x50))
    can.machine.advance_us(500)
    assert level(RX0_IRQ)
    can.received()
    assert not level(RX0_IRQ)
    can.wire.fail_sending.extend([5] * 32)
    can.fill(0, 0x100)
    can.machine.advance_us(20_000)
    assert level(SCE_IRQ) and can.read(MSR) & 4
    can.write(MSR, 4)
    assert not level(SCE_IRQ)
