"""`balancer` in integers: fixed and C agree in every bit, limits are those of its arithmetic page, float64 is near."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed, run_reference
from plumb.contract.parameters import ControlParams, dequantise, quantise
from plumb.errors import UsageError
from plumb.proof import accuracy
from plumb.proof.compare import first_divergence
from plumb.spec import parameters
from plumb.spec.records import RECORDS, names_of
from plumb.spec.tuning import Kalman, Pid, Start, Trust
from plumb.systems.balancer import fixed
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer.settings import Drive, SpeedLoop, Wheel
from plumb.systems.balancer.tuning import BalancerTuning, most_edges
from support.each_run import agreed
from support.wild_params import wild_balancer_params

RUNS, STEPS = 600, 400
TURN_DEG = 360.0 / 2.0**32
EDGE = 1 << 24
DEFAULT = {row.name: row.default for row in parameters.table() if row.owner == "control"} | {"system": 1}


def wild_inputs(seed: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int16]], np.ndarray]:
    """Counts and setpoints of any value; in a third of the runs gravity and edges that stay for a while."""
    rng = np.random.default_rng(seed)
    raw = rng.integers(-32768, 32768, (STEPS, 6, RUNS)).astype(np.int16)
    setpoint = (rng.integers(-(1 << 31), 1 << 31, (STEPS, RUNS)) >> rng.integers(0, 20, (STEPS, RUNS))).astype(np.int32)
    held = np.arange(STEPS) // 40 * 40
    raw[:, :3, : RUNS // 3] = raw[held][:, :3, : RUNS // 3]
    raw[:, 3, : RUNS // 2] = np.cumsum(raw[:, 3, : RUNS // 2].astype(np.int64) % 7 - 3, axis=0).astype(np.int16)
    return raw, setpoint


def test_wild_runs_agree_in_every_bit() -> None:
    rng = np.random.default_rng(40)
    params = [wild_balancer_params(rng) for _ in range(RUNS)]
    assert all(native_core.params_valid(one) for one in params)
    raw, setpoint = wild_inputs(41)
    model = agreed(params, raw, setpoint, begun=30, every=10)
    # wild enough: every flag, and both signs of every word that can have both
    assert np.bitwise_or.reduce(model["flags"]) == 255
    for name in names_of("balancer"):
        if RECORDS["balancer"][name].kind == "i" and name not in ("p00", "p11", "k0_q29"):
            assert model[name].min() < 0 < model[name].max(), name


@pytest.mark.slow
@pytest.mark.parametrize("tuning", balancer.TUNINGS)
def test_rides_agree_in_every_bit_and_follow_float64(tuning: str) -> None:
    """The angle stays within 5e-4 deg, as every shipped tuning has to, and every other quantity within what
    docs/explanation/accuracy.md argues."""
    params = quantise(balancer.TUNINGS[tuning])
    run = balancer.scenario("rough", 3)
    raw, setpoint = run.counts(), run.setpoint()
    words = run_fixed.run_control(params, raw, setpoint)
    assert first_divergence(words, native_core.run_control(params, raw, setpoint)) is None
    length_g = np.hypot(words["gravity_x_g_q26"], words["accel_z_g_q26"].astype(float)) / 2.0**26
    assert length_g.min() > accuracy.LEAST_G
    ideal = run_reference.run_control(params, raw, setpoint)
    values = {
        "speed_mps": words["speed_mps_q26"] / 2.0**26,
        "velocity_mps": words["velocity_mps_q26"] / 2.0**26,
        "wheel_accel_g": words["wheel_accel_g_q26"] / 2.0**26,
        "tilt_measured_deg": words["tilt_measured_turn_q32"] * TURN_DEG,
        "tilt_deg": words["tilt_turn_q32"] * TURN_DEG,
        "bias_dps": words["bias_turnps_q28"] * 360.0 / 2.0**28,
        "rate_corrected_dps": words["rate_corrected_turnps_q28"] * 360.0 / 2.0**28,
        "lean_deg": words["lean_turn_q32"] * TURN_DEG,
        "command": words["command_q22"] / 2.0**22,
        "duty": words["duty_q15"] / 2.0**15,
    }
    off = {name: float(np.max(np.abs(value - ideal[name]))) for name, value in values.items()}

    innovation_deg = float(np.max(np.abs(ideal["innovation_deg"])))
    bound_deg = accuracy.chain_bound_deg(params, innovation_deg)
    assert off["tilt_deg"] < 5e-4 < bound_deg < 0.1
    velocity_mps, accel_g = accuracy.wheel_bounds(params)
    assert off["speed_mps"] < 1e-12 and off["velocity_mps"] <= velocity_mps and off["wheel_accel_g"] <= accel_g
    assert off["tilt_measured_deg"] <= np.degrees(accel_g / accuracy.LEAST_G) + 5e-6
    settings = balancer.TUNINGS[tuning]
    dt, kalman = settings.period_s, settings.kalman
    k0, _ = accuracy.steady_gains(
        kalman.q_angle_deg2_per_s * dt, kalman.q_bias_dps2_per_s * dt**3, settings.trust.r_deg2
    )
    assert off["bias_dps"] <= k0 / ((1.0 - k0) * dt) * bound_deg
    assert off["rate_corrected_dps"] <= off["bias_dps"] + 360.0 / 2.0**28

    seconds, speed, pid = run.time_s[-1] + dt, settings.speed, settings.pid
    units = 4 * 2.0**-22
    lean_deg = (speed.lean_deg_per_mps + speed.lean_deg_per_m * seconds) * velocity_mps
    lean_deg += speed.lean_deg_per_g * accel_g + units * speed.lean_max_deg
    assert not np.any(words["flags"] & fixed.FLAG_LEAN_LIMITED) and off["lean_deg"] <= lean_deg
    error_deg = off["lean_deg"] + off["tilt_deg"]
    command = (pid.kp_per_deg + pid.ki_per_deg_s * seconds) * error_deg + pid.kd_per_dps * off["rate_corrected_dps"]
    if np.any(words["flags"] & fixed.FLAG_COMMAND_LIMITED):  # one step's growth, integrated on one side only
        command += pid.ki_per_deg_s * dt * float(np.max(np.abs(ideal["error_deg"])))
    assert off["command"] <= command + units and off["duty"] <= off["command"] + 2.0**-15 < 2.1e-3


@pytest.mark.slow
@pytest.mark.parametrize("tuning", ["tuned", "arctan_fitted", "paper_rule"])
def test_its_filters_keep_their_budget_over_a_million_steps(tuning: str) -> None:
    """The whole turn, 20 deg/s of bias, outliers: 5e-4 deg, as every shipped tuning. The others have these filters."""
    params = quantise(balancer.TUNINGS[tuning])
    error_deg = accuracy.filter_error_deg(params, accuracy.hard_inputs(params, 1_000_000, seed=11))
    assert np.abs(error_deg).max() <= 5e-4 and abs(error_deg.mean()) <= 1e-5


def test_the_factory_values_are_the_tuned_set() -> None:
    tuned = quantise(balancer.TUNED)
    own = ("wheel", "speed", "drive")
    assert {name: value for name, value in DEFAULT.items() if name.split(".")[0] in own} == {
        name: value for name, value in tuned.values.items() if name.split(".")[0] in own
    }


@pytest.mark.parametrize(
    ("name", "good", "bad", "others"),
    [
        ("wheel.edges_max", 1, 0, {}),
        ("wheel.edges_max", 60, 61, {"wheel.edge_mps_q26": EDGE}),  # 15 m/s
        ("wheel.edges_max", 60, 61, {"wheel.edge_mps_q26": -EDGE}),
        ("wheel.edges_max", 32767, 32768, {"wheel.edge_mps_q26": 1}),
        ("wheel.alpha_q31", 0, -1, {}),
        ("wheel.accel_gain_q30", 0, -1, {}),
        ("speed.kp_q22", 1 << 30, (1 << 30) + 1, {}),
        ("speed.kd_q27", -(1 << 30), -(1 << 30) - 1, {}),
        ("speed.slew_q22", 1, 0, {}),
        ("drive.speed_max_mps_q26", 8 << 26, (8 << 26) + 1, {}),
        ("drive.speed_max_mps_q26", 0, -1, {}),
        ("drive.lean_max_turn_q34", 1 << 30, (1 << 30) + 1, {}),
        ("drive.lean_max_turn_q34", 0, -1, {}),
        ("drive.span_q15", 32767, 32768, {}),
        ("drive.span_q15", -32767, -32768, {}),
        ("drive.duty_max_q15", 32767, 32768, {}),
        ("drive.duty_max_q15", 0, -1, {}),
        ("drive.fall_turn_q32", 1 << 31, (1 << 31) + 1, {}),
    ],
)
def test_last_good_and_first_bad(name: str, good: int, bad: int, others: dict[str, int]) -> None:
    assert native_core.params_valid(ControlParams(DEFAULT | others | {name: good}))
    assert not native_core.params_valid(ControlParams(DEFAULT | others | {name: bad}))


def changed(**parts: object) -> BalancerTuning:
    return BalancerTuning(**{**vars(balancer.TUNED), **parts})


@pytest.mark.parametrize(
    ("tuning", "sentence"),
    [
        (changed(wheel=Wheel(edge_m=0.0037, edges_max=-1)), "whole edges"),
        (changed(wheel=Wheel(edge_m=0.0037, edges_max=50)), "up to 40"),
        (changed(wheel=Wheel(edge_m=0.0037, edges_max=40, tau_s=0.04)), "accel_share"),
        (changed(wheel=Wheel(edge_m=0.0037, edges_max=40, accel_share=-1.0)), "cannot be negative"),
        (changed(speed=SpeedLoop(lean_max_deg=23.0)), "at most 22.5 deg"),
        (changed(speed=SpeedLoop(lean_slew_dps=0.0)), "give more than 0"),
        (changed(speed=SpeedLoop(lean_deg_per_mps=100.0)), "too large"),
        (changed(speed=SpeedLoop(speed_max_mps=9.0)), "too large"),
        (changed(drive=Drive(span=-1.1)), "too small"),
        (changed(drive=Drive(fall_deg=-1.0)), "cannot be negative"),
        (changed(trust=Trust(r_deg2=0.0)), "some variance"),
        (changed(tilt="arctan"), "arcsine or atan2"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name(tuning: BalancerTuning, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        quantise(tuning)


@pytest.mark.parametrize(
    "tuning",
    [
        *balancer.TUNINGS.values(),
        changed(
            wheel=Wheel(edge_m=-0.002, edges_max=7, tau_s=0.0, accel_share=0.0),
            speed=SpeedLoop(3.0, 0.4, -2.0, 0.05, lean_max_deg=12.0, lean_slew_dps=30.0, speed_max_mps=2.5),
            pid=Pid(0.1, 0.3, 0.01, 0.02, 40.0),
            drive=Drive(0.7, 0.5, 30.0),
            kalman=Kalman(0.02, 1e-4, rate="current"),
            start=Start(5.0, -1.0, 25.0, 0.001, 4.0),
        ),
    ],
)
def test_integers_mean_what_was_asked(tuning: BalancerTuning) -> None:
    """Back from the integers every number is within 0.1 % of what went in."""
    back = dequantise(quantise(tuning))
    assert isinstance(back, BalancerTuning)
    for part in ("wheel", "kalman", "start", "speed", "pid", "drive"):
        for name, asked in vars(getattr(tuning, part)).items():
            if name == "edges_max":
                asked = most_edges(tuning.wheel, tuning.period_s)
            found = getattr(getattr(back, part), name)
            if isinstance(asked, str):
                assert found == asked
            elif (part, name) not in (("speed", "lean_slew_dps"), ("pid", "slew_per_s")) or asked < 100:
                assert found == pytest.approx(asked, rel=1.1e-3, abs=1e-9), f"{part}.{name}"
