"""The vehicle that is ridden by hand: who holds it, what may happen to it, and what is seen of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.contract.parameters import quantise
from plumb.contract.run_fixed import Controller
from plumb.systems.wheels import ride, rides, scenarios
from plumb.systems.wheels.ride import Vehicle

SEED, PERIOD_S = 1000, scenarios.PERIOD_US * 1e-6
DUTIES = tuple(f"duty_{side}_q15" for side in ("left", "right"))
ON_S, MOVES_MPS = 1.0, 0.1
CHANNELS, NUMBERS, FRAMES_PER_S, FULL = 7, 255, 150, 32767


class Ridden:
    """The vehicle and the step in integers, in lockstep; the motors are on from ON_S on."""

    def __init__(self, seed: int = SEED) -> None:
        self.vehicle, self.board = ride.vehicle(seed), Controller(quantise(ride.TUNING))
        self.step, self.most_deg = 0, 0.0
        self.outputs: dict[str, int] = {}

    def drive(self, seconds: float, *, speed: float = 0.0, turn: float = 0.0, on: bool = True) -> Ridden:
        """speed, turn: sticks of pitch and yaw."""
        for _ in range(round(seconds / PERIOD_S)):
            time_s = self.step * PERIOD_S
            self.vehicle.follow(time_s, self.outputs)
            number = int(time_s * FRAMES_PER_S) % NUMBERS + 1
            switched = int(on and time_s >= ON_S)
            commands = 0, round(FULL * speed), round(FULL * turn), switched, number
            row = (*self.vehicle.counts(time_s)[:CHANNELS], 0, 0, *commands)
            words = self.board.step(row, 0)
            self.outputs = {name: words[name] for name in DUTIES}
            self.most_deg = max(self.most_deg, abs(self.reading("tilt")))
            self.step += 1
        return self

    def reading(self, label: str) -> float:
        place = [reading.label for reading in ride.DRAWING.readings].index(label)
        return self.vehicle.seen().readings[place]


@pytest.fixture
def ridden() -> Ridden:
    """A vehicle that balances."""
    return Ridden().drive(4.0)


def test_a_hand_holds_it_while_its_motors_rest_and_takes_it_again_when_it_stands(ridden: Ridden) -> None:
    held = Ridden().drive(ON_S)
    assert held.vehicle.seen().motors == (0.0, 0.0) and held.reading("tilt") == 0.0 == held.reading("speed")
    assert any(ridden.vehicle.seen().motors) and ridden.reading("tilt") != 0.0
    ridden.drive(1.0, on=False)
    assert ridden.reading("tilt") == 0.0 and ridden.vehicle.at_rest()


def test_one_whose_motors_go_off_while_it_drives_falls_and_lies_there(ridden: Ridden) -> None:
    ridden.drive(3.0, speed=0.6)
    assert ridden.reading("speed") > ride.CAUGHT_MPS and not ridden.vehicle.at_rest()
    ridden.drive(3.0, on=False)
    assert abs(ridden.reading("tilt")) > 45.0 and ridden.vehicle.at_rest()


def test_it_drives_and_turns_and_is_seen_where_it_is(ridden: Ridden) -> None:
    ridden.drive(4.0, speed=0.4, turn=0.5)
    seen = ridden.vehicle.seen()
    assert 0.3 < ridden.reading("speed") < 0.5 and 40.0 < ridden.reading("turn") < 50.0
    assert math.hypot(*seen.position_m[:2]) > MOVES_MPS and math.hypot(*seen.velocity_mps) > MOVES_MPS
    w, x, y, z = seen.attitude
    assert math.isclose(w * w + x * x + y * y + z * z, 1.0)
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    assert math.isclose(math.cos(heading - ridden.vehicle.vehicle.heading_rad), 1.0, abs_tol=1e-9)
    assert math.isclose(math.degrees(math.asin(2.0 * (w * y - x * z))), ridden.reading("tilt"), abs_tol=1e-9)
    assert seen.turned_rad[1] > seen.turned_rad[0] > 0.0, "to the left: the right wheel has the longer way"


@pytest.mark.parametrize("event", [name for name in ride.EVENTS if name != ride.RIDER])
def test_it_stays_up_whatever_a_button_does_and_it_is_over_by_itself(event: str, ridden: Ridden) -> None:
    less = 0.4 if event == ride.ICY else 0.3  # on ice under both wheels it must not be asked for more or less speed
    ridden.drive(2.0, speed=0.4)
    calm = Ridden().drive(4.0).drive(2.0, speed=0.4)
    ridden.vehicle.happen(event)
    ridden.drive(PERIOD_S)
    assert ridden.vehicle.happening() == (event,)
    ridden.drive(0.5, speed=less)
    calm.drive(PERIOD_S).drive(0.5, speed=less)
    assert ridden.most_deg < 45.0 and ridden.reading("tilt") != calm.reading("tilt")
    ridden.drive(ride.EVENTS[event].seconds, speed=less)
    assert not ridden.vehicle.happening() and ridden.most_deg < 45.0


def test_a_rider_steps_off_and_on_again(ridden: Ridden) -> None:
    ridden.vehicle.happen(ride.RIDER)
    ridden.drive(4.0)
    assert ridden.vehicle.happening() == (ride.RIDER,) and ridden.reading("tilt") == 0.0
    ridden.vehicle.happen(ride.RIDER)
    ridden.drive(3.0, speed=0.4)
    assert not ridden.vehicle.happening() and ridden.reading("speed") > MOVES_MPS
    absent = [shape for shape in ride.DRAWING.shapes if shape.without == ride.RIDER]
    assert absent and len(absent) < len(ride.DRAWING.shapes)


def test_other_estimators_get_the_six_axes_of_the_sample_that_the_board_took(ridden: Ridden) -> None:
    time_s = ridden.step * PERIOD_S
    ridden.vehicle.follow(time_s, ridden.outputs)
    row = ridden.vehicle.counts(time_s)
    six = ridden.vehicle.sample_of(row[:CHANNELS])
    assert six is not None and [six[place] for place in (1, 3, 5, 2)] == list(row[:4])
    ridden.drive(1.0)
    assert ridden.vehicle.sample_of(row[:CHANNELS]) == six, "the samples of the board come late"
    assert ridden.vehicle.sample_of([0] * CHANNELS) is None


def test_a_ghost_leans_by_the_tilt_and_turns_by_the_sum_of_the_rate() -> None:
    estimate = ride.estimate(PERIOD_S)
    assert estimate.follow(np.empty((0, 2))) is None
    rows = np.array([[10.0, 90.0], [math.nan, 90.0], [math.nan, math.nan], [10.0, 90.0]])
    attitude = estimate.follow(rows)
    assert attitude is not None
    w, x, y, z = attitude
    assert math.isclose(math.degrees(math.asin(2.0 * (w * y - x * z))), 10.0)
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    assert math.isclose(math.degrees(heading), 4 * 90.0 * PERIOD_S), "a lost frame turns as the one before"


def test_what_is_drawn_of_it_fits() -> None:
    vehicle: Vehicle = ride.vehicle(SEED)
    seen, drawing = vehicle.seen(), ride.DRAWING
    assert len(drawing.motors) == len(seen.motors) == len(seen.turned_rad)
    assert len(drawing.readings) == len(seen.readings)
    assert {shape.without for shape in drawing.shapes} - {""} <= set(ride.EVENTS) and ride.CONTROLS.event in ride.EVENTS
    assert {shape.motor for shape in drawing.shapes} == {-1, 0, 1}


def test_what_happens_comes_at_a_time_that_the_seed_draws() -> None:
    """Within the stated range, spread over it, and the same for the same seed; the push on ice within 0.3 s of it."""
    drawn = [rides.drawn("ice-one", seed) for seed in range(40)]
    at_s, slips_s = np.array([one.happens_s for one in drawn]), np.array([one.slips_s for one in drawn])
    assert (at_s >= rides.HAPPENS_S).all() and (at_s < rides.HAPPENS_S + rides.LATER_S).all()
    assert np.ptp(at_s) > 0.8 * rides.LATER_S and np.ptp(slips_s) > 1.6 * rides.ON_ICE_S
    assert np.abs(slips_s).max() <= rides.ON_ICE_S
    assert [rides.drawn("ice-one", seed) for seed in range(40)] == drawn
    for name in ("ice-one", "ice-both", "steps-off", "receiver"):
        run = scenarios.scenario(name, 7)
        assert [one.begin_s for one in run.ride.happens()] == [rides.drawn(name, 7).happens_s]
        assert run.ride.happens_s < rides.RIDES[name].seconds - 3.0
