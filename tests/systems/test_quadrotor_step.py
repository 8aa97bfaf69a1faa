"""The step of `quadrotor` in integers: who flies, when the rotors stop, and that it is the step of the C core."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.contract.parameters import ControlParams
from plumb.spec import declarations
from plumb.systems.quadrotor import fixed
from support.each_run import agreed
from support.quadrotor_by_hand import (
    BLOCK_STEPS,
    GROUND_STEPS,
    LANDED_BLOCKS,
    MAYBE_LANDED_BLOCKS,
    ON_GROUND,
    TAKE_OFF_STEPS,
    WORDS,
    Quadrotor,
    flying,
    leaning,
    quadrotor,
)
from support.wild_quadrotor import RUNS, wild_inputs, wild_words

FLOWN, HELD, LANDING, STOPPED = range(4)
NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE, RUNAWAY, UPTURNED = (1 << bit for bit in range(7))
FLAGS = {flag.name: 1 << bit for bit, flag in enumerate(declarations.system("quadrotor").flags)}
ROTORS = [f"rotor_q24_{number}" for number in range(4)]
PULSES = [f"pulse_halfus_{number}" for number in range(4)]


def flags(record: dict[str, int]) -> set[str]:
    return {name for name, bit in FLAGS.items() if record["flags"] & bit}


def off(record: dict[str, int]) -> bool:
    """No rotor turns."""
    quiet = not any(record[name] for name in [*ROTORS, "thrust_q24"])
    return quiet and {record[name] for name in PULSES} == {WORDS["esc.neutral_halfus"]} and "FLIES" not in flags(record)


def test_wild_runs_agree_in_every_bit() -> None:
    rng = np.random.default_rng(30)
    words = [wild_words(rng) for _ in range(RUNS)]
    assert all(fixed.control_valid(one) for one in words)
    raw, throttle = wild_inputs(rng)
    number = declarations.system("quadrotor").number
    seen = agreed([ControlParams({**one, "system": number}) for one in words], raw, throttle, begun=0, every=1)
    assert set(np.unique(seen["phase"])) == {FLOWN, HELD, LANDING, STOPPED}
    assert set(np.unique(seen["stop_reason"])) == {
        0, NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE, RUNAWAY, UPTURNED,
    }  # fmt: skip
    assert np.bitwise_or.reduce(seen["flags"]) == (1 << len(FLAGS)) - 1


def test_words_beyond_the_table_are_not_valid() -> None:
    for name, value in (("quadrotor.back_steps", 0), ("rate_yaw.kp_q29", (1 << 30) + 1), ("esc.min_halfus", 1000)):
        assert fixed.control_valid(WORDS)
        assert not fixed.control_valid({**WORDS, name: value}), name


def test_switched_off_nothing_turns() -> None:
    vehicle = flying()
    assert {"AIRBORNE", "FLIES", "LEVELS"} <= flags(vehicle.step())
    vehicle.on, vehicle.throttle, vehicle.sticks, vehicle.mode_rate = False, 0, (32767, 32767, 32767), True
    record = vehicle.step(5)
    assert off(record)
    assert {record[f"{axis}_excess_q24"] for axis in ("roll", "pitch", "yaw")} == {0}
    vehicle.on = True
    assert "FLIES" in flags(vehicle.step())


def test_switch_that_is_on_from_the_first_step_starts_nothing() -> None:
    vehicle = Quadrotor(WORDS)
    record = vehicle.step(GROUND_STEPS)
    assert (record["phase"], record["stop_reason"]) == (STOPPED, 0)
    assert off(record)
    vehicle.on = False
    assert vehicle.step()["phase"] == FLOWN
    vehicle.on = True
    assert "FLIES" in flags(vehicle.step())


def test_vehicle_that_is_not_sure_of_its_vertical_does_not_start() -> None:
    vehicle = Quadrotor(WORDS, on=False)
    vehicle.step()
    vehicle.on = True
    record = vehicle.step()
    assert (record["phase"], record["stop_reason"]) == (STOPPED, UNSURE)
    assert off(record)
    assert vehicle.step(GROUND_STEPS)["phase"] == STOPPED, "until the switch has been off"


def test_restart_of_the_estimator_in_the_air_is_no_landing() -> None:
    vehicle = flying()
    vehicle.throttle, vehicle.accel_g = 0, (0.0, 0.0, 0.0)
    seen = [vehicle.step() for _ in range(1000)]
    assert all("AIRBORNE" in flags(record) for record in seen)


def lose(vehicle: Quadrotor, steps: int) -> dict[str, int]:
    """Steps without a new frame."""
    vehicle.frames = False
    return vehicle.step(steps)


def test_lost_receiver_in_the_air_holds_level_and_throttle_then_stops() -> None:
    vehicle = flying(lost_steps=40, held_steps=200)
    vehicle.sticks, vehicle.mode_rate = (9000, -9000, 9000), True
    before = lose(vehicle, 39)
    held = vehicle.step()
    assert (before["phase"], held["phase_steps"], held["age_steps"]) == (FLOWN, 0, 40)
    vehicle.throttle = 0
    for record in (held, vehicle.step(200)):
        assert record["phase"] == HELD
        assert record["throttle_q15"] == min(before["throttle_q15"], record["hover_q15"])
        assert {"LOST", "LEVELS", "FLIES"} <= flags(record)
        assert [record[f"asked_turnps_q28_{axis}"] for axis in range(3)] == pytest.approx([0] * 3, abs=1 << 14)
    stopped = vehicle.step()
    assert (stopped["phase"], stopped["stop_reason"]) == (STOPPED, RECEIVER_LOST)
    assert off(stopped)


def test_receiver_that_says_so_is_lost_at_once() -> None:
    vehicle = flying()
    vehicle.signs_off = True
    assert vehicle.step()["phase"] == HELD


def test_receiver_back_within_the_hold_is_obeyed_at_once() -> None:
    vehicle = flying(lost_steps=5, held_steps=20)
    assert lose(vehicle, 20)["phase"] == HELD
    vehicle.frames, vehicle.throttle = True, 20000
    record = vehicle.step()
    assert (record["phase"], record["throttle_q15"], record["good_steps"]) == (FLOWN, 20000, 1)


def landing(**words: int) -> Quadrotor:
    vehicle = flying(lost_steps=5, held_steps=20, lost_action=1, **words)
    record = lose(vehicle, 26)
    assert (record["phase"], record["phase_steps"], record["throttle_q15"]) == (LANDING, 0, record["hover_q15"])
    return vehicle


def test_landing_obeys_again_after_good_frames_in_a_row() -> None:
    vehicle = landing(back_steps=50)
    vehicle.frames = True
    assert vehicle.step(49)["phase"] == LANDING
    vehicle.signs_off = True
    vehicle.step()
    vehicle.signs_off = False
    assert vehicle.step(49)["phase"] == LANDING, "they count from 1 again"
    assert vehicle.step()["phase"] == FLOWN


def test_landing_ends_on_the_ground_or_in_time() -> None:
    vehicle = landing(land_steps=100)
    assert vehicle.step(100)["phase"] == LANDING
    assert vehicle.step()["stop_reason"] == RECEIVER_LOST
    vehicle = landing()
    seen = [vehicle.step(BLOCK_STEPS) for _ in range(90)]  # it feels its weight, however low its throttle
    stopped = next(record for record in seen if record["phase"] == STOPPED)
    assert (stopped["stop_reason"], stopped["landing_q15"]) == (RECEIVER_LOST, 0)
    assert 20 <= stopped["carried_blocks"] < LANDED_BLOCKS


def test_landing_follows_its_speed_of_descent() -> None:
    """Without lift it rises to the most, in a climb it falls to 0; at the speed asked for it stays."""
    for felt_g, reached in ((0.7, 1.25), (1.3, 0.0)):
        vehicle = landing()
        vehicle.accel_g = (0.0, 0.0, felt_g)
        record = vehicle.step(60 * BLOCK_STEPS)
        assert record["throttle_q15"] == pytest.approx(reached * record["hover_q15"], abs=2), felt_g


def test_landing_that_begins_on_the_ground_does_not_rise() -> None:
    vehicle = flying(lost_steps=5, held_steps=300, lost_action=1)
    vehicle.throttle = 0
    vehicle.step(3 * BLOCK_STEPS)
    vehicle.frames = False
    seen = [vehicle.step() for _ in range(500)]
    assert LANDING in [record["phase"] for record in seen]
    assert max(record["thrust_q24"] for record in seen) == WORDS["quadrotor.idle_q24"]
    assert seen[-1]["stop_reason"] == RECEIVER_LOST


def test_hold_that_outlasts_the_landing_stops_on_the_ground() -> None:
    vehicle = flying(lost_steps=5, held_steps=65534)
    vehicle.throttle = 0
    record = lose(vehicle, (LANDED_BLOCKS + 8) * BLOCK_STEPS)
    assert (record["phase"], record["stop_reason"]) == (STOPPED, RECEIVER_LOST)


@pytest.mark.parametrize(("share", "learns"), [(0.6, True), (0.3, False)])
def test_first_seconds_of_a_flight_learn_a_hover_that_was_set_too_high(share: float, learns: bool) -> None:
    vehicle = flying()
    hover = vehicle.step()["hover_q15"]
    vehicle.throttle = round(share * hover)
    vehicle.accel_g = (0.0, 0.0, 1.2)  # the ground does not carry it
    assert (vehicle.step(6 * BLOCK_STEPS)["hover_q15"] < 0.8 * hover) == learns


def test_held_throttle_is_at_most_that_of_a_hover() -> None:
    vehicle = flying(lost_steps=5)
    vehicle.step(40 * BLOCK_STEPS)
    vehicle.throttle = 30000
    assert vehicle.step()["throttle_q15"] == 30000
    held = lose(vehicle, 6)
    assert held["phase"] == HELD
    assert held["throttle_q15"] == held["hover_q15"] == pytest.approx(32767 // 2, rel=0.03)


@pytest.mark.parametrize("felt_g", [0.85, 1.0, 1.15])
def test_landed_is_evidence_that_lasts(felt_g: float) -> None:
    """A low throttle with the weight felt for eight blocks may be a landing, for 67 it is one."""
    vehicle = flying()
    vehicle.throttle, vehicle.accel_g = 0, (0.0, 0.6 * felt_g, 0.8 * felt_g)
    seen = [flags(vehicle.step(BLOCK_STEPS)) for _ in range(LANDED_BLOCKS + 8)]  # a restart of the filter takes four
    on_ground = felt_g == 1.0
    assert all("AIRBORNE" in one for one in seen[: MAYBE_LANDED_BLOCKS - 1])
    assert ("AIRBORNE" not in seen[MAYBE_LANDED_BLOCKS]) == on_ground
    assert not any("LANDED" in one for one in seen[: LANDED_BLOCKS - 1])
    assert ("LANDED" in seen[-1]) == on_ground


def test_vehicle_without_an_aid_flies_and_lands() -> None:
    """Its drag is not set: the estimator has no velocity, and take-off and landing are known all the same."""
    vehicle = quadrotor()
    vehicle.words = {**vehicle.words, "attitude.aid_s_q24": 0}
    assert "AIRBORNE" in flags(vehicle.step(TAKE_OFF_STEPS))
    vehicle.throttle = 0
    assert not {"AIRBORNE", "LANDED"} & flags(vehicle.step((MAYBE_LANDED_BLOCKS + 2) * BLOCK_STEPS))
    assert "LANDED" in flags(vehicle.step((LANDED_BLOCKS + 8) * BLOCK_STEPS))


def test_throttle_of_a_hover_is_no_landing() -> None:
    vehicle = flying()
    record = vehicle.step(2 * LANDED_BLOCKS * BLOCK_STEPS)
    assert record["carried_blocks"] == 0
    assert record["hover_q15"] == pytest.approx(vehicle.throttle, rel=0.01)


@pytest.mark.parametrize(("felt_g", "hover"), [(0.8, 0.580), (1.0, 0.5), (2.0, 0.315), (3.9, 0.202)])
def test_hover_is_learned_from_thrust_and_acceleration(felt_g: float, hover: float) -> None:
    """thrust * f^(-2/3) at half the thrust."""
    vehicle = flying()
    vehicle.accel_g = (0.0, 0.0, felt_g)
    assert vehicle.step(60 * BLOCK_STEPS)["hover_q15"] / 32768 == pytest.approx(hover, rel=0.01)


@pytest.mark.parametrize("felt_g", [0.4, 4.1])
def test_falls_and_strong_accelerations_determine_no_hover(felt_g: float) -> None:
    vehicle = flying()
    before = vehicle.step(40 * BLOCK_STEPS)["hover_q15"]
    vehicle.accel_g = (0.0, 0.0, felt_g)
    vehicle.step(BLOCK_STEPS)  # the rest of a block
    between = vehicle.step(BLOCK_STEPS)["hover_q15"]
    assert vehicle.step(40 * BLOCK_STEPS)["hover_q15"] == between == pytest.approx(before, rel=0.1)


@pytest.mark.parametrize(("rising_g", "takes_off"), [(0.0, False), (0.05, True), (-0.05, True)])
def test_unknown_hover_takes_off_when_it_rises_or_sinks(rising_g: float, takes_off: bool) -> None:
    vehicle = Quadrotor({**WORDS, "attitude.aid_hover_q15": 0}, on=False)
    vehicle.step(GROUND_STEPS)
    vehicle.on = True
    vehicle.step(10 * BLOCK_STEPS)
    vehicle.accel_g = (0.0, 0.0, 1.0 + rising_g)
    record = vehicle.step(24 * BLOCK_STEPS)
    assert ("AIRBORNE" in flags(record)) == takes_off
    assert (record["hover_q15"] > 0) == takes_off


def test_unsure_in_the_air_levels_slowly() -> None:
    """At most 90 deg/s by the error of the vertical; sure of it, up to 360."""
    vehicle = flying()
    vehicle.words = {**vehicle.words, "attitude.unsure": 0}
    vehicle.sticks = (32767, 0, 0)
    record = vehicle.step(2 * BLOCK_STEPS)
    assert {"UNSURE", "LEVELS", "AIRBORNE"} <= flags(record)
    assert record["asked_turnps_q28_0"] == pytest.approx((1 << 28) // 4, abs=16)
    vehicle.words = {**vehicle.words, "attitude.unsure": (1 << 32) - 1}
    record = vehicle.step(2 * BLOCK_STEPS)
    assert "UNSURE" not in flags(record)
    assert record["asked_turnps_q28_0"] > 1 << 27


def away(vehicle: Quadrotor, steps: int, against: int = 1) -> dict[str, int]:
    """A roll rate that grows by 20 deg/s a step, against the command of its axis or with it."""
    record: dict[str, int] = {}
    vehicle.mode_rate = True
    for _ in range(steps):
        vehicle.rate_dps = (vehicle.rate_dps[0] + 20.0, 0.0, 0.0)
        vehicle.sticks = (-32767 * against, 0, 0)
        record = vehicle.step()
    return record


def test_runaway_stops_at_the_take_off_alone() -> None:
    vehicle = quadrotor(runaway_limit=16)
    vehicle.throttle = ON_GROUND
    stopped = away(vehicle, 40)
    assert (stopped["stop_reason"], stopped["phase"]) == (RUNAWAY, STOPPED)
    vehicle = quadrotor(runaway_limit=16)
    vehicle.throttle = ON_GROUND
    assert away(vehicle, 18, against=-1)["runaway_steps"] < 3, "the pilot asks for it"
    vehicle = flying(runaway_limit=16)
    vehicle.step(9 * BLOCK_STEPS)
    assert away(vehicle, 40)["phase"] == FLOWN


def test_rate_that_is_braked_is_no_runaway() -> None:
    vehicle = quadrotor(runaway_limit=16)
    vehicle.throttle, vehicle.rate_dps, vehicle.mode_rate = ON_GROUND, (1000.0, 0.0, 0.0), True
    most = 0
    for _ in range(60):
        vehicle.rate_dps = (vehicle.rate_dps[0] - 12.0, 0.0, 0.0)
        most = max(most, vehicle.step()["runaway_steps"])
    assert most <= 4


@pytest.mark.parametrize("mode_rate", [False, True])
def test_upside_down_against_the_mode_stops(mode_rate: bool) -> None:
    vehicle = flying(upturned_limit=100, airmode=0)
    vehicle.step(9 * BLOCK_STEPS)
    vehicle.rate_dps, vehicle.mode_rate = (180.0 / (60 * 0.0025), 0.0, 0.0), True
    while vehicle.step()["up_q30_2"] > -(1 << 29):
        pass
    vehicle.rate_dps, vehicle.mode_rate = (0.0, 0.0, 0.0), mode_rate
    vehicle.accel_g = (0.0, 0.0, 0.3)
    assert vehicle.step(98)["phase"] == FLOWN
    assert vehicle.step(3)["stop_reason"] == (0 if mode_rate else UPTURNED)


def test_lost_receiver_on_the_ground_stops_at_once() -> None:
    vehicle = quadrotor(lost_steps=40)
    vehicle.throttle = 0
    vehicle.step(60)
    assert lose(vehicle, 39)["phase"] == FLOWN
    assert off(vehicle.step())


def test_no_receiver_in_use_is_never_lost() -> None:
    vehicle = flying()
    vehicle.frames, vehicle.number, vehicle.signs_off = False, 0, True
    record = vehicle.step(300)
    assert (record["phase"], record["age_steps"]) == (FLOWN, 0)
    assert "LOST" not in flags(record)


def test_stopped_stays_stopped_until_the_switch_has_been_off() -> None:
    vehicle = flying(lost_steps=5, held_steps=0)
    assert off(lose(vehicle, 7))
    vehicle.frames = True
    record = vehicle.step(500)
    assert (record["phase"], record["stop_reason"]) == (STOPPED, RECEIVER_LOST)
    vehicle.on = False
    record = vehicle.step()
    assert (record["phase"], record["stop_reason"], record["phase_steps"]) == (FLOWN, 0, 0)
    vehicle.on = True
    assert "FLIES" in flags(vehicle.step())


def test_steps_without_samples_stop_the_rotors() -> None:
    vehicle = flying(blind_steps=20)
    vehicle.missing = True
    assert "FLIES" in flags(vehicle.step(19))
    vehicle.missing = False
    assert vehicle.step()["blind_steps"] == 0, "only those in a row count"
    vehicle.missing = True
    vehicle.step(19)
    stopped = vehicle.step()
    assert stopped["stop_reason"] == NO_SAMPLES
    assert off(stopped)


def test_idle_on_the_ground_stops_the_rotors_but_not_in_the_air() -> None:
    vehicle = quadrotor(idle_limit=300)
    vehicle.throttle = 0
    assert vehicle.step(299)["phase"] == FLOWN
    assert vehicle.step()["stop_reason"] == IDLE
    vehicle.on = False
    assert vehicle.step()["idle_steps"] == 0, "switched on again it has all its time"
    vehicle = flying(idle_limit=30)
    vehicle.throttle, vehicle.accel_g = 0, (0.0, 0.0, 0.1)  # falls
    record = vehicle.step(100)
    assert (record["phase"], record["idle_steps"]) == (FLOWN, 0)


@pytest.mark.parametrize(
    "doing", ["lies", "on its side", "turns", "mode rate", "with throttle", "on a slope", "falls", "is pulled"]
)
def test_lying_on_its_back_stops_the_rotors(doing: str) -> None:
    x, y, z = leaning({"on its side": 65.0, "on a slope": 55.0}.get(doing, 160.0))
    vehicle = quadrotor((x, y, z), lying_limit=100, airmode=0)
    if doing == "turns":
        vehicle.rate_dps = (0.0, 0.0, 25.0)
    vehicle.throttle = 9000 if doing == "with throttle" else 0
    weight = {"falls": 0.7, "is pulled": 1.3}.get(doing, 1.0)
    vehicle.accel_g = (weight * x, weight * y, weight * z)
    vehicle.mode_rate = doing == "mode rate"
    assert vehicle.step(99)["phase"] == FLOWN
    assert vehicle.step()["stop_reason"] == (ON_ITS_BACK if doing in ("lies", "on its side") else 0)


@pytest.mark.parametrize(("asked", "throttle"), [(-1, 0), (-(1 << 31), 0), (5, 5), (32768, 32767), (1 << 30, 32767)])
def test_throttle_is_a_share_of_the_most(asked: int, throttle: int) -> None:
    vehicle = quadrotor()
    vehicle.throttle = asked
    assert vehicle.step()["throttle_q15"] == throttle
