"""A battery that is declared keeps a vehicle on the ground while it is low or not known; in the air it warns."""

from __future__ import annotations

import pytest

from plumb.boards.native.mcu import NEVER
from plumb.errors import LinkError
from plumb.link.monitor import Monitor
from plumb.physics.battery import Battery
from plumb.spec import crsf
from support.piloted_board import HOLD_S, OFF, ON, Field, turns

LOWEST_MV = 10_500
GOOD, LOW = Battery(11.4).counts(), Battery(10.2).counts()
LOW_TEXT = "the battery is low"
UNKNOWN_TEXT = "the battery's voltage is not known"


def declared(counts: int = GOOD, **words: int) -> Field:
    field = Field(OFF, battery_min_mv=LOWEST_MV, **words)
    field.board.wires.battery_voltage = counts
    return field


def test_without_a_declaration_nothing_is_asked_of_a_battery() -> None:
    field = Field()
    field.arms()
    assert "BATTERY" not in field.session.telemetry


def test_a_good_battery_is_reported_and_lets_the_pilot_arm() -> None:
    field = declared(battery_full_a=90)
    field.board.wires.battery_current = 1024
    monitor = Monitor(field.session)
    field.session.listener = monitor.feed
    field.arms()
    seen = monitor.snapshot()
    assert seen["battery_v"] == pytest.approx(11.4, abs=0.02) and seen["battery_a"] == pytest.approx(22.5, abs=0.01)
    assert field.session.telemetry["BATTERY"]["lowest_mv"] == LOWEST_MV


BLOCKS = {
    "low": (LOW, LOW_TEXT),
    "open": (0, UNKNOWN_TEXT),
    "usb": (Battery(2.3).counts(), UNKNOWN_TEXT),
    "rail": (4095, UNKNOWN_TEXT),
    "silent": (NEVER, UNKNOWN_TEXT),
}


@pytest.mark.parametrize("case", BLOCKS)
def test_what_is_wrong_with_the_battery_is_named_and_neither_pilot_nor_host_arms(case: str) -> None:
    counts, text = BLOCKS[case]
    field = declared()
    field.passes(3.0)
    field.board.wires.battery_voltage = counts
    field.passes(1.0)
    assert field.missing.startswith(text)
    field.pilot(ON, 0.3)
    assert not field.board.armed
    field.pilot(OFF, 0.3)
    with pytest.raises(LinkError, match=text):
        field.session.arm(ready_wait_s=0.0)
    field.board.wires.battery_voltage = GOOD
    field.passes(0.6)
    assert not field.missing
    field.pilot(ON, 0.3)
    assert field.board.armed


def test_a_voltage_that_is_not_read_again_is_not_known() -> None:
    """Within 200 ms."""
    field = declared()
    field.passes(3.0)
    assert not field.missing
    field.board.wires.battery_voltage = NEVER
    field.passes(0.3)
    assert field.missing.startswith(UNKNOWN_TEXT)


@pytest.mark.parametrize("case", BLOCKS)
def test_in_the_air_the_battery_is_reported_and_takes_nothing_away(case: str) -> None:
    counts, text = BLOCKS[case]
    field = declared()
    field.arms()
    field.pilot(crsf.sticks(throttle=0.4, on=True), HOLD_S)
    field.board.wires.battery_voltage = counts
    field.passes(2.0)
    assert field.board.armed and turns(field.pulses)
    assert text in field.missing


def test_a_voltage_that_falls_in_the_air_is_seen_as_soon_as_on_the_ground() -> None:
    """After 256 ms, four time constants of the smoothing, and the period of the report."""
    field = declared()
    field.arms()
    field.board.wires.battery_voltage = LOW
    field.passes(0.36)
    assert field.session.telemetry["BATTERY"]["voltage_mv"] < 10_250


def test_before_the_rotors_turn_a_low_battery_disarms() -> None:
    field = declared()
    field.passes(4.0)
    field.pilot(ON, 0.1)
    assert field.board.armed
    field.board.wires.battery_voltage = LOW
    field.passes(HOLD_S)
    assert not field.board.armed and LOW_TEXT in field.missing
