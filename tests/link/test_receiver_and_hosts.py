"""The switch of a pilot under slow receivers, changed parameters and hosts: what is on at first arms nothing, what was
seen off is this switch and no other, and a host that asks for the arming does not take it from him."""

from __future__ import annotations

import random

import pytest

from plumb.link.identity import NackError
from plumb.link.parameter_table import commit, read_table
from plumb.spec import crsf
from plumb.spec.parameter_file import by_name
from support.piloted_board import HOLD_S, NEUTRAL_HALFUS, OFF, ON, Field, turns

FRAMES_S = (0.005, 0.01, 0.0125, 0.02, 0.04, 0.2)
FRAMES_PER_BURST = 8


def set_receiver(field: Field, value: int) -> None:
    commit(field.session, {**by_name(read_table(field.session)), "receiver": value})


@pytest.mark.parametrize("frame_s", FRAMES_S)
@pytest.mark.parametrize("first", [b"", OFF + crsf.statistics(0)], ids=["silent", "without its transmitter"])
def test_a_switch_that_is_on_in_the_first_frame_arms_nothing_however_slow_frames_are(
    frame_s: float, first: bytes
) -> None:
    field = Field(first)
    field.passes(4.0)
    field.frame_s = frame_s
    field.pilot(ON + crsf.statistics(100) if first else ON, 2.0)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4


@pytest.mark.parametrize("frame_s", FRAMES_S)
def test_a_slow_receiver_that_comes_back_switched_on_arms_nothing(frame_s: float) -> None:
    field = Field()
    field.passes(4.0)
    field.pilot(b"", 0.3)
    field.frame_s = frame_s
    field.pilot(ON, 2.0)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4


def test_one_frame_that_says_off_is_not_seen_off() -> None:
    field = Field(b"")
    field.passes(4.0)
    field.frame_s = 0.04
    field.pilot(OFF, 0.04)
    field.pilot(ON, 2.0)
    assert not field.board.armed


def test_off_before_the_transmitter_was_lost_is_not_off_after_it() -> None:
    field = Field()
    field.passes(4.0)
    field.pilot(OFF + crsf.statistics(0), 0.3)
    field.frame_s = 0.04
    field.pilot(crsf.statistics(100), 0.04)
    field.pilot(ON, 2.0)
    assert not field.board.armed


@pytest.mark.parametrize("frame_s", [0.005, 0.02, 0.04])
def test_a_switch_seen_off_arms_at_these_rates_of_frames_and_disarms(frame_s: float) -> None:
    field = Field()
    field.frame_s = frame_s
    field.arms()
    assert turns(field.pulses)
    field.pilot(OFF, 3 * frame_s + 0.01)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4


def test_a_lock_that_was_closed_arms_nothing_when_the_receiver_is_set_to_none() -> None:
    field = Field()
    field.board.switch(True)
    field.passes(3.0)
    set_receiver(field, 0)
    field.passes(6.0)
    assert not field.board.armed, "the arm switch of the board was never seen open"
    field.board.switch(False)
    field.passes(0.1)
    field.board.switch(True)
    field.passes(5.0)
    assert field.board.armed, "closed again it arms as ever"


def test_a_pilots_switch_that_is_on_arms_nothing_when_the_receiver_is_set() -> None:
    field = Field(ON, receiver=0)
    field.passes(3.0)
    set_receiver(field, 1)
    field.passes(5.0)
    assert not field.board.armed and "switch the motors off first" in field.missing


def test_a_host_that_asks_to_arm_what_a_pilot_flies_is_refused_and_changes_nothing() -> None:
    field = Field()
    field.session.begin("REALTIME_LIVE")
    field.arms()
    with pytest.raises(NackError) as refused:
        field.session.arm(ready_wait_s=0.0)
    assert refused.value.reason == "ARMED" and "a pilot's switch holds it armed" in str(refused.value)
    assert turns(field.pulses)
    field.leaves()
    field.passes(0.5)
    assert field.board.armed and turns(field.pulses), "the board waits for no keep-alive"


def test_what_a_host_armed_the_switch_turns_on_and_off_and_a_silent_host_ends_it() -> None:
    field = Field()
    field.session.begin("REALTIME_LIVE")
    field.passes(4.0)
    field.session.arm()
    field.passes(HOLD_S + 0.1)
    assert field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4, "the pilot's switch is off"
    field.pilot(ON, 0.2)
    assert turns(field.pulses)
    field.pilot(OFF, 0.2)
    assert field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4, "the host holds it"
    field.pilot(ON, 0.2)
    field.leaves()
    field.passes(0.05)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4
    field.passes(3.0)
    assert not field.board.armed, "the switch has to be off first"


def test_the_throttle_of_a_pilot_is_reported_when_it_changes_and_never_as_timed_out() -> None:
    field = Field()
    field.arms()
    sent = bytearray()

    def kept(data: bytes) -> bytes:
        sent.extend(data)
        return data

    field.board.spoil_up = kept
    field.pilot(crsf.sticks(throttle=0.3, on=True), 1.0)
    head = b"t%03X" % field.session.protocol["SETPOINT_USED"].identifier
    assert sum(line.startswith(head) for line in bytes(sent).split(b"\r")) == 1


def test_garbage_arms_nothing_and_stops_nothing() -> None:
    drawn = random.Random(1)
    field = Field()
    field.passes(4.0)
    for _ in range(200):
        field.pilot(drawn.randbytes(40), 0.01)
        assert not field.board.armed
    field.pilot(OFF, 0.2)
    field.pilot(ON, HOLD_S + 0.2)
    for number in range(200):
        wrong = bytearray(ON)
        wrong[drawn.randrange(len(ON))] ^= 1 << drawn.randrange(8)
        field.pilot(bytes(wrong) + (b"" if number % FRAMES_PER_BURST else ON), 0.01)
    assert field.board.armed and turns(field.pulses)
