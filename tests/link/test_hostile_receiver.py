"""What the pilot has promised, on a line on which anything may come: drawn streams against what was truly said."""

from __future__ import annotations

import ctypes
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import pytest

from plumb.spec import crsf
from support import link_functions
from support.campaigns import campaign
from support.hostile_line import BYTE_US, OFF, ON, Line, Said, drawn

TURN_US, SECONDS = 1000, 4.0
SILENCE_US, PAUSE_US, EQUAL = 100_000, 5000, 3
FRAME_US = 26 * BYTE_US
LATE_US = 2 * (PAUSE_US + 2 * TURN_US + FRAME_US) + TURN_US
"""So late a frame may be behind a false length: two more frames pass, and before each a pause that the loop, which
measures in turns, does not see."""
BLOCK, WHOLE = 10, 60
BEGIN_US = (1 << 32) - 2_000_000
"""The board's clock at the begin: it wraps two seconds later."""


class Row(ctypes.Structure):
    """receiver_turn_t of tests/c/link_functions.c."""

    _fields_ = [(name, ctypes.c_int32) for name in (
        "live", "on", "off", "lost", "number", "throttle", "roll", "pitch", "yaw", "switches", "receiver",
    )]  # fmt: skip


@dataclass(frozen=True)
class Obeyed:
    """A frame that the board has obeyed, in a turn."""

    turn: int
    said: Said


def turns_of(line: Line, turn_us: int = TURN_US, *, by_sticks: bool = False) -> Sequence[Row]:
    """What the receiver is after each turn of the loop, until it must be silent."""
    rows = (Row * (int(line.now_us + 3 * SILENCE_US) // turn_us))()
    after_us = (ctypes.c_uint64 * len(line.after_us))(*line.after_us)
    link_functions.library().receiver_turns(
        bytes(line.bytes_), after_us, ctypes.c_size_t(len(line.bytes_)), ctypes.c_uint32(BEGIN_US),
        ctypes.c_uint32(turn_us), ctypes.c_uint32(by_sticks), rows, ctypes.c_size_t(len(rows)),
    )  # fmt: skip
    return list(rows)


def throttle_of(value: int) -> int:
    return (value - crsf.LOW) * 32767 // 1639


def roll_of(value: int) -> int:
    away = (value - crsf.MIDDLE) * 32767
    return abs(away) // 819 * (1 if away > 0 else -1)


def obeyed_of(line: Line, rows: Sequence[Row]) -> list[Obeyed]:
    """The frames that the board has obeyed, in order; of several in one turn the last one is seen in the words."""
    words = {(throttle_of(one.throttle), roll_of(one.serial)): at for at, one in enumerate(line.said)}
    found: list[Obeyed] = []
    number, newest = 0, -1
    for turn, row in enumerate(rows):
        new = (row.number - number) % 255
        number = row.number
        if not new:
            assert turn == 0 or (row.throttle, row.roll) == (rows[turn - 1].throttle, rows[turn - 1].roll), turn
            continue
        assert (row.throttle, row.roll) in words, f"turn {turn}: nobody has said that"
        assert (row.pitch, row.yaw) == (0, 0), turn
        same = [at for at, one in enumerate(line.said) if one.bytes_ == line.said[words[row.throttle, row.roll]].bytes_]
        last = max(at for at in same if line.said[at].end_us <= turn * TURN_US + 1)
        assert last > newest, f"turn {turn}: an older frame than that before"
        found += [Obeyed(turn, line.said[at]) for at in range(max(newest, last - new) + 1, last + 1)]
        newest = last
    return found


def lost_spans(line: Line) -> Iterator[tuple[float, float]]:
    """Times in which the receiver has certainly said that it has no signal: begin and end."""
    ends = [*line.qualities[1:], (line.now_us + 10 * SILENCE_US, 1)]
    for (begin_us, quality), (end_us, _) in zip(line.qualities, ends, strict=True):
        if quality == 0 and end_us - begin_us > LATE_US + 2 * TURN_US:
            yield begin_us + LATE_US, end_us - 14 * BYTE_US


@pytest.mark.parametrize("block", range(campaign(3, WHOLE)))
def test_whatever_comes_the_board_obeys_what_was_said_in_time_and_in_order(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        line = drawn(seed, SECONDS)
        rows = turns_of(line)
        obeyed = obeyed_of(line, rows)
        assert obeyed, seed
        late = max(one.turn * TURN_US - one.said.end_us for one in obeyed)
        assert late <= LATE_US, f"seed {seed}: {late} us"


@pytest.mark.parametrize("block", range(campaign(3, WHOLE)))
def test_the_receiver_is_lost_100_ms_after_the_last_frame_and_while_the_quality_is_0(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        line = drawn(seed, SECONDS)
        rows = turns_of(line)
        obeyed = {one.turn for one in obeyed_of(line, rows)}
        newest = -SILENCE_US
        for turn, row in enumerate(rows):
            newest = turn if turn in obeyed else newest
            silent = (turn - newest) * TURN_US > SILENCE_US
            assert not (row.live and silent), f"seed {seed}, turn {turn}"
            assert row.live or silent or row.lost, f"seed {seed}, turn {turn}"
        for begin_us, end_us in lost_spans(line):
            inside = range(int(begin_us) // TURN_US + 1, int(end_us) // TURN_US)
            assert not obeyed & set(inside), f"seed {seed}: a frame without a transmitter"
            assert not any(rows[turn].live for turn in inside), f"seed {seed}"


@pytest.mark.parametrize("block", range(campaign(3, WHOLE)))
def test_a_switch_turns_by_three_frames_in_a_row_and_off_is_seen_in_as_many(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        line = drawn(seed, SECONDS)
        rows = turns_of(line)
        obeyed = obeyed_of(line, rows)
        for turn, row in enumerate(rows[1:], 1):
            if row.on != rows[turn - 1].on:
                assert asked(obeyed, rows, turn, ON if row.on else OFF, seen=bool(row.on)), f"seed {seed}, turn {turn}"
            if row.off and not rows[turn - 1].off:
                assert asked(obeyed, rows, turn, OFF, seen=True), f"seed {seed}, turn {turn}"


def asked(obeyed: Sequence[Obeyed], rows: Sequence[Row], turn: int, position: int, *, seen: bool) -> bool:
    """Three frames in a row have asked for this position, the last of them in this turn. seen: the receiver's frames
    came from the first on."""
    lasts = [place for place, one in enumerate(obeyed) if one.turn == turn]
    triples = [obeyed[place - EQUAL + 1 : place + 1] for place in lasts if place >= EQUAL - 1]
    return any(
        all(one.said.switch == position for one in triple)
        and not (seen and any(not rows[at].live for at in range(triple[0].turn, turn)))
        for triple in triples
    )


@pytest.mark.parametrize("block", range(campaign(3, WHOLE)))
def test_what_comes_between_costs_two_frames_at_most(block: int) -> None:
    costly = disturbances = 0
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        line = drawn(seed, SECONDS)
        rows = turns_of(line)
        known = [(one.turn, one.said.serial) for one in obeyed_of(line, rows)]
        for (_, end_us), (begin_us, _) in zip(line.disturbed, [*line.disturbed[1:], (line.now_us, 0.0)], strict=True):
            disturbances += 1
            between = [one for one in line.said if end_us < one.end_us - FRAME_US and one.end_us < begin_us]
            for one in between[2:4]:
                turn = int(one.end_us) // TURN_US + 1
                live = not any(begin - LATE_US < one.end_us < end + LATE_US for begin, end in lost_spans(line))
                costly += (
                    live
                    and not rows[turn].lost
                    and not any(serial == one.serial and at <= turn for at, serial in known)
                )
    assert disturbances > 100 and costly == 0, f"{costly} of {disturbances}"


def test_a_false_length_before_every_frame_takes_none_away() -> None:
    """Faster than the pauses between frames they come late, else at the next pause."""
    for every_us in (1000, 4000, 10_000, 40_000):
        line = Line(random.Random(every_us))
        for number in range(60):
            line.disturb(bytes([crsf.SYNC, 62]))
            line.good(OFF, 172 + number)
            line.pause(every_us - (line.now_us % every_us))
        assert len(obeyed_of(line, turns_of(line))) == 60, every_us


@pytest.mark.parametrize("away_us", [(1 << 32) + 30_000, (1 << 32) + 60_000, 1_000_000])
def test_a_gesture_begins_anew_after_a_silence_of_any_length(away_us: int) -> None:
    """Of 71 minutes and 35 seconds, too, after which the board's clock shows the same."""
    line = Line(random.Random(1))
    gesture = crsf.sticks(yaw=-1.0)
    for _ in range(50):
        line.passes(gesture)
        line.pause(20_000 - 26 * BYTE_US)
    line.pause(away_us)
    for _ in range(25):
        line.pause(20_000 - 26 * BYTE_US)
        line.passes(gesture)
    assert not any(row.on for row in turns_of(line, 20_000, by_sticks=True)[-45:])
