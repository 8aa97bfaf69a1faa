"""What `wheels` does not believe, on drawn rides with the C integers in the loop: each ride has its own moment, speeds,
turns and slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.physics.sensors import Fault
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.wheels import fixed_state, rides, scenarios
from plumb.systems.wheels.plant import WheelsPlant
from plumb.systems.wheels.rides import Happening

SECONDS, MOVES_S, FULL = 9.0, 4.0, 32768.0
LEFT, RIGHT, ACCEL_X, ACCEL_Z = 4, 5, 1, 2
FELL_DEG = 45.0
KINDS: tuple[Literal["stuck", "silent", "railed"], ...] = ("stuck", "silent", "railed")


@dataclass(frozen=True)
class Ride:
    """One ride, (steps,) each. at_s: when what is drawn happens."""

    at_s: float
    time_s: FloatArray
    tilt_deg: FloatArray
    velocity_mps: FloatArray
    flags: FloatArray
    stop_reason: FloatArray

    @property
    def after(self) -> BoolArray:
        return self.time_s >= self.at_s

    def flagged(self, bit: int) -> BoolArray:
        return np.asarray((self.flags.astype(int) & bit) != 0)

    def stopped_s(self, reason: int) -> float:
        """How long after at_s it is stopped for this reason; inf: never."""
        stopped = self.after & ((self.stop_reason.astype(int) & reason) != 0)
        return float(self.time_s[np.argmax(stopped)] - self.at_s) if stopped.any() else np.inf


class Drawn:
    """A generator, the moment at which something happens, and speeds that change at about that moment."""

    def __init__(self, seed: int) -> None:
        self.seed, self.rng = seed, np.random.default_rng(seed)
        self.at_s = float(self.rng.uniform(5.0, 6.5))
        self.changes_s = self.at_s + float(self.rng.uniform(-0.3, 0.3))
        self.speeds = self.rng.uniform(-0.6, 0.6, 2)
        self.turn_dps = float(self.rng.choice([-60.0, 0.0, 0.0, 60.0]))
        self.slope_deg = float(self.rng.choice([0.0, self.rng.uniform(-15.0, 15.0)]))

    def ride(self, happenings: Sequence[Happening] = (), faults: Sequence[Fault] = ()) -> Ride:
        drawn = scenarios.scenario("steps-off", self.seed, seconds=SECONDS)
        time_s = drawn.time_s
        moves = time_s >= MOVES_S
        before, then = self.speeds.tolist()
        asked: FloatArray = np.where(time_s < self.changes_s, before, then) * moves
        turn: FloatArray = self.turn_dps * np.asarray(moves, np.float64)
        ride = replace(drawn.ride, leaves=False, slope_deg=self.slope_deg, happenings=tuple(happenings))
        run = replace(drawn, ride=ride, faults=tuple(faults), asked_mps=asked, asked_dps=turn)
        plant, core = WheelsPlant(run), native_core.Controller(quantise(scenarios.STEERED))
        rows = []
        left: float | None = None
        right: float | None = None
        for now_s in time_s.tolist():
            plant.drive_to(now_s, (left, right))
            words = core.step(plant.counts(now_s), plant.setpoint(now_s))
            left, right = words["duty_left_q15"] / FULL, words["duty_right_q15"] / FULL
            truth = plant.truth(now_s)
            rows.append((truth["tilt_deg"], truth["velocity_mps"], words["flags"], words["stop_reason"]))
        return Ride(self.at_s, time_s, *np.array(rows, np.float64).T)


@pytest.mark.parametrize("seed", range(4))
def test_both_encoders_that_die_are_noticed_within_half_a_second(seed: int) -> None:
    drawn = Drawn(seed)
    kinds = drawn.rng.choice(2, 2)
    ride = drawn.ride(faults=[Fault(KINDS[kinds[0]], LEFT, drawn.at_s), Fault(KINDS[kinds[1]], RIGHT, drawn.at_s)])
    assert ride.stopped_s(fixed_state.STOP_SENSORS) < 0.5
    assert ride.flagged(fixed_state.ENCODERS).any() and not ride.flagged(fixed_state.ENCODERS)[~ride.after].any()


@pytest.mark.parametrize("seed", range(4))
def test_an_encoder_that_fails_alone_takes_the_turning_away(seed: int) -> None:
    drawn = Drawn(100 + seed)
    ride = drawn.ride(faults=[Fault(KINDS[seed % 3], (LEFT, RIGHT)[seed % 2], drawn.at_s)])
    assert not (ride.stop_reason * (ride.time_s > rides.HELD_S)).any()
    assert np.abs(ride.tilt_deg).max() < FELL_DEG


@pytest.mark.parametrize("seed", range(4))
def test_a_kerb_is_not_taken_for_dead_encoders(seed: int) -> None:
    drawn = Drawn(200 + seed)
    side = int(np.sign(drawn.speeds[1]))
    ride = drawn.ride([Happening(rides.KERB, drawn.at_s, number=side)])
    up = np.cumsum(np.abs(ride.tilt_deg) > FELL_DEG) == 0
    reasons = ride.stop_reason.astype(int)[up & ride.after & (ride.time_s < drawn.at_s + 2.0)]
    assert not (reasons & fixed_state.STOP_SENSORS).any()
    assert (np.abs(ride.velocity_mps[ride.after]) < 0.1).any()


@pytest.mark.parametrize("seed", range(4))
def test_a_vehicle_that_is_lifted_stops_within_two_seconds(seed: int) -> None:
    drawn = Drawn(300 + seed)
    ride = drawn.ride([Happening(rides.LIFT, drawn.at_s, size=float(drawn.rng.uniform(-10.0, 10.0)))])
    assert ride.stopped_s(fixed_state.STOP_SENSORS) < 2.0
    assert ride.flagged(fixed_state.LIFTED).any() and not ride.flagged(fixed_state.LIFTED)[~ride.after].any()


@pytest.mark.parametrize("seed", range(8))
def test_ice_under_one_wheel_while_the_speed_changes_throws_nobody(seed: int) -> None:
    drawn = Drawn(400 + seed)
    drawn.slope_deg = 0.0
    ends_s = drawn.at_s + float(drawn.rng.uniform(0.3, 2.0))
    ride = drawn.ride([Happening(rides.ICY, drawn.at_s, ends_s, number=1 + seed % 2)])
    assert np.abs(ride.tilt_deg).max() < FELL_DEG
    assert not (ride.stop_reason * (ride.time_s > rides.HELD_S)).any()


@pytest.mark.parametrize("seed", range(6))
def test_an_accelerometer_that_is_stuck_drives_nobody_away(seed: int) -> None:
    drawn = Drawn(500 + seed)
    drawn.changes_s, drawn.speeds[1], drawn.slope_deg = drawn.at_s, 0.0, 0.0
    ride = drawn.ride(faults=[Fault(KINDS[seed % 3], (ACCEL_X, ACCEL_Z)[seed // 3], drawn.at_s)])
    stopped_s = ride.stopped_s(fixed_state.STOP_SENSORS)
    assert 2.0 < stopped_s < 2.3 and ride.flagged(fixed_state.ACCEL_STILL).any()
    drives = (ride.time_s > drawn.at_s + 1.0) & (ride.time_s < drawn.at_s + stopped_s)
    assert np.abs(ride.velocity_mps[drives]).max() < 0.5 and np.abs(ride.tilt_deg[drives]).max() < 15.0


@pytest.mark.parametrize("seed", range(2))
def test_a_switch_that_chatters_from_the_start_is_no_rider(seed: int) -> None:
    drawn = Drawn(600 + seed)
    ride = drawn.ride([Happening(rides.CHATTER, 0.0, number=int(drawn.rng.integers(rides.CHATTER_MS)))])
    assert set(ride.stop_reason.astype(int).tolist()) <= {
        fixed_state.STOP_RIDER,
        fixed_state.STOP_RIDER | fixed_state.STOP_FALLEN,
    }
