"""What `quadrotor` asks for in integers: the vertical, the rates, the demands, and how four rotors share them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.kernels.fixed.rate_loop import RateLoopMode, RateLoopState, rate_loop_step
from plumb.systems.quadrotor.fixed_mixer import FULL_Q24, mix
from support.quadrotor_by_hand import FULL, ON_GROUND, WORDS, Quadrotor, flying, leaning, quadrotor

ONE_Q28, TURN_Q28 = 1 << 28, 1 << 28
AXES = ("roll", "pitch", "yaw")
MIXES = 20_000


def at_rest(accel_g: tuple[float, float, float], **words: int) -> Quadrotor:
    """On the ground, with a converged vertical from the acceleration."""
    vehicle = quadrotor(accel_g, **words)
    vehicle.throttle = ON_GROUND
    return vehicle


def three(record: dict[str, int], name: str) -> list[float]:
    """Of the axes, in units of 1 or 1 turn/s."""
    return [record[f"{name}_{axis}"] / ONE_Q28 for axis in range(3)]


@pytest.mark.parametrize("degrees", [-150, -100, -80, -30, 30, 80, 100, 120])
def test_error_grows_up_to_upside_down(degrees: int) -> None:
    """The sine of the angle, then the tangent of half of it; at 90 deg both are 1."""
    angle = math.radians(degrees)
    size = math.sin(angle) if abs(degrees) < 90 else math.tan(angle / 2.0)
    found = three(at_rest(leaning(degrees)).step(), "error_q28")
    assert found == pytest.approx([-max(min(size, 2.0), -2.0), 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("accel_g", [(0.0, 0.0, -1.0), leaning(175.0), (0.1, 0.0, -1.0)])
def test_upside_down_it_rolls(accel_g: tuple[float, float, float]) -> None:
    record = at_rest(accel_g, lying_limit=60000).step()
    assert three(record, "error_q28") == [2.0, 0.0, 0.0]
    assert three(record, "asked_turnps_q28") == [WORDS["quadrotor.tilt_rate_max_q28"] / TURN_Q28, 0.0, 0.0]


@pytest.mark.parametrize(("stick", "accel_g"), [
    ((FULL, 0, 0), leaning(35.0)),  # the right side is lower: the left one feels the weight upwards
    ((-FULL, 0, 0), leaning(-35.0)),
    ((0, FULL, 0), (-math.sin(math.radians(35.0)), 0.0, math.cos(math.radians(35.0)))),  # the nose is lower
])  # fmt: skip
def test_full_stick_asks_for_the_largest_lean(stick: tuple[int, int, int], accel_g: tuple[float, float, float]) -> None:
    vehicle = at_rest((0.0, 0.0, 1.0))
    vehicle.sticks = stick
    level = three(vehicle.step(), "error_q28")
    sine = math.sin(math.radians(35.0))
    assert level == pytest.approx([sine * stick[0] / FULL, sine * stick[1] / FULL, 0.0], abs=1e-3)
    vehicle = at_rest(accel_g)
    vehicle.sticks = stick
    assert three(vehicle.step(), "error_q28") == pytest.approx([0.0] * 3, abs=1e-3)


def test_both_full_sticks_lean_further_and_keep_their_direction() -> None:
    vehicle = at_rest((0.0, 0.0, 1.0))
    vehicle.sticks = (FULL, FULL, 0)
    sine = math.sin(math.radians(35.0))
    assert three(vehicle.step(), "error_q28") == pytest.approx([sine, sine, 0.0], abs=1e-3)


def test_yaw_turns_about_the_vertical_in_mode_level() -> None:
    vehicle = at_rest(leaning(60.0))
    before = three(vehicle.step(), "asked_turnps_q28")
    vehicle.sticks = (0, 0, FULL)
    turned = np.subtract(three(vehicle.step(), "asked_turnps_q28"), before)
    assert turned == pytest.approx(np.multiply(0.5, leaning(60.0)), abs=1e-3)


def test_sticks_ask_for_rates_in_mode_rate_and_for_a_lean_without_a_sure_vertical() -> None:
    most = [WORDS[f"quadrotor.{name}"] / TURN_Q28 for name in ("stick_rate_q28", "stick_rate_q28", "yaw_rate_max_q28")]
    vehicle = flying()
    vehicle.sticks, vehicle.mode_rate = (FULL, -FULL // 2, FULL), True
    record = vehicle.step()
    assert three(record, "asked_turnps_q28") == pytest.approx([most[0], -most[1] / 2.0, most[2]], abs=1e-4)
    assert three(record, "error_q28") == [0.0] * 3
    vehicle.mode_rate, vehicle.words = False, {**WORDS, "attitude.unsure": 0}
    assert three(vehicle.step(50), "error_q28") != [0.0] * 3, "also in the air"
    ground = Quadrotor({**WORDS, "attitude.unsure": 0}, sticks=(FULL, -FULL // 2, FULL)).step(100)
    assert three(ground, "error_q28") != [0.0] * 3, "on the ground the sticks ask for a lean all the same"


def loop(error_turnps: float, excess: int = 0, mode: RateLoopMode = RateLoopMode.FLYING) -> RateLoopState:
    """A step with an integral of 1/16 before it."""
    state = RateLoopState(0, 1 << 26, 0, excess)
    alpha, most = WORDS["quadrotor.d_alpha_q31"], WORDS["quadrotor.integral_max_q30"]
    rate_loop_step(state, WORDS, "rate_roll", alpha, most, round(error_turnps * TURN_Q28), 0, mode)
    return state


@pytest.mark.parametrize(("excess", "error", "grows"), [
    (0, 1.0, 1), (0, -1.0, -1), (9, 1.0, 0), (9, -1.0, -1), (-9, 1.0, 1), (-9, -1.0, 0),
])  # fmt: skip
def test_integral_does_not_grow_into_a_limit(excess: int, error: float, grows: int) -> None:
    by = WORDS["rate_roll.ki_dt_q35"] * error / 32.0  # Q27 by Q35 is Q62
    assert loop(error, excess).integral_q30 - (1 << 26) == pytest.approx(grows * abs(by), abs=1)


def test_integral_fades_on_the_ground_and_is_gone_without_rotors() -> None:
    assert loop(1.0, mode=RateLoopMode.GROUNDED).integral_q30 == (1 << 26) - (1 << 21)
    assert loop(1.0, mode=RateLoopMode.HELD).integral_q30 == 1 << 26, "it stays while the ground may carry the vehicle"
    assert loop(1.0, mode=RateLoopMode.OFF).integral_q30 == 0


def test_integral_stops_at_its_limit_and_derivative_brakes() -> None:
    assert loop(7.0).integral_q30 <= WORDS["quadrotor.integral_max_q30"]
    limited = {**WORDS, "rate_roll.ki_dt_q35": (1 << 31) - 1, "rate_roll.kp_q29": 0, "rate_roll.kd_q28": 1 << 27}
    state = RateLoopState(0, 0, 0, 0)
    rate_loop_step(state, limited, "rate_roll", 1 << 30, 1 << 28, 7 * TURN_Q28, TURN_Q28, RateLoopMode.FLYING)
    assert state.integral_q30 == 1 << 28
    assert state.demand_q24 == (1 << 22) - (1 << 23), "a quarter of the integral, less half of one turn/s"
    assert state.rate_filtered_turnps_q27 == 1 << 26, "half way to the new rate"


def test_feed_forward_follows_what_is_asked_for() -> None:
    words = {**WORDS, "rate_roll.kp_q29": 0, "rate_roll.kd_q28": 0, "rate_roll.ff_q29": 1 << 29}
    state = RateLoopState(0, 0, 0, 0)
    rate_loop_step(state, words, "rate_roll", 0, 0, TURN_Q28, TURN_Q28 // 2, RateLoopMode.FLYING)
    assert state.demand_q24 == FULL_Q24


@pytest.mark.parametrize(("sticks", "more", "less"), [
    ((3000, 0, 0), (1, 2), (0, 3)), ((0, 3000, 0), (2, 3), (0, 1)), ((0, 0, 3000), (0, 2), (1, 3)),
], ids=AXES)  # fmt: skip
def test_rotors_turn_the_body(sticks: tuple[int, int, int], more: tuple[int, int], less: tuple[int, int]) -> None:
    """Positive roll: more on the left; pitch: more behind; yaw: more of those that turn clockwise."""
    vehicle = flying()
    vehicle.sticks, vehicle.mode_rate = sticks, True
    record = vehicle.step()
    rotors = [record[f"rotor_q24_{number}"] for number in range(4)]
    assert min(rotors[i] for i in more) > record["thrust_q24"] > max(rotors[i] for i in less)
    pulses = [record[f"pulse_halfus_{number}"] for number in range(4)]
    assert pulses == [pytest.approx(2000 + 2000 * rotor / FULL_Q24, abs=0.51) for rotor in rotors]


def test_yaw_gives_way_to_roll_and_pitch() -> None:
    vehicle = flying()
    vehicle.sticks, vehicle.mode_rate = (FULL * 7 // 8, 0, FULL), True
    record = vehicle.step()
    assert (record["roll_excess_q24"], record["yaw_excess_q24"] > 0) == (0, True)
    vehicle.sticks = (0, 0, FULL)
    alone = vehicle.step()
    assert alone["yaw_demand_q24"] - alone["yaw_excess_q24"] == WORDS["quadrotor.yaw_max_q24"]
    assert record["yaw_demand_q24"] - record["yaw_excess_q24"] < WORDS["quadrotor.yaw_max_q24"]


@pytest.mark.parametrize("airmode", [0, 1])
def test_airmode_keeps_roll_and_pitch_without_throttle(airmode: int) -> None:
    vehicle = flying(airmode=airmode)
    vehicle.sticks, vehicle.mode_rate, vehicle.throttle = (FULL // 2, 0, 0), True, 0
    record = vehicle.step()
    got = record["roll_demand_q24"] - record["roll_excess_q24"]
    assert got == (record["roll_demand_q24"] if airmode else 0)
    assert record["thrust_q24"] == WORDS["quadrotor.idle_q24"] + got


@pytest.mark.parametrize(("airmode", "left"), [(1, 0.25), (0, 0.125)])
def test_yaw_gets_what_roll_and_pitch_leave(airmode: int, left: float) -> None:
    """In the air the larger of both counts, because no rotor has both at once and yaw against them."""
    words = {**WORDS, "quadrotor.idle_q24": 0, "quadrotor.yaw_max_q24": FULL_Q24, "quadrotor.airmode": airmode}
    demand = [FULL_Q24 // 4, FULL_Q24 // 8, FULL_Q24]
    mixed = mix(words, 1 << 14, demand, free=bool(airmode))
    assert mixed.excess == [0, 0, FULL_Q24 - left * FULL_Q24]
    assert max(mixed.rotors) == FULL_Q24
    assert min(mixed.rotors) == (0 if airmode else FULL_Q24 // 4)


def test_rounding_takes_no_rotor_below_idle() -> None:
    """Both shares are rounded away from zero here: together they are one unit more than there is."""
    words = {**WORDS, "quadrotor.idle_q24": FULL_Q24 - 16_000_000, "quadrotor.airmode": 1}
    mixed = mix(words, 1 << 14, [-6_399_997, -6_400_002, 0], free=True)
    assert mixed.excess == [3_999_999 - 6_399_997, 4_000_002 - 6_400_002, 0]
    assert (max(mixed.rotors), min(mixed.rotors)) == (FULL_Q24, words["quadrotor.idle_q24"])


def test_mixer_keeps_its_promises_for_any_demand() -> None:
    """No rotor outside idle to 1, and roll and pitch in the ratio in which they were asked for, when both are limited;
    what the axes got is what the rotors do, but for two units that rounding may take."""
    rng = np.random.default_rng(5)
    idle = rng.choice([0, 1, 838861, 1 << 22], MIXES)
    yaw_max, free = rng.integers(0, FULL_Q24, MIXES, endpoint=True), rng.random(MIXES) < 0.25
    throttle, size = rng.choice([0, 1, 2000, 16000, 32767], MIXES), rng.choice([300, 1 << 22, 1 << 25], MIXES)
    demand = np.array([(size * rng.uniform(-1.0, 1.0, MIXES)).astype(np.int64) for _ in AXES])
    mixes = []
    for run in range(MIXES):
        words = {**WORDS, "quadrotor.idle_q24": int(idle[run]), "quadrotor.yaw_max_q24": int(yaw_max[run])}
        mixes.append(mix(words, int(throttle[run]), demand[:, run].tolist(), bool(free[run])))
    thrust, tilt_limited, yaw_limited = (
        np.array([getattr(one, name) for one in mixes]) for name in ("thrust", "tilt_limited", "yaw_limited")
    )
    rotors, excess = (np.array([getattr(one, name) for one in mixes]).T for name in ("rotors", "excess"))
    got = demand - excess
    assert np.all((rotors >= idle) & (rotors <= FULL_Q24))
    assert np.all(abs(rotors.mean(axis=0) - thrust) <= 2.0)
    signs = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, -1, 1, -1]])
    assert np.all(abs(signs @ rotors - 4 * got) <= 8)

    asked = np.clip(demand[:2], -FULL_Q24, FULL_Q24)
    limited = abs(asked).sum(axis=0) > abs(got[:2]).sum(axis=0) + 2
    assert limited.sum() > MIXES // 4
    assert np.array_equal(limited | tilt_limited, tilt_limited)
    assert np.all(abs(got[0] * asked[1] - got[1] * asked[0])[limited] <= abs(asked).sum(axis=0)[limited])
    assert not np.any(excess[:2, ~tilt_limited])
    assert np.all(excess[2, ~tilt_limited & ~yaw_limited] == 0)
