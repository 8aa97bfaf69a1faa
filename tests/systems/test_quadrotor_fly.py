"""The vehicle that is flown by hand: what may happen to it, and what is seen of it."""

from __future__ import annotations

import numpy as np

from plumb.systems.quadrotor import courses, fly
from plumb.systems.quadrotor.fly import Vehicle

PERIOD_S = 2.5e-3
OFF = {f"pulse_halfus_{rotor}": 2000 for rotor in range(4)}
HOVER = {name: 2000 + round(2000 * (fly.CONTROLS.hover or 0.0)) for name in OFF}


def passed(vehicle: Vehicle, seconds: float, outputs: dict[str, int]) -> None:
    vehicle.follow(vehicle.vehicles.time_s + seconds, outputs)


def wind_mps(vehicle: Vehicle) -> float:
    wind = vehicle.seen().wind_mps
    assert wind is not None
    return float(np.linalg.norm(wind))


def settled() -> Vehicle:
    vehicle = fly.vehicle(1000)
    passed(vehicle, courses.REST_S + 0.5, OFF)
    return vehicle


def test_it_rests_until_its_rotors_turn() -> None:
    vehicle = settled()
    assert vehicle.at_rest() and not any(vehicle.seen().motors)
    passed(vehicle, 0.5, {name: 3200 for name in OFF})
    assert not vehicle.at_rest() and vehicle.seen().position_m[2] > 0.1
    assert vehicle.seen().motors == (0.6,) * 4


def test_the_hover_of_its_drawing_is_one() -> None:
    vehicle = settled()
    passed(vehicle, 0.3, {name: 3200 for name in OFF})
    begin_mps = vehicle.seen().velocity_mps[2]
    passed(vehicle, 0.3, HOVER)
    assert abs(vehicle.seen().velocity_mps[2] - begin_mps) < 0.6


def test_a_gust_is_more_wind_for_a_while() -> None:
    vehicle = settled()
    calm = wind_mps(vehicle)
    vehicle.happen(fly.GUST)
    passed(vehicle, 0.1, OFF)
    assert vehicle.happening() == (fly.GUST,)
    assert wind_mps(vehicle) > calm + 3.0
    passed(vehicle, fly.EVENTS[fly.GUST].seconds, OFF)
    passed(vehicle, PERIOD_S, OFF)
    assert not vehicle.happening() and wind_mps(vehicle) < calm + 3.0


def test_a_weak_motor_tips_it() -> None:
    leans = []
    for weak in (False, True):
        vehicle = settled()
        if weak:
            vehicle.happen(fly.WEAK)
        passed(vehicle, 0.4, {name: 3200 for name in OFF})
        leans.append(vehicle.truth(0.0)["lean_deg"])
    assert leans[1] > 10.0 * max(leans[0], 0.1)


def test_a_stuck_sensor_repeats_its_counts_and_comes_back() -> None:
    vehicle = settled()
    vehicle.happen(fly.STUCK)
    rows = []
    for _ in range(10):
        passed(vehicle, PERIOD_S, OFF)
        rows.append(vehicle.counts(vehicle.vehicles.time_s))
    assert len({row[: fly.STUCK_COUNTS] for row in rows}) == 1 and len({row[3:6] for row in rows}) > 1
    passed(vehicle, fly.EVENTS[fly.STUCK].seconds, OFF)
    assert vehicle.counts(vehicle.vehicles.time_s)[: fly.STUCK_COUNTS] != rows[0][: fly.STUCK_COUNTS]
    assert len(fly.DRAWING.motors) == sum(shape.kind == "propeller" for shape in fly.DRAWING.shapes)
