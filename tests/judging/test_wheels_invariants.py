"""The invariants of `wheels`: rides drawn at random keep them all, and each is broken by what it forbids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import pytest

from plumb.campaign import batch
from plumb.campaign.study import from_table
from plumb.judging.wheels import invariants
from plumb.proof.runs import Run
from plumb.spec.records import Words
from plumb.systems.wheels import fixed_state, random_rides, rides
from plumb.systems.wheels.plant import FAULTY

FROM_S, RUNS = 9.0, 200
TABLE = {"system": "wheels", "scenario": "random", "runs": RUNS}
LEFT_FAULTY, RIGHT_FAULTY = (1 << (FAULTY + channel) for channel in (fixed_state.LEFT, fixed_state.RIGHT))


@cache
def good() -> Run:
    """A ride without events, on level ground."""
    table = {**TABLE, "conditions": {"events": 0.0, "plain_frame": 1.0}}
    return batch.run_one(from_table(table).request(0))


def bit(what: str) -> int:
    return 1 << rides.HAPPENINGS.index(what)


def changed(words: Mapping[str, int], truth: Mapping[str, float], still: bool = False) -> Run:
    """The ride with other words and another truth from FROM_S on. still: the encoders do not count."""
    run = good()
    late = run.inputs.time_s >= FROM_S
    record, raw = run.words.record.copy(), run.inputs.raw.copy()
    for name, value in words.items():
        record[name][late] = value
    known = {name: values.copy() for name, values in run.inputs.truth.items()}
    for column, number in truth.items():
        known[column][late] = number
    if still:
        raw[late, fixed_state.LEFT] = raw[late, fixed_state.RIGHT] = 0
    other = Words(record)
    return replace(
        run, words=other, answer=replace(run.answer, words=other), inputs=replace(run.inputs, truth=known, raw=raw)
    )


DRIVES = {"duty_left_q15": 3000}


def broken(name: str) -> Run:
    match name:
        case "unasked":
            return changed({**DRIVES, "stop_reason": fixed_state.STOP_RIDER}, {})
        case "gone":
            return changed(DRIVES, {"happening": bit(rides.CHATTER)})
        case "lifted":
            return changed(DRIVES, {"happening": bit(rides.LIFT)})
        case "dead":
            return changed(DRIVES, {"velocity_mps": 0.5}, still=True)
        case "good-ride":
            nothing = {"duty_left_q15": 0, "duty_right_q15": 0}
            return changed({**nothing, "stop_reason": fixed_state.STOP_SENSORS}, {"happening": bit(rides.KERB)})
        case "upright":
            return changed({}, {"tilt_deg": 50.0})
        case "fast":
            return changed(DRIVES, {"velocity_mps": 2.1})
        case _:
            return changed(DRIVES, {"tilt_deg": 30.0})


@pytest.mark.parametrize("name", invariants.INVARIANTS)
def test_each_is_broken_by_what_it_forbids(name: str) -> None:
    found = {one.invariant: one for one in invariants.violations(broken(name))}
    assert name in found and set(found) <= {name, "estimate"}
    assert FROM_S - 1e-6 <= found[name].time_s < FROM_S + 4.0


def test_a_good_ride_keeps_them_all() -> None:
    assert not invariants.violations(good())


def test_what_lies_excuses_what_follows_from_it() -> None:
    lies = {"happening": float(1 << (FAULTY + fixed_state.GYRO))}
    assert not invariants.violations(changed({}, {**lies, "tilt_deg": 50.0}))
    dead = {"happening": float(LEFT_FAULTY | RIGHT_FAULTY)}
    stopped = {"stop_reason": fixed_state.STOP_SENSORS, "duty_left_q15": 0, "duty_right_q15": 0}
    assert not invariants.violations(changed(stopped, dead))


def test_rides_drawn_at_random_keep_them_all() -> None:
    requests = from_table(TABLE)
    found = {}
    for index in range(RUNS):
        broke = invariants.violations(batch.run_one(requests.request(index)))
        if broke:
            found[requests.request(index).seed] = [str(one) for one in broke]
    assert not found


def test_a_ride_is_drawn_from_its_seed_alone_and_its_events_can_be_left_out() -> None:
    drawn = [random_rides.drawn(seed) for seed in range(200)]
    counts = {len(ride.events) for ride in drawn}
    assert counts == {0, 2, 3, 4}
    whats = {one.what for ride in drawn for event in ride.events for one in event.happenings}
    assert whats == set(rides.HAPPENINGS)
    assert {one.channel for ride in drawn for event in ride.events for one in event.faults} >= set(range(6))
    ride = next(ride for ride in drawn if len(ride.events) == 4)
    kept, faults = ride.kept(0b0101)
    assert kept.happenings == ride.events[0].happenings + ride.events[2].happenings
    assert faults == ride.events[0].faults + ride.events[2].faults
