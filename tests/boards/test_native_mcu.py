"""The native port misbehaves on request as the chip would, and the shipped loop says so."""

from __future__ import annotations

import pytest

from plumb.boards.native.mcu import NativeCanBus, NativeMcu, State
from plumb.errors import LinkError
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from support.native_board import BAUD_921600_NS, UartBoard
from support.sessions import CONTROL, armed_session

IMAGE, CLOCK, UART, WATCHDOG, CAN, STRAP = 0x0008, 0x0100, 0x0200, 0x0400, 0x0800, 0x8000
CAN_FRAME_NS = 130_000
"""At 1 Mbit/s."""


def faults(board: UartBoard) -> int:
    with Session.open(board) as session:
        return session.connect()["FAULTS"]


def test_two_boards_in_a_process_know_nothing_of_each_other() -> None:
    one, other = UartBoard(), UartBoard()
    with Session.open(one) as session:
        session.upload(CONTROL, period_us=3000)
        session.execute("SAVE")
    assert bytes(other.flash_cells()) == b"\xff" * 4096 != bytes(one.flash_cells())
    with Session.open(other) as session:
        assert session.connect().parameter_source == "factory defaults"


def test_the_same_calls_give_the_same_bytes() -> None:
    def live_bytes() -> bytes:
        board = UartBoard()
        with Session.open(board) as session:
            session.begin("REALTIME_LIVE")
            board.received()
            board.run_us(200_000)
            return board.received()

    assert live_bytes() == live_bytes() != b""


def test_a_flash_that_refuses_is_reported_and_the_set_in_use_stays() -> None:
    board = UartBoard()
    board.wires.flash_refuses = 1
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000)
        with pytest.raises(LinkError, match="its flash does not take it"):
            session.execute("SAVE")
        index = [row.name for row in parameters.table()].index("period_us")
        assert session.read_parameters()[index] == 3000


def test_a_loop_too_late_for_its_ring_loses_bytes_and_counts_them() -> None:
    board = UartBoard()
    board.baud(down_ns=BAUD_921600_NS)
    board.write(b"\r" * 4000)
    board.turn(15_000)  # 11 ms fill the ring
    assert faults(board) & UART


def test_a_loop_too_late_for_a_flood_of_frames_says_so() -> None:
    board = UartBoard()
    board.run_us(2000)
    board.wires.can_frame_ns = CAN_FRAME_NS
    message = protocol()["KEEPALIVE"]
    for counter in range(60):
        board.mcu.can_send(message.identifier, message.pack(counter & 15, 0, 0, 1))
    board.turn(10_000)
    assert faults(board) & CAN


def test_turns_that_miss_their_deadline_end_in_a_reset() -> None:
    board = UartBoard()
    board.wires.turn_us = 12_000
    board.run_us(200_000)
    assert board.wires.resets
    board.wires.turn_us = 0
    assert faults(board) & WATCHDOG


def test_without_a_crystal_the_board_stays_off_the_bus() -> None:
    board = UartBoard()
    board.wires.no_crystal = 1
    board.reset()
    assert faults(board) & CLOCK
    with NativeCanBus(board.mcu) as bus, pytest.raises(LinkError, match="does not answer"):
        Session.over(bus)


def test_a_bus_with_nobody_on_it_stops_nothing() -> None:
    board = UartBoard()
    with NativeCanBus(board.mcu) as bus:
        Session.over(bus)
        board.wires.can_kbit = 0
        session = armed_session(board)
        for _ in range(100):
            session.receive(0.01)
        assert board.armed and session.telemetry["CAN_HEALTH"]["bus_off"] == 0
        session.close()


@pytest.mark.parametrize(("wire", "value", "fault"), [("image_damaged", 1, IMAGE), ("strap", 1, STRAP)])
def test_what_is_wrong_at_the_start_blocks_arming(wire: str, value: int, fault: int) -> None:
    board = UartBoard()
    setattr(board.wires, wire, value)
    board.reset()
    with Session.open(board) as session:
        assert session.connect()["FAULTS"] & fault
        session.begin("REALTIME_LIVE")
        with pytest.raises(LinkError, match=r"fault|pins"):
            session.arm()


def test_without_power_there_is_silence_and_no_pulse() -> None:
    mcu = NativeMcu(power=False)
    assert mcu.state is State.OFF
    mcu.uart.write(b"V\r")
    mcu.run_us(10_000)
    assert mcu.uart.read(10) == b"" and list(mcu.wires.pulse_halfus) == [0] * 4
    mcu.power_on()
    mcu.uart.write(b"V\r")
    assert mcu.uart.read(10) == b"V0103\r"
