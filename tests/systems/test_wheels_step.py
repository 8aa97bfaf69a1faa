"""The rules of the step of `wheels`, each on inputs made for it: who rides, who steers, what a slipping wheel does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from plumb.contract import run_fixed
from plumb.contract.parameters import quantise
from plumb.spec import declarations
from plumb.spec.records import Words
from plumb.systems.wheels import fixed_state
from plumb.systems.wheels import scenarios as wheels

PARAMS = quantise(wheels.STEERED)
DECLARED = declarations.system("wheels")
UP = {"accel_z": 2048, "switches": fixed_state.MOTORS_ON}
STOPPED, RIDDEN, STOPPING = fixed_state.STOPPED, fixed_state.RIDDEN, fixed_state.STOPPING


def run(steps: int, speed: int = 0, *, begun: bool = True, **inputs: npt.ArrayLike) -> Words:
    """The words of steps upright; inputs: a number, or one of every step, by name of a channel or command. begun: a
    rider has stood on it for long; else he steps on with the first step."""
    names = [channel.name for channel in DECLARED.channels]
    raw = np.zeros((steps, DECLARED.inputs), np.int16)
    for name, values in {**UP, "rider": 1, **inputs}.items():
        at = names.index(name) if name in names else DECLARED.counts + COMMANDS.index(name)
        raw[:, at] = np.asarray(values)
    raw[1::2, 1:3] += 1  # an accelerometer is never still
    before = np.repeat(raw[:1], 2 * TAKES * begun, axis=0)
    before[:, 1], before[:, 2], before[:, names.index("rider")] = 0, 2048, 1
    before[1::2, 1:3] += 1
    receiver = DECLARED.counts + COMMANDS.index("receiver")
    before[:, receiver] = np.where(before[:, receiver] != 0, 255, 0)
    whole = np.concatenate([before, raw])
    words = run_fixed.run_control(PARAMS, whole, np.full(len(whole), speed, np.int32))
    return Words(words.record[len(before) :])


COMMANDS = [command.name for command in DECLARED.step_commands]
ABSENT, STOPS = PARAMS["wheels.absent_steps"], PARAMS["wheels.stopping_steps"]
TAKES = -(-ABSENT // fixed_state.CLOSED_TAKES)
"""Closed steps after which somebody rides."""


def test_it_waits_for_its_rider_and_begins_anew_when_he_is_back() -> None:
    rider = np.ones(ABSENT + STOPS + 90)
    rider[:10] = rider[30 : ABSENT + STOPS + 40] = 0
    phase = run(len(rider), rider=rider, begun=False)["phase"].tolist()
    left = 30 + ABSENT - 1
    stops = left + STOPS + 1
    taken = 10 + TAKES - 1
    expected = [STOPPED] * taken + [RIDDEN] * (left - taken) + [STOPPING] * (stops - left)
    assert phase[: len(expected)] == expected
    back = ABSENT + STOPS + 40 + TAKES - 1
    assert phase[stops:back] == [STOPPED] * (back - stops)
    assert set(phase[back:]) == {RIDDEN}


def test_a_switch_that_opens_shortly_changes_nothing_and_a_rider_who_is_back_goes_on() -> None:
    rider = np.ones(3 * ABSENT)
    rider[5 : 5 + ABSENT - 1] = 0
    assert set(run(len(rider), rider=rider)["phase"].tolist()) == {RIDDEN}
    rider[5 : 5 + ABSENT] = 0
    phase = run(len(rider), rider=rider)["phase"].tolist()
    assert phase.count(STOPPING) == TAKES and phase[-1] == RIDDEN


@pytest.mark.parametrize("seed", range(8))
def test_a_switch_that_chatters_is_no_rider_and_a_rider_who_shakes_is_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begins, steps, period = int(rng.integers(100, 200)), STOPS + 6 * ABSENT, 60
    closed, at = int(rng.integers(1, 5)), int(rng.integers(0, period))
    chatters = (np.arange(steps) + at) % period < closed
    rider = np.where(np.arange(steps) < begins, 1, chatters)
    phase = run(steps, rider=rider)["phase"]
    assert phase[begins - 1] == RIDDEN and phase[-1] == STOPPED
    gone = int(np.argmax(phase == STOPPING))
    assert begins < gone <= begins + 2 * ABSENT and not (phase[gone:] == RIDDEN).any()
    shakes = np.where(np.arange(steps) < begins, 1, ~chatters)
    assert set(run(steps, rider=shakes)["phase"].tolist()) == {RIDDEN}


def test_a_vehicle_that_lies_takes_no_rider() -> None:
    words = run(2000, accel_x=2048 * np.ones(2000), accel_z=1)
    lies = np.abs(words["tilt_turn_q32"]) > PARAMS["wheels.up_turn_q32"]
    assert words["phase"][0] == RIDDEN and lies[-1] and words["phase"][-1] == STOPPED
    rider = np.zeros(400)
    rider[300:] = 1
    words = run(400, accel_x=2048 * np.ones(400), accel_z=1, rider=rider, begun=False)
    assert set(words["phase"].tolist()) == {STOPPED}
    assert not words["duty_left_q15"].any()


def test_nobody_rides_no_duty_whatever_is_asked() -> None:
    words = run(50, speed=32767, rider=0, yaw=32767, accel_x=-300, begun=False)
    for name in ("duty_left_q15", "duty_right_q15", "asked_mps_q26", "asked_turnps_q28", "turn_integral_q30"):
        assert not words[name].any(), name


@pytest.mark.parametrize(
    ("inputs", "speed", "asked"),
    [
        ({}, 32767, (1.0, 0.0)),
        ({"yaw": 16384}, -16384, (-0.5, 45.0)),
        ({"pitch": 32767, "yaw": 32767}, 0, (0.0, 90.0)),
        ({"pitch": 32767, "roll": 32767, "receiver": 7}, 0, (1.0, -90.0)),
        ({"pitch": 16384, "yaw": 32767, "roll": -32767, "receiver": 7}, 30000, (0.5, 90.0)),
        ({"pitch": 32767, "yaw": 32767, "receiver": 256 + 7}, 0, (0.0, 0.0)),
    ],
)
def test_who_steers(inputs: Mapping[str, int], speed: int, asked: tuple[float, float]) -> None:
    words = run(3, speed, begun=True, **inputs)
    found = words["asked_mps_q26"][-1] / 2**26, words["asked_turnps_q28"][-1] / 2**28 * 360.0
    assert found == pytest.approx(asked, abs=0.01)


def test_switched_off_no_integral_grows_and_no_rider_is_missed() -> None:
    switches = np.zeros(80)
    switches[60:] = fixed_state.MOTORS_ON
    words = run(len(switches), switches=switches, receiver=1 + np.arange(80), pitch=16384, yaw=16384, accel_x=-300)
    off, on = slice(0, 60), slice(60, None)
    for name in ("phase", "stop_reason", "duty_left_q15", "duty_right_q15", "asked_mps_q26", "turn_integral_q30"):
        assert not words[name][off].any(), name
    assert set(words["phase"][on].tolist()) == {RIDDEN} and words["duty_left_q15"][on].all()
    by_link = run(20, switches=0)
    assert set(by_link["phase"].tolist()) == {RIDDEN}, "without a receiver there is no such switch"


def test_a_silent_receiver_is_lost_and_found_again() -> None:
    lost_steps = PARAMS["wheels.lost_steps"]
    number = np.full(lost_steps + 20, 9)
    number[-5:] = 10
    words = run(len(number), pitch=32767, receiver=number)
    lost = (words["flags"] & fixed_state.LOST) != 0
    assert lost.tolist() == [False] * lost_steps + [True] * 15 + [False] * 5
    assert (words["asked_mps_q26"] == 0).tolist() == lost.tolist()


def test_a_slipping_wheel_is_not_believed() -> None:
    steps = np.arange(60)
    left, right = 4 * steps, 4 * steps
    left = left + np.cumsum(np.where(steps >= 30, 40, 0))
    words = run(60, left=left, right=right)
    slips = (words["flags"] & fixed_state.SLIPS) != 0
    assert not slips[:30].any() and slips[30:].all()
    assert words["sum_counts"].tolist() == [0] + [8] * 59
    assert not np.ptp(words["turn_bias_turnps_q28"][30:])
    turned = words["duty_right_q15"] - words["duty_left_q15"]
    assert not turned[30:].any()


def test_the_bias_of_the_upward_gyro_follows_the_wheels() -> None:
    tuning = replace(wheels.STEERED, turning=replace(wheels.STEERED.turning, bias_tau_s=0.5))
    raw = np.zeros((1000, DECLARED.inputs), np.int16)
    raw[:, 2], raw[:, 3], raw[:, 6] = 2048, 16, 1
    words = run_fixed.run_control(quantise(tuning), raw, np.zeros(1000, np.int32))
    assert words["turn_bias_turnps_q28"][-1] / 2**28 * 360.0 == pytest.approx(16 / 16.4, rel=0.01)


def test_turning_gets_what_balance_leaves() -> None:
    words = run(400, yaw=32767, accel_x=np.where(np.arange(400) < 200, -100, -1500))
    duty, most = np.abs(words["duty_q15"]), PARAMS["drive.duty_max_q15"]
    turn = (words["duty_right_q15"] - words["duty_left_q15"]) // 2
    drives = (words["flags"] & fixed_state.DRIVES) != 0
    assert drives.any() and (np.abs(turn)[drives] <= np.minimum(most - duty, 13107)[drives]).all()
    assert (duty[drives] == most).any() and not turn[drives & (duty == most)].any()
    assert (np.abs(words["duty_left_q15"]) <= most).all() and (np.abs(words["duty_right_q15"]) <= most).all()
