"""Flights of `quadrotor` at random: what a seed draws, and gains by the rule for whatever frame that is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.physics.airframe import HUMMINGBIRD_X, RACER_X
from plumb.systems.quadrotor import frame_tuning, quantise, random_flights, random_frames, scenarios
from plumb.systems.quadrotor.courses import REST_S
from plumb.systems.quadrotor.random_flights import Flight

SEEDS = range(400)


@cache
def flights() -> list[Flight]:
    return [random_flights.drawn(seed) for seed in SEEDS]


def test_frames_are_of_any_size_and_any_thrust() -> None:
    frames = [flight.frame for flight in flights()]
    for values, (low, high) in (
        ([one.thrust_max_n / one.weight_n for one in frames], random_frames.THRUST_BY_WEIGHT),
        ([one.mass_kg for one in frames], random_frames.MASS_KG),
        ([frame_tuning.lag_s(one) for one in frames], random_frames.LAG_S),
        ([one.drag_per_s / one.drag_setting_per_s for one in frames], random_frames.DRAG_BY_SETTING),
    ):
        assert low <= min(values) < low * 1.1 and high / 1.1 < max(values) <= high
    assert all(random_frames.flies(one.mass_kg, frame_tuning.lag_s(one)) for one in frames)
    assert not random_frames.flies(0.03, 0.06)


def test_every_frame_has_gains_that_the_integers_hold() -> None:
    for seed in SEEDS[:60]:
        run = scenarios.scenario("random", seed, seconds=1.0)
        params = quantise.quantise(run.fit(scenarios.HUMMINGBIRD))
        assert params["rate_roll.kp_q29"] > 0


def test_slow_motors_have_slow_loops_and_the_shipped_gains_are_the_rules() -> None:
    shipped, racer = scenarios.HUMMINGBIRD, frame_tuning.tuned(scenarios.HUMMINGBIRD, RACER_X)
    own = frame_tuning.tuned(shipped, HUMMINGBIRD_X)
    assert own.rates.roll.kp_per_dps == pytest.approx(shipped.rates.roll.kp_per_dps, rel=1e-3)
    assert own.rates.yaw.kp_per_dps == pytest.approx(shipped.rates.yaw.kp_per_dps, rel=5e-3)
    assert (own.level, own.attitude.aid.hover) == (shipped.level, shipped.attitude.aid.hover)
    assert frame_tuning.decays_per_s(HUMMINGBIRD_X) == (28.0, 8.0)
    tilt, yaw = frame_tuning.decays_per_s(RACER_X)
    assert 15.0 < tilt < 28.0 and yaw < 8.0 and racer.level.gain_per_s < shipped.level.gain_per_s


def test_events_come_over_the_whole_flight() -> None:
    counts = [len(flight.events) for flight in flights()]
    assert set(counts) == {0, 2, 3, 4} and 0.05 < counts.count(0) / len(counts) < 0.15
    begins = [one.begin_s for flight in flights() for event in flight.events for one in event.happenings] + [
        event.faults[0].start_s for flight in flights() for event in flight.events if event.faults
    ]
    assert len(begins) == sum(counts)
    shares, _ = np.histogram(begins, 5, (REST_S, random_flights.SECONDS))
    assert shares.min() > 0.15 * len(begins)


def test_a_mask_keeps_events_and_a_shorter_flight_is_the_same_flight() -> None:
    seed = next(seed for seed in SEEDS if len(flights()[seed].events) == 4)
    whole = scenarios.scenario("random", seed)
    assert whole.events == 4 and whole.frame is not HUMMINGBIRD_X
    short = scenarios.scenario("random", seed, seconds=4.0)
    assert (short.course, short.frame, short.faults) == (whole.course, whole.frame, whole.faults)
    assert np.array_equal(short.noise, whole.noise[: short.steps])
    none = scenarios.scenario("random", seed, events=0.0, plain_frame=1.0)
    assert none.frame is HUMMINGBIRD_X and not none.faults
    assert none.course.happenings == flights()[seed].course.happenings
    first = scenarios.scenario("random", seed, events=1.0)
    assert len(first.course.happenings) + len(first.faults) == len(none.course.happenings) + sum(
        map(len, flights()[seed].events[0])
    )


def test_conditions_belong_to_it_alone() -> None:
    with pytest.raises(UsageError, match="conditions of the scenario random"):
        scenarios.scenario("calm", 1, events=1.0)
    for events, plain_frame in ((16.0, 0.0), (0.5, 0.0), (1.0, 2.0)):
        with pytest.raises(UsageError, match="whole number"):
            scenarios.scenario("random", 1, events=events, plain_frame=plain_frame)
