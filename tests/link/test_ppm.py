"""The pulse train of a receiver: what its frames become, which frames are none, and how a pilot arms by it."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from plumb.boards.pulse_train import on_native
from plumb.spec import crsf, ppm
from support.piloted_board import HOLD_S, NEUTRAL_HALFUS, OFF, ON, Field, turns
from support.receiver_twin import pulses_by_firmware, pulses_by_twin

BY_SWITCH, BY_STICKS = 3, 4
REST = [1500, 1500, 988, 1500, 988, 988, 988, 988]


def train(frames: Sequence[Sequence[int]], begin_us: int = 1000, period_us: int = ppm.FRAME_US) -> list[int]:
    """The edges of frames with these widths."""
    return [begin_us + period_us * k + edge for k, widths in enumerate(frames) for edge in ppm.edges_us(widths)]


@pytest.mark.parametrize(
    ("widths", "words"),
    [
        (REST, (0, 0, 0, 0, 0)),
        ([2012, 988, 2012, 2012, 988, 988], (32767, 32767, -32767, -32767, 0)),
        ([988, 2012, 1500, 988, 988, 988], (16393, -32767, 32767, 32767, 0)),
        ([2250, 750, 2250, 750, 988, 988], (32767, 32767, -32767, 32767, 0)),
        ([1501, 1499, 989, 1500, 988, 988], (39, 40, -80, 0, 0)),
    ],
)
def test_widths_become_sticks_on_the_scale_of_crsf(widths: list[int], words: tuple[int, ...]) -> None:
    (row,) = pulses_by_firmware(train([widths + REST[len(widths) :]]))
    assert row.words == (*words, 1)


def test_a_channel_of_crsf_and_its_pulse_are_the_same_stick() -> None:
    for value in range(172, 1812):
        (row,) = pulses_by_firmware(train([ppm.widths_us([value, 992, 172, 992])]))
        stick = min(max(value - 992, -819), 819) * 32767 / 819
        assert abs(row.words[1] - stick) <= 32767 / 819 + 1, (
            "a channel: 0.8 of half a microsecond, and the rounding down"
        )


DAMAGED = {
    "seven channels": REST[:7],
    "nine channels": [*REST, 1500],
    "too short": [*REST[:3], 749, *REST[4:]],
    "too long": [*REST[:3], 2251, *REST[4:]],
    "one split in two": [*REST[:3], 700, 800, *REST[4:]],
    "one edge missing": [*REST[:2], 2488, *REST[4:]],
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_frame_is_none_and_the_next_one_counts(case: str) -> None:
    rows = pulses_by_firmware(train([REST, DAMAGED[case], REST]))
    assert [row.words[-1] for row in rows] == [1, 2]
    assert [row.channels for row in rows] == [tuple(REST)] * 2


def test_a_pause_of_the_length_of_the_timer_is_no_channel() -> None:
    """The stamps are modulo 65536 us: an edge 67 ms after the last one looks like a channel of 1.5 ms."""
    half = ppm.edges_us(REST[:4])
    edges = [1000 + edge for edge in half] + [1000 + half[-1] + 65_536 + 1500 + edge for edge in ppm.edges_us(REST[:3])]
    assert len(edges) == 9 and not pulses_by_firmware(edges)


def test_a_switch_turns_with_the_third_frame_in_a_row() -> None:
    on = [*REST[:4], 1626, *REST[5:]]
    near = [*REST[:4], 1624, *REST[5:]]
    rows = pulses_by_firmware(train([REST, on, on, near, on, on, on, near, near]))
    assert [row.words[4] for row in rows] == [0, 0, 0, 0, 0, 0, 1, 1, 1]


def test_the_failsafe_of_the_receiver_is_a_receiver_that_is_lost() -> None:
    failsafe = [2000, 1000, 949, 2000, 2012, 2012, *REST[6:]]
    rows = pulses_by_firmware(train([REST, failsafe, failsafe, failsafe, failsafe, [*REST[:2], 950, *REST[3:]]]))
    assert [row.words[-1] for row in rows] == [1, 1, 1, 1, 1, 2], "its frames count as missing"
    assert all(row.words[:5] == (0, 0, 0, 0, 0) for row in rows), "sticks and switches stay as they are"


@pytest.mark.parametrize("turn_us", [200, 1000, 1500])
def test_random_trains_are_those_of_a_second_program(turn_us: int) -> None:
    chance = random.Random(turn_us)
    edges, at = [], 1000
    for _ in range(400):
        count = chance.choice([8, 8, 8, 8, 7, 9, 1, 16])
        widths = [chance.choice([chance.randint(750, 2250), 988, 2012]) for _ in range(count)]
        if chance.random() < 0.2:
            widths[chance.randrange(count)] = chance.choice([2, 749, 2251, 2600])
        edges += [at + edge for edge in ppm.edges_us(widths)]
        at = edges[-1] + chance.choice([6000, 10_000, 64_000, 66_500, 131_000])
    expected = pulses_by_twin(edges)
    assert len(expected) > 100 and pulses_by_firmware(edges, turn_us) == expected


def piloted(receiver: int) -> Field:
    field = Field(OFF, receiver=receiver)
    field.transmit = on_native(field.board.mcu).receive
    return field


def test_a_pilot_arms_and_disarms_by_pulses() -> None:
    field = piloted(BY_SWITCH)
    field.arms()
    field.pilot(crsf.sticks(throttle=0.3, on=True), HOLD_S)
    assert turns(field.pulses)
    field.pilot(crsf.sticks(throttle=0.3), 0.15)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4


def test_a_pilot_arms_by_the_sticks_of_a_pulse_train() -> None:
    field = piloted(BY_STICKS)
    field.passes(4.0)
    field.pilot(crsf.sticks(yaw=-1.0), 1.4)
    assert field.board.armed


def test_pulses_that_stop_or_fail_safe_are_a_receiver_that_is_lost() -> None:
    field = piloted(BY_SWITCH)
    field.passes(4.0)
    assert not field.missing
    field.pilot(b"", 0.25)
    assert "receiver" in field.missing
    field.pilot(OFF, 0.3)
    assert not field.missing
    field.pilot(OFF + crsf.statistics(0), 0.3)
    assert "receiver" in field.missing


@pytest.mark.parametrize(("receiver", "other"), [(1, BY_SWITCH), (BY_SWITCH, 1)])
def test_the_line_that_the_parameter_does_not_name_is_not_read(receiver: int, other: int) -> None:
    field = Field(OFF, receiver=receiver)
    wires = {1: field.board.mcu.receiver_send, BY_SWITCH: on_native(field.board.mcu).receive}
    field.transmit = wires[other]
    field.passes(4.0)
    assert "receiver" in field.missing
    field.transmit = wires[receiver]
    field.arms()
    field.transmit = wires[other]
    field.pilot(ON, 0.3)
    assert not field.board.armed and "the receiver was lost" in field.why_disarmed
