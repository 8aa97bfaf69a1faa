"""Drawn flights by a pilot on a hostile line: what he has promised holds on the whole board, in the air and after."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from plumb.spec import crsf
from support.campaigns import campaign
from support.hostile_line import HOSTILE, coincides, is_whole
from support.piloted_board import HOLD_S, NEUTRAL_HALFUS, OFF, ON, ONE_G, Field, turns

FLIGHTS, WHOLE = 8, 200
LOST_S, HELD_S, LATE_S = 0.1, 1.0, 0.03
"""Without a frame the receiver is lost, then the vehicle is held; by so much the board may be late."""
THROTTLE = 0.3
MOST_HALFUS = NEUTRAL_HALFUS + 1200
"""Marked frames ask for 2000 more than neutral, the pilot for 600."""
HOSTILITY = 0.3
CLIMBS_G = 1.3


class Flight:
    """A vehicle in the air, whose accelerations say that it climbs."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.field = Field()
        transmit = self.field.transmit

        def hostile(frame: bytes) -> None:
            transmit(before(self.chance, frame) + frame)

        self.field.arms()
        self.field.transmit = hostile
        self.flown = crsf.sticks(throttle=THROTTLE, on=True)
        self.feels(CLIMBS_G)
        self.passes(self.flown, 1.5)
        assert self.armed

    @property
    def armed(self) -> bool:
        return self.field.board.armed

    def feels(self, force_g: float) -> None:
        self.field.feels = (0, 0, 0, 0, 0, round(force_g * ONE_G))

    def passes(self, sends: bytes | Callable[[], bytes], seconds: float) -> None:
        """Frame by frame; the rotors never get what a frame that must not count asks for."""
        for _ in range(round(seconds / self.field.frame_s)):
            self.field.pilot(sends() if callable(sends) else sends, self.field.frame_s)
            assert max(self.field.pulses) < MOST_HALFUS

    def without_transmitter(self) -> bytes:
        """What a receiver makes up, or nothing but noise."""
        return b"" if self.silent else wild(self.chance) + crsf.statistics(0)

    def loses(self, seconds: float) -> None:
        """The transmitter: no frame comes, or the quality is 0."""
        self.silent = self.chance.random() < 0.5
        if not self.silent:
            self.field.transmit(crsf.statistics(0))
        self.passes(self.without_transmitter, seconds)

    def receives_again(self) -> None:
        self.passes(crsf.statistics(100) + self.flown, 0.2)

    def flickers(self) -> None:
        """Two frames in a row say off, again and again."""
        for _ in range(self.chance.randrange(1, 10)):
            self.passes(OFF, 2 * self.field.frame_s)
            self.passes(self.flown, self.chance.randrange(1, 5) * self.field.frame_s)


def before(chance: random.Random, frame: bytes) -> bytes:
    """What comes before a frame; nothing in both has the CRC of a frame by chance."""
    if chance.random() >= HOSTILITY:
        return b""
    while True:
        data = chance.choice(HOSTILE)(chance)
        end = len(data)
        wholes = {*range(end if is_whole(data) else 0), *range(end, end + len(frame))}
        if not coincides(data + frame, wholes):
            return data


def wild(chance: random.Random) -> bytes:
    """Channels that no pilot has asked for."""
    return crsf.channels([chance.choice([172, 992, 1811]) for _ in range(8)])


def happens(flight: Flight) -> None:
    """What must not end a flight."""
    for _ in range(3):
        way = flight.chance.randrange(3)
        if way == 0:
            flight.passes(flight.flown, flight.chance.uniform(0.1, 0.5))
        elif way == 1:
            flight.loses(flight.chance.uniform(LOST_S, LOST_S + HELD_S - 2 * LATE_S))
            assert flight.armed and turns(flight.field.pulses), "held"
            flight.receives_again()
        else:
            flight.flickers()
        assert flight.armed and turns(flight.field.pulses)


@pytest.mark.parametrize("seed", range(campaign(FLIGHTS, WHOLE)))
def test_a_flight_goes_on_until_it_must_end_and_nothing_is_armed_in_its_fall(seed: int) -> None:
    flight = Flight(seed)
    field = flight.field
    happens(flight)
    if flight.chance.random() < 0.5:
        flight.loses(LOST_S + HELD_S + 2 * LATE_S)
        assert not flight.armed and "the receiver was lost" in field.why_disarmed
    else:
        flight.passes(OFF, 3 * field.frame_s + LATE_S)
        assert not flight.armed
    assert field.pulses == [NEUTRAL_HALFUS] * 4
    flight.feels(flight.chance.uniform(0.0, 0.85))
    for _ in range(3):
        flight.passes(crsf.statistics(100) + flight.chance.choice((ON, OFF, flight.flown)), 0.3)
        assert not flight.armed and field.pulses == [NEUTRAL_HALFUS] * 4, "it falls"
    flight.passes(OFF, 0.3)
    flight.passes(ON, 0.3)
    assert not flight.armed, "it still falls"
    flight.feels(1.0)
    flight.passes(OFF, 6.0)
    flight.passes(ON, HOLD_S + 0.2)
    assert flight.armed, f"it lies still: {field.missing}"
    field.session.close()
