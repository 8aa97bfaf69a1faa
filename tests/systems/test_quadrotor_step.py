"""The step of `quadrotor` in integers: who flies, when the rotors stop, and that ints and arrays agree."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.spec import declarations
from plumb.spec.records import names_of, packer
from plumb.systems.quadrotor import fixed
from support.quadrotor_by_hand import GROUND_STEPS, WORDS, Quadrotor, flying, leaning, quadrotor
from support.wild_quadrotor import RUNS, STEPS, wild_inputs, wild_words

FLOWN, HELD, LANDING, STOPPED = range(4)
NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE = 1, 2, 4, 8, 16
FLAGS = {flag.name: 1 << bit for bit, flag in enumerate(declarations.system("quadrotor").flags)}
ROTORS = [f"rotor_q24_{number}" for number in range(4)]
PULSES = [f"pulse_halfus_{number}" for number in range(4)]


def flags(record: dict[str, int]) -> set[str]:
    return {name for name, bit in FLAGS.items() if record["flags"] & bit}


def off(record: dict[str, int]) -> bool:
    """No rotor turns."""
    quiet = not any(record[name] for name in [*ROTORS, "thrust_q24"])
    return quiet and {record[name] for name in PULSES} == {WORDS["esc.neutral_halfus"]} and "FLIES" not in flags(record)


def test_one_run_and_many_runs_are_the_same_code() -> None:
    """Ints without a limit against int64, and every word within its type."""
    rng = np.random.default_rng(26)
    words = [wild_words(rng) for _ in range(RUNS)]
    assert all(fixed.control_valid(one) for one in words)
    raw, throttle = wild_inputs(rng)
    columns = {name: np.array([one[name] for one in words], np.int64) for name in words[0]}
    state, names = fixed.control_init(columns), names_of("quadrotor")
    many = np.array([
        np.broadcast_arrays(*fixed.control_step(state, columns, list(raw[step]), throttle[step]))
        for step in range(STEPS)
    ])  # fmt: skip
    pack = packer("quadrotor").pack
    for run, one in enumerate(words):
        alone = fixed.control_init(one)
        for step in range(STEPS):
            row = fixed.control_step(alone, one, raw[step, :, run].tolist(), int(throttle[step, run]))
            assert row == tuple(many[step, :, run].tolist()), (run, step)
            assert len(pack(*row)) == 4 * len(names)
    seen = {name: many[:, place] for place, name in enumerate(names)}
    assert set(np.unique(seen["phase"])) == {FLOWN, HELD, LANDING, STOPPED}
    assert set(np.unique(seen["stop_reason"])) == {0, NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE}
    assert np.bitwise_or.reduce(seen["flags"], axis=None) == (1 << len(FLAGS)) - 1


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
        assert (record["phase"], record["throttle_q15"]) == (HELD, before["throttle_q15"])
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
    vehicle = flying(lost_steps=5, held_steps=20, lost_action=1, land_q15=13000, **words)
    record = lose(vehicle, 30)
    assert (record["phase"], record["throttle_q15"]) == (LANDING, 13000)
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
    assert vehicle.step(96)["phase"] == LANDING
    assert vehicle.step(10)["stop_reason"] == RECEIVER_LOST
    vehicle = flying(lost_steps=5, held_steps=2, lost_action=1, land_q15=0)  # no thrust: the weight tells the ground
    assert lose(vehicle, 40)["stop_reason"] == RECEIVER_LOST
    assert "AIRBORNE" not in flags(vehicle.step())


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


@pytest.mark.parametrize("doing", ["lies", "turns", "mode rate", "with throttle", "on its side", "falls", "is pulled"])
def test_lying_on_its_back_stops_the_rotors(doing: str) -> None:
    x, y, z = leaning(85.0 if doing == "on its side" else 160.0)
    vehicle = quadrotor((x, y, z), lying_limit=100, airmode=0)
    if doing == "turns":
        vehicle.rate_dps = (0.0, 0.0, 25.0)
    vehicle.throttle = 9000 if doing == "with throttle" else 0
    weight = {"falls": 0.7, "is pulled": 1.3}.get(doing, 1.0)
    vehicle.accel_g = (weight * x, weight * y, weight * z)
    vehicle.mode_rate = doing == "mode rate"
    assert vehicle.step(99)["phase"] == FLOWN
    assert vehicle.step()["stop_reason"] == (ON_ITS_BACK if doing == "lies" else 0)


@pytest.mark.parametrize(("asked", "throttle"), [(-1, 0), (-(1 << 31), 0), (5, 5), (32768, 32767), (1 << 30, 32767)])
def test_throttle_is_a_share_of_the_most(asked: int, throttle: int) -> None:
    vehicle = quadrotor()
    vehicle.throttle = asked
    assert vehicle.step()["throttle_q15"] == throttle
