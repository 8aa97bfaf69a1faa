"""Values with which a board would break a numbered promise when armed: named alike by host and board, and refused."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from plumb.link import parameter_table
from plumb.link.identity import NackError
from plumb.link.monitor import Monitor
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import armed_values, parameters
from plumb.spec.parameter_file import warnings
from plumb.systems import shipped_tunings
from support import link_functions
from support.declared_systems import without_output
from support.native_board import NewBoard, UartBoard
from support.sessions import CONTROL, listen

ROWS = parameters.table()
NAMES = [row.name for row in ROWS]
TABLE = shipped_tunings.table_of("quad", "hold")
ENDS = [
    (row.name, value)
    for row in ROWS
    if row.armed
    for value in sorted({row.min, row.armed[0] - 1, row.armed[1] + 1, row.max})
    if row.min <= value <= row.max and not row.armed[0] <= value <= row.armed[1]
]
JOINED = [
    ({"gyro.gain": 0}, "gyro.gain"),
    ({"gyro.gain": 1}, "gyro.raw_max"),
    ({"gyro.raw_max": 1700}, "gyro.raw_max"),
    ({"gyro.raw_min": 1650}, "gyro.raw_min"),
    ({"accel.raw_max": 3500}, "accel.raw_max"),
    ({"accel.gain": 0, "accel.offset": 0}, "accel.gain"),
    ({"accel_up.gain": 0, "accel_up.offset": 1 << 26}, "accel_up.gain"),
    ({"accel_up.gain": 33792, "accel_up.offset": -2048 * 33792 + (1 << 25)}, "accel_up.raw_min"),
    ({"variance_turn2_q56": 0xFFFFFFFF}, "tilt.r_base"),
]
"""Words of a condition that hide a wrong sensor, and the one that is named."""


def unsafe_name(values: dict[str, int]) -> str:
    found = armed_values.unsafe(values)
    return found.row.name if found else ""


def test_host_and_board_name_the_same_parameter() -> None:
    """Two hands: the generated C and this package, on tables with words at the ends of their ranges."""
    chance = random.Random(4)
    limited = [row for row in ROWS if row.weakens]
    seen = set()
    for _ in range(4000):
        values = dict(TABLE)
        for row in chance.sample(limited, chance.choice((1, 1, 2, 5))):
            near = [row.min, row.max, *row.armed, *(end + by for end in row.armed for by in (-1, 1))]
            near += [chance.randint(row.min, row.max), -values[row.name], values[row.name] // 3]
            values[row.name] = min(max(chance.choice(near), row.min), row.max)
        index = link_functions.unsafe([values[name] for name in NAMES])
        assert (NAMES[index] if index < len(NAMES) else "") == unsafe_name(values)
        seen.add(index)
    assert len(seen) > 12


@pytest.mark.parametrize(("changes", "named"), JOINED)
def test_words_that_hide_a_sensor_together_are_unsafe(changes: dict[str, int], named: str) -> None:
    assert unsafe_name(TABLE) == ""
    assert unsafe_name({**TABLE, **changes}) == named


def test_what_is_shipped_can_be_armed() -> None:
    from plumb import systems

    driven = [name for name in systems.SYSTEMS if systems.load(name).OUTPUT_FRAMES]
    tables = [shipped_tunings.table_of(name, tuning) for name in driven for tuning in systems.load(name).TUNINGS]
    assert len(tables) > 10 and all(unsafe_name(values) == "" for values in tables)


def test_a_system_that_drives_nothing_has_no_unsafe_parameter() -> None:
    assert unsafe_name({**shipped_tunings.table_of(without_output(), None), "rail_ms": 0}) == ""


def test_every_parameter_says_what_it_can_weaken() -> None:
    """A promise and a limit, or why there is none; the promises are those of security.md."""
    assert armed_values.conditions()
    assert [row.name for row in ROWS if bool(row.weakens) == bool(row.harmless)] == []
    page = Path(__file__).parents[2] / "docs" / "explanation" / "security.md"
    numbers = {int(number) for number in re.findall(r"(?m)^(\d+)\. \*\*", page.read_text(encoding="utf-8"))}
    assert {number for row in ROWS for number in row.weakens} <= armed_values.promises().keys() <= numbers


def connected(board: UartBoard, **changes: int) -> Session:
    session = Session(PlumbBus(board))
    session.connect()
    session.upload(CONTROL, **changes)
    session.begin("REALTIME_LIVE")
    return session


@pytest.mark.parametrize(("name", "value"), [end for end in ENDS if "." not in end[0]])
def test_an_unsafe_parameter_is_refused_by_name(new_board: NewBoard, name: str, value: int) -> None:
    """By the NACK of ARM, in STATUS, in the identity, and in the sentences of the host; and armed again without it."""
    board = new_board()
    session = connected(board, **{name: value})
    with pytest.raises(NackError, match=rf"refused to arm: {name}: {value}.* would break promise \d") as refused:
        session.arm(ready_wait_s=0.0)
    assert (refused.value.reason, refused.value.detail) == ("UNSAFE_PARAMETER", NAMES.index(name))
    monitor = Monitor(session)
    session.listener = monitor.feed
    listen(session, 0.3)
    assert session.telemetry["STATUS"]["blocked"] >> 14 & 1 and not board.armed
    assert monitor.snapshot()["blocked"][0].startswith(f"{name}: {value}")
    session.end()
    assert session.connect()["UNSAFE_PARAMETER"] == NAMES.index(name)
    session.upload(CONTROL, period_us=1000)
    session.begin("REALTIME_LIVE")
    session.arm()
    assert board.armed
    session.close()


def test_the_index_alone_has_a_sentence_too(new_board: NewBoard) -> None:
    """A host that has neither read nor committed the table."""
    board = new_board()
    connected(board, rail_ms=0).close()
    session = Session(PlumbBus(board))
    session.connect()
    session.begin("REALTIME_LIVE")
    with pytest.raises(NackError, match="rail_ms: its value would break promise 7, a lost, stuck"):
        session.arm(ready_wait_s=0.0)


def test_a_saved_table_with_unsafe_values_loads_with_its_calibration(new_board: NewBoard) -> None:
    """What older versions saved: it loads, runs unarmed, and is refused by name."""
    board = new_board()
    session = Session(PlumbBus(board))
    session.connect()
    old = {**TABLE, "stuck_ms": 10_000, "esc.neutral_halfus": 2200, "esc.min_halfus": 2200}
    old["gyro.offset"] += 12345
    parameter_table.commit(session, old)
    session.execute("SAVE")
    session.execute("DEFAULTS")
    session.execute("LOAD")
    assert dict(zip(NAMES, parameter_table.read_table(session), strict=True)) == old
    session.begin("REALTIME_LIVE")
    with pytest.raises(NackError) as refused:
        session.arm(ready_wait_s=0.0)
    assert refused.value.reason == "UNSAFE_PARAMETER" and refused.value.detail == NAMES.index("esc.neutral_halfus")


def test_a_long_neutral_pulse_is_sent_as_1000_us(new_board: NewBoard) -> None:
    board = new_board()
    session = Session(PlumbBus(board))
    session.connect()
    for neutral, sent in ((2100, 2100), (2101, 2000), (2200, 2000)):
        parameter_table.commit(session, {**TABLE, "esc.neutral_halfus": neutral, "esc.min_halfus": 2200})
        session.begin("REALTIME_LIVE")
        listen(session, 0.1)
        assert set(board.pulses) == {sent}
        session.end()


def test_the_host_warns_before_the_board_refuses() -> None:
    assert warnings({**TABLE, "rail_ms": 0}) == [
        "the board takes this, and is not armed with it: rail_ms: 0 (0 ms) would break promise 7, "
        f"{armed_values.promises()[7]}: set 1 (1 ms) to 100 (100 ms)"
    ]
    assert warnings(TABLE) == []
