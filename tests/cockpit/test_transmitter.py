"""The pilot's transmitter: sticks of a page as frames of CRSF, and silence."""

from __future__ import annotations

import pytest

from plumb.cockpit.steering import transmitter
from plumb.cockpit.steering.transmitter import Sticks, Transmitter
from support.receiver_twin import by_twin


class Wall:
    now_s = 0.0


def frames_of(radio: Transmitter, begin_ms: int, end_ms: int) -> bytes:
    return b"".join(radio.frames(ms * 1e-3) for ms in range(begin_ms, end_ms))


def test_the_receiver_gets_150_frames_a_second_with_the_newest_sticks() -> None:
    radio = Transmitter(lambda: 0.0)
    radio.accept_sticks(Sticks())
    radio.accept_sticks(Sticks(roll=1.0, yaw=-1.0, throttle=0.5, on=True))
    rows = by_twin(frames_of(radio, 0, 1000))
    assert len(rows) == 150
    throttle, roll, pitch, yaw, switches, number = rows[-1].words
    assert (roll, pitch, yaw, switches, number) == (32767, 0, -32767, 1, 150)
    assert throttle == pytest.approx(32767 / 2, abs=20)


def test_a_page_that_falls_silent_is_a_lost_receiver() -> None:
    wall = Wall()
    radio = Transmitter(lambda: wall.now_s)
    assert not radio.receiving and not frames_of(radio, 0, 100), "before a page has spoken"
    radio.accept_sticks(Sticks())
    radio.accept_sticks(Sticks(on=True))
    wall.now_s = transmitter.LOST_S
    assert radio.receiving and frames_of(radio, 100, 200)
    wall.now_s = transmitter.LOST_S + 1e-3
    assert not radio.receiving and not frames_of(radio, 200, 300)
    assert radio.sticks.on, "the receiver keeps its last frame"
    radio.accept_sticks(Sticks())
    assert radio.receiving and frames_of(radio, 300, 400)
    assert not radio.sticks.on


def test_the_rotors_are_off_until_the_page_has_said_so() -> None:
    radio = Transmitter(lambda: 0.0)
    for begin_ms, sticks, on in ((0, Sticks(on=True), False), (100, Sticks(), False), (200, Sticks(on=True), True)):
        radio.accept_sticks(sticks)
        assert frames_of(radio, begin_ms, begin_ms + 100) and radio.sticks.on is on
    radio.off = True
    radio.accept_sticks(Sticks(on=True))
    assert frames_of(radio, 300, 400) and not radio.sticks.on, "a stop is not undone by the next message"


def test_silence_on_request_ends_by_itself() -> None:
    radio = Transmitter(lambda: 0.0)
    radio.accept_sticks(Sticks())
    assert frames_of(radio, 0, 100)
    radio.silence(0.2)
    assert radio.silenced and not frames_of(radio, 100, 290)
    assert frames_of(radio, 290, 400) and not radio.silenced
