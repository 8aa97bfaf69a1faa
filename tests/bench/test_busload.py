"""What the links are said to carry, against the simulated bus and the session's own pace."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from plumb import systems
from plumb.bench import bus_load
from plumb.link.board_frames import PERIODIC
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from support.native_board import UartBoard

ROOT = Path(__file__).resolve().parents[2]


def test_no_frame_is_longer_than_the_worst() -> None:
    pytest.importorskip("unicorn")
    from plumb.f103.attached.canwire import WireFrame, frame_bits

    rng = random.Random(1)
    drawn = [frame_bits(WireFrame(rng.randrange(0x800), rng.randbytes(8))) for _ in range(5000)]
    bad = frame_bits(WireFrame(0x02F, b"\x3c" * 8))  # found by search
    assert min(drawn) >= bus_load.PLAIN_BITS and max(drawn) <= bad == 131
    assert bus_load.WORST_BITS == 135  # what no pattern of bits can exceed


def test_an_idle_link_says_as_much_as_is_reckoned() -> None:
    board = UartBoard()
    with Session(PlumbBus(board)) as session:
        session.connect()
        received: list[int] = []
        session.receive(0.2)
        session.listener = lambda frames: received.extend(identifier for identifier, _ in frames)
        begin_us = board.time_us
        while board.time_us - begin_us < 2_000_000:
            session.receive(0.01)
    counted = {name: received.count(session.protocol[name].identifier) for name in PERIODIC}
    expected = {name: 2 * (bus_load.TIME_PS if name == "TIME" else bus_load.STATUS_PS) for name in PERIODIC}
    for name, count in expected.items():
        assert abs(counted[name] - count) <= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "kbit", [pytest.param(kbit, marks=[pytest.mark.long] * (kbit in (125, 500))) for kbit in bus_load.BITRATES_KBIT]
)
def test_a_bus_carries_the_steps_that_the_table_promises(kbit: int) -> None:
    """And at twice the rate the board drops telemetry, counts it, and still accepts a command to stop."""
    pytest.importorskip("unicorn")
    from plumb.boards.virtual_can import MachineBus
    from plumb.boards.virtual_machine import open_machine
    from plumb.errors import UsageError
    from plumb.flash.image import find_image

    try:
        find_image()
    except UsageError as error:
        pytest.skip(str(error))
    machine = open_machine()
    control = parameters.control_part([row.default for row in parameters.table()])
    [kind] = [kind for kind in bus_load.traffic("quad") if kind.kind.startswith("real time, own")]
    promised_us = 1e6 / kind.bus_steps_ps(kbit)
    with Session.open(machine.uart) as uart:
        uart.upload(control, can_bitrate_kbit=kbit, period_us=max(500, round(promised_us + 0.5)))
    machine.advance_us(10_000)
    machine.can.wire.kbit = kbit
    for period_us, whole in ((max(500, round(promised_us + 0.5)), True), (max(500, round(promised_us / 2)), False)):
        with Session.over(MachineBus(machine)) as session:
            session.upload(control, period_us=period_us)
            session.begin("REALTIME_LIVE", frames=("RAW_A",))
            while "COUNTERS" not in session.telemetry:
                session.receive(0.01)
            before = session.telemetry["COUNTERS"]["dropped"]
            for pause_s in (0.5, 0.25):  # in the run, and after it: a full queue cannot report its drops at once
                end_s = session.clock() + pause_s
                while session.clock() < end_s:
                    session.receive(0.01)
                session.end()
            dropped = session.telemetry["COUNTERS"]["dropped"] - before
            assert (dropped == 0) == (whole or promised_us / 2 < 500)
    assert machine.warnings == [] and machine.reset_count == 1


def test_every_system_has_its_rows() -> None:
    rows = bus_load.step_table(without="").splitlines()[2:]
    for name in systems.SYSTEMS:
        assert sum(row.startswith(f"| {name} |") for row in rows) in (3, 4)
    assert bus_load.step_table().splitlines()[2:] == [row for row in rows if bus_load.EVERY_WORD not in row]


def test_the_bit_timing_is_that_of_the_driver() -> None:
    driver = (ROOT / "firmware/ports/stm32f103/bxcan.c").read_text()
    quanta_khz = int(re.search(r"QUANTA_KHZ +(\d+)U", driver)[1])  # type: ignore[index]
    assert quanta_khz * bus_load.QUANTA == 36_000
    assert f"CAN_BTR_SJW_{bus_load.SJW} | CAN_BTR_TS2_{bus_load.PHASE_2} " in driver
    assert bus_load.clock_tolerance() == pytest.approx(0.0043, abs=5e-5)
