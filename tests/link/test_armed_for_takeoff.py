"""A vehicle that flies is armed by a host when it stands still and level, its throttle low; it says what is missing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.errors import LinkError
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.spec.parameter_file import by_name
from support.native_board import UartBoard
from support.noise import with_noise

SYSTEM = systems.load("quadrotor")
PARAMS = quantise(SYSTEM.TUNINGS["hummingbird"])
PINS_QUADROTOR = 2
ONE_G, ONE_DPS = 2048, 16.4
LEVEL, LEANING = (0, 0, 0, 0, 0, ONE_G), (0, 0, 0, 0, round(0.5 * ONE_G), round(0.866 * ONE_G))
TURNING = (0, 0, round(8 * ONE_DPS), 0, 0, ONE_G)
NEUTRAL_HALFUS = 2000


class Stand:
    """A board with a quadrotor's parameters and pins, and what its sensors feel."""

    def __init__(self) -> None:
        self.board, self.feels, self._number = UartBoard(), LEVEL, 0
        self.board.wires.strap = PINS_QUADROTOR
        self.board.sensors(LEVEL)
        with Session.open(self.board) as session:
            session.upload(PARAMS.words(), **PARAMS.link_words(), **SYSTEM.LINK, period_us=2500, arm_hold_ms=0)
            session.execute("SAVE")
        self.board.mcu.power_off()
        self.board.mcu.power_on()
        self.session = Session.open(self.board)
        self.session.connect()
        self.session.begin("REALTIME_LIVE")

    def rests(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.0025)):
            self._number += 1
            self.board.sensors(with_noise(self.feels, self._number, 6))
            self.session.receive(0.0025)

    def refused(self) -> str:
        with pytest.raises(LinkError) as why:
            self.session.arm(ready_wait_s=0.0)
        return str(why.value)

    @property
    def pulses(self) -> list[int]:
        return list(self.board.wires.pulse_halfus)


@pytest.fixture
def stand() -> Iterator[Stand]:
    one = Stand()
    yield one
    one.session.close()


def test_it_turns_four_rotors_when_it_is_armed_and_commanded(stand: Stand) -> None:
    stand.rests(3.0)
    stand.session.arm(ready_wait_s=0.0)
    stand.rests(0.1)
    assert stand.pulses == [NEUTRAL_HALFUS] * 4, "armed, and no rotor is switched on"
    stand.session.set_commands({"switches": 1}, 9830)
    stand.rests(0.1)
    assert all(2500 < pulse < 2800 for pulse in stand.pulses), "30 % of the throttle"
    stand.session.disarm()
    stand.rests(0.01)
    assert stand.pulses == [NEUTRAL_HALFUS] * 4


def test_the_arm_switch_arms_it_without_a_host_and_stops_it(stand: Stand) -> None:
    stand.session.end()
    stand.rests(0.1)
    stand.board.switch(True)
    stand.rests(1.0)
    assert not stand.board.armed, "its run has just begun: the vertical is not known yet"
    stand.rests(2.5)
    assert stand.board.armed and stand.pulses == [NEUTRAL_HALFUS] * 4, "nobody has switched a rotor on"
    stand.board.switch(False)
    stand.rests(0.1)
    assert not stand.board.armed


def test_what_is_missing_is_named(stand: Stand) -> None:
    stand.feels = LEANING
    stand.rests(3.0)
    assert "tilted too far" in stand.refused()
    stand.feels = LEVEL
    stand.rests(5.0)
    stand.session.set_commands({}, 3000)
    stand.rests(0.5)
    assert "setpoint" in stand.refused()
    stand.session.set_commands({}, 0)
    stand.rests(0.5)
    stand.session.arm(ready_wait_s=0.0)


def test_a_vehicle_that_turns_is_not_armed(stand: Stand) -> None:
    stand.rests(3.0)
    stand.feels = TURNING
    stand.rests(0.5)
    assert "it moves" in stand.refused()


@pytest.mark.parametrize("seed", range(4))
def test_dropped_in_the_air_it_is_not_armed_until_it_lies(stand: Stand, seed: int) -> None:
    """It falls without turning, and its attitude is known: it feels less than its weight."""
    drawn = np.random.default_rng(seed)
    stand.rests(3.0)
    stand.session.arm(ready_wait_s=0.0)
    stand.session.set_commands({"switches": 1}, 16000)
    stand.feels = (0, 0, 0, 0, 0, round(1.3 * ONE_G))
    stand.rests(float(drawn.uniform(1.0, 2.0)))
    stand.session.disarm()
    stand.session.set_commands({}, 0)
    stand.feels = (0, 0, 0, 0, 0, round(drawn.uniform(0.0, 0.85) * ONE_G))
    stand.rests(float(drawn.uniform(0.5, 2.0)))
    assert "it moves" in stand.refused()
    stand.feels = LEVEL
    stand.rests(1.6)
    stand.session.arm(ready_wait_s=0.0)


def test_nothing_of_it_disarms(stand: Stand) -> None:
    """In the air a check that fails by mistake is a crash."""
    stand.rests(3.0)
    stand.session.arm(ready_wait_s=0.0)
    stand.session.set_commands({"switches": 1}, 16000)
    stand.feels = LEANING
    stand.rests(1.0)
    assert stand.board.armed


@pytest.mark.parametrize(("word", "value"), [("esc.mid_halfus", 3000), ("esc.span_halfus", 800)])
def test_the_speed_controllers_of_the_factory_table_are_refused(stand: Stand, word: str, value: int) -> None:
    """At the throttle 0 they would turn the rotors of a hover."""
    stand.rests(3.0)
    session = stand.session
    session.end()
    parameter_table.commit(session, {**by_name(parameter_table.read_table(session)), word: value})
    session.begin("REALTIME_LIVE")
    stand.rests(3.0)
    assert word in stand.refused() and "1, outputs are safe within 50 ms" in stand.refused()


def test_on_other_pins_it_is_never_armed() -> None:
    board = UartBoard()
    with Session.open(board) as session:
        session.upload(PARAMS.words(), **PARAMS.link_words(), pins=0)
        session.begin("REALTIME_LIVE")
        with pytest.raises(LinkError, match="this system has nothing to move on these pins"):
            session.arm(ready_wait_s=0.0)
