"""Trouble while the board drives: outputs neutral in time, latched, and reported."""

from __future__ import annotations

import pytest

from plumb.link.session import Session
from plumb.spec import parameters
from support.native_board import NewBoard, UartBoard
from support.sessions import CONTROL
from support.transcripts import frame, said

NEUTRAL = {next(row.default for row in parameters.table() if row.name == "esc.neutral_halfus")}
RAIL_US = 1000 * next(row.default for row in parameters.table() if row.name == "rail_ms")
SAFE_US = 50_000
"""Whatever happens to the link or the loop: outputs are neutral this long after."""
LOOK_US = 2000
"""The loop sleeps for a millisecond at most."""
CHECKED_US = 3600
"""From one check of the guarded memory to the next while armed, promise 9 of docs/explanation/security.md."""
FRAME_US = 2500
FAULT_CAUSE, KEEPALIVE_CAUSE = 0x08, 0x20
ADC, SENSOR, UART, WATCHDOG, UPSET = 0x0001, 0x0040, 0x0200, 0x0400, 0x4000


def driving(board: UartBoard, link: str = "serial") -> Session:
    """Armed over this link, kept alive, the outputs away from neutral."""
    session = Session.open(board) if link == "serial" else Session.over(board.can_bus())
    session.upload(CONTROL, period_us=4000, arm_hold_ms=0, esc_period_us=FRAME_US)
    session.begin("REALTIME_LIVE")
    session.arm()
    listen(session, 0.05)
    assert board.armed and not NEUTRAL & set(board.pulses)
    return session


def listen(session: Session, seconds: float) -> dict[str, dict[str, int]]:
    """Answer keep-alives for a while; the telemetry that came last."""
    end_s = session.clock() + seconds
    while session.clock() < end_s:
        session.receive(0.005)
    return session.telemetry


def resting(board: UartBoard) -> bool:
    return set(board.pulses) == NEUTRAL and not board.armed


@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_converter_that_stops_disarms_latched_and_is_reported(new_board: NewBoard, link: str) -> None:
    board = new_board()
    session = driving(board, link)
    board.stop_converter()
    listen(session, 0.03)
    assert resting(board)
    report = listen(session, 0.3)
    assert report["STATUS"]["faults"] & ADC and report["EVENTS"]["disarm_cause"] == FAULT_CAUSE
    assert resting(board)
    session.close()


@pytest.mark.parametrize("channel", [0, 2])
def test_an_input_at_its_rail_disarms_within_the_limit(new_board: NewBoard, channel: int) -> None:
    board = new_board()
    session = driving(board)
    board.rail_input(channel)
    listen(session, (RAIL_US + SAFE_US) * 1e-6)
    assert resting(board)
    assert listen(session, 0.3)["EVENTS"]["disarm_cause"]
    assert session.telemetry["SENSORS"]["analog"] & 0xFF == 1 << channel
    session.close()


def test_a_loop_that_hangs_is_neutral_in_time_and_reset(new_board: NewBoard) -> None:
    board = new_board()
    silent = driving(board)  # kept: collected, it would send its C in the middle of what follows
    board.hang()
    board.run_us(20_000 + FRAME_US)
    assert set(board.pulses) == NEUTRAL
    board.run_us(60_000)
    with Session.open(board) as session:
        assert session.connect()["FAULTS"] & WATCHDOG and resting(board)
    silent.close()


def test_bytes_with_a_framing_error_are_counted_and_the_link_goes_on(new_board: NewBoard) -> None:
    board = new_board()
    session = driving(board)
    board.damage(b"x")
    assert listen(session, 0.3)["STATUS"]["faults"] & UART and board.armed
    session.end()
    assert session.connect()["FAULTS"] >> 16 & 0xFF >= 1
    assert session.read_parameters()[: len(CONTROL)] == CONTROL
    session.close()


def test_a_shorted_bus_disarms_and_comes_back(new_board: NewBoard) -> None:
    board = new_board()
    silent = driving(board, "can")
    board.short_can(True)
    board.run_us(SAFE_US)
    assert resting(board)
    board.run_us(100_000)
    board.short_can(False)
    board.run_us(2_100_000)  # the longest pause after bus-off, twice
    with Session.over(board.can_bus()) as again:
        report = listen(again, 0.4)
        assert report["CAN_HEALTH"]["bus_offs"] >= 1 and resting(board)
    silent.close()


@pytest.mark.parametrize(("share", "later_us"), [(0.02, 0), (0.3, 1000), (0.6, 2000), (0.95, 3000)])
def test_a_flipped_bit_is_found_as_soon_as_promised(new_board: NewBoard, share: float, later_us: int) -> None:
    """Wherever in a period it flips: also behind a step, where the next one is 4 ms away."""
    board = new_board()
    session = driving(board)
    board.run_us(later_us)
    board.flip(share, 3)
    board.run_us(CHECKED_US)
    assert resting(board)
    report = listen(session, 0.3)
    assert report["STATUS"]["faults"] & UPSET and report["EVENTS"]["disarm_cause"] == FAULT_CAUSE
    session.close()


def test_a_clock_that_is_set_back_disarms_and_is_reported(new_board: NewBoard) -> None:
    board = new_board()
    session = driving(board)
    board.set_clock_back()
    board.run_us(2 * LOOK_US)
    assert resting(board)
    assert listen(session, 0.3)["STATUS"]["faults"] & UPSET
    session.close()


@pytest.mark.parametrize("operation", [1, 2, 3, 100, 300])
def test_power_that_fails_in_a_save_leaves_the_old_set_or_the_new_one(new_board: NewBoard, operation: int) -> None:
    board = new_board()
    for period_us in (3000, 4000):
        with Session.open(board) as session:
            session.upload(CONTROL, period_us=period_us)
            if period_us == 3000:
                session.execute("SAVE")
            else:
                verb = session.protocol["EXECUTE"].value("verb", "SAVE")
                nonce = said(board.say(frame("CHALLENGE", verb, 0)))[0][1]["nonce"]
                board.write_and_cut_power(frame("EXECUTE", verb, nonce), operation)
                break
    board.reset()
    with Session.open(board) as session:
        identity = session.connect()
        values = session.read_parameters()
    wholes = [parameters.whole_table(CONTROL, period_us=period_us) for period_us in (3000, 4000)]
    assert values in wholes and identity["FAULTS"] & 0xFF == 0
