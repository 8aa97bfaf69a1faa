"""`wheels` ridden by a receiver, on the native board's own sensors and motors: who arms it, and what disarms it."""

from __future__ import annotations

import pytest

from plumb.spec import crsf
from plumb.systems.wheels import rides
from support.ridden_board import ON, Ridden

GENTLY = crsf.sticks(pitch=0.4, yaw=0.3, on=True)
SENSOR_LOST = 2
"""BOARD_SENSOR_NO_ANSWER."""


def test_a_rider_is_armed_by_the_receivers_switch_and_drives() -> None:
    ride = Ridden()
    ride.arms()
    ride.sends = GENTLY
    ride.passes(6.0)
    assert ride.driven and abs(ride.plant.vehicle.tilt_rad) < 0.2
    assert ride.plant.vehicle.velocity_mps == pytest.approx(0.4, abs=0.15)
    assert ride.plant.truth(ride.time_s)["turn_dps"] == pytest.approx(27.0, abs=6.0)


def test_a_vehicle_that_was_held_for_long_starts_without_a_jerk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No integral grows while the receiver's switch is off."""
    monkeypatch.setattr(rides, "HELD_S", 10.0)
    ride = Ridden()
    ride.passes(9.0)
    ride.sends = ON
    duties = []
    for _ in range(30):
        ride.passes(0.01)
        duties += [abs(duty) for duty in ride.wires.wheel_duty_q15 if ride.driven]
    assert duties and max(duties) < 0.05 * 32768


def test_a_silent_receiver_stops_the_vehicle_and_keeps_it_upright() -> None:
    ride = Ridden()
    ride.arms()
    ride.sends = GENTLY
    ride.passes(3.0)
    ride.sends = b""
    ride.passes(4.0)
    assert ride.board.armed and ride.driven
    assert abs(ride.plant.vehicle.velocity_mps) < 0.15 and abs(ride.plant.truth(ride.time_s)["turn_dps"]) < 4.0


def test_a_rider_who_steps_off_is_disarmed_once_the_vehicle_is_at_rest() -> None:
    ride = Ridden("steps-off")
    ride.arms()
    ride.passes(12.2 - ride.time_s)
    assert ride.driven
    ride.passes(4.3)
    assert not ride.driven and not ride.board.armed
    assert "nobody rides" in ride.why_disarmed


def test_a_vehicle_that_falls_is_disarmed_and_can_be_armed_again_without_a_host() -> None:
    ride = Ridden("topples")
    ride.arms()
    ride.passes(12.6 - ride.time_s)
    assert not ride.driven and not ride.board.armed
    assert "it fell" in ride.why_disarmed
    ride.sends = crsf.sticks()
    vehicle = ride.plant.vehicle
    vehicle.tilt_rad = vehicle.rate_radps = vehicle.velocity_mps = 0.0
    ride.plant.step = 0  # the hand takes it again
    ride._turn = 0
    ride.passes(2.6)
    ride.sends = ON
    ride.passes(0.4)
    assert ride.board.armed and ride.driven


def test_a_break_that_is_over_is_forgotten_when_the_rider_has_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rides, "HELD_S", 20.0)
    ride = Ridden()
    ride.arms()
    ride.wires.bridge_break = 1
    ride.passes(0.05)
    ride.wires.bridge_break = 0
    ride.passes(1.5)
    assert not ride.board.armed, "it stays off while the switch is on"
    ride.sends = crsf.sticks()
    ride.passes(3.0)
    ride.sends = ON
    ride.passes(0.4)
    assert ride.board.armed and ride.driven


@pytest.mark.parametrize("fault", ["sensor", "break", "switch"])
def test_what_disarms_a_vehicle_that_is_ridden(fault: str) -> None:
    ride = Ridden()
    ride.arms()
    ride.passes(0.5)
    assert ride.driven
    if fault == "sensor":
        ride.wires.gyro = SENSOR_LOST
    elif fault == "break":
        ride.wires.bridge_break = 1
    else:
        ride.sends = crsf.sticks()
    ride.passes(0.05)
    assert not ride.driven and not ride.board.armed


def test_the_riders_switch_takes_the_duties_of_a_board_that_a_host_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rides, "HELD_S", 20.0)
    ride = Ridden()
    ride.session.begin("REALTIME_LIVE")
    ride.passes(2.0, listens=True)
    ride.session.arm()
    ride.passes(0.3, listens=True)
    assert ride.driven and not any(ride.wires.wheel_duty_q15), "switched off from the start"
    ride.sends = GENTLY
    ride.passes(0.3, listens=True)
    assert any(ride.wires.wheel_duty_q15)
    ride.sends = crsf.sticks(pitch=0.4)
    ride.passes(0.1, listens=True)
    assert ride.driven and not any(ride.wires.wheel_duty_q15)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({"calibrated": 0}, "never calibrated"),
        ({"battery_min_mv": 6600}, "the battery is low"),
        ({"receiver": 3}, "no frames from the pilot's receiver"),
    ],
)
def test_what_keeps_a_rider_from_arming_is_named(words: dict[str, int], why: str) -> None:
    ride = Ridden(words=words)
    ride.wires.battery_voltage = 1000
    ride.passes(2.2)
    ride.sends = ON
    ride.passes(0.4)
    assert not ride.board.armed and not ride.driven
    assert why in ride.missing
