"""The step of `turntable`: every bit on both hands, close to float64, and what it does when samples are wrong."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import disturbance, run_fixed, run_reference
from plumb.contract.parameters import ControlParams, dequantise, quantise
from plumb.errors import UsageError
from plumb.judging.turntable.plots import RATE_DPS, attitude, reference_attitude
from plumb.proof.compare import first_divergence
from plumb.spec.records import RECORDS, Words, names_of
from plumb.systems.turntable import scenarios as turntable
from plumb.systems.turntable.reference import rotation_deg
from plumb.systems.turntable.settings import Prefilter
from plumb.systems.turntable.tuning import TurntableTuning
from support.each_run import agreed
from support.wild_params import wild_turntable_params

RUNS, STEPS = 200, 400
NONE = turntable.NO_SAMPLE
GYRO_SATURATED, ANGULAR_SATURATED, GYRO, ANGULAR, GYRO_SPIKE, ANGULAR_SPIKE, SHOCK, REST, GYRO_LOST = (
    1 << bit for bit in range(9)
)
BIAS_DPS, BIAS_DPS2 = 360.0 / 2**34, 360.0 / 2**42 / 0.004


@lru_cache(maxsize=1)
def wild_runs() -> tuple[tuple[ControlParams, ...], npt.NDArray[np.int16]]:
    """Counts of any value, in some runs only the extremes, in some held for a while, in some small; in most of them
    each sensor is missing from some of the steps."""
    rng = np.random.default_rng(50)
    params = tuple(wild_turntable_params(rng) for _ in range(RUNS))
    raw = rng.integers(-32768, 32768, (STEPS, 6, RUNS)).astype(np.int16)
    part = RUNS // 5
    raw[:, :, :part] = rng.choice(np.array([-32768, -32767, 0, 1, 32767], np.int16), (STEPS, 6, part), p=PROBABLE)
    raw[:, :, part : 2 * part] = raw[np.arange(STEPS) // 40 * 40][:, :, part : 2 * part]
    raw[:, :, 2 * part : 3 * part] //= 500
    for sensor in (slice(0, 3), slice(3, 6)):
        missing = rng.random((STEPS, 1, RUNS)) < rng.choice([0.0, 0.3, 0.8], RUNS)
        raw[:, sensor] = np.where(missing, NONE, raw[:, sensor])
    return params, raw


PROBABLE = (0.04, 0.24, 0.24, 0.24, 0.24)


def run(params: ControlParams, raw: npt.NDArray[np.int16]) -> Words:
    return native_core.run_control(params, raw, np.zeros((len(raw), *raw.shape[2:]), np.int32))


def test_wild_parameters_are_valid() -> None:
    assert all(native_core.params_valid(params) for params in wild_runs()[0])


def test_wild_runs_agree_in_every_bit() -> None:
    params, raw = wild_runs()
    setpoint = np.random.default_rng(51).integers(-(1 << 31), 1 << 31, (STEPS, RUNS)).astype(np.int32)
    model = agreed(params, raw, setpoint, begun=20, every=2)
    assert np.bitwise_or.reduce(model["flags"]) == 511
    one_sided = ["p00_q64", "p11_q64", "p22_q64", "p33_q64", "p30_q64"] + [f"lag_step_q24_{i}" for i in range(3)]
    one_sided += [f"{name}_variance_q60_{i}" for name in ("scale", "lag") for i in range(3)]
    for name in names_of("turntable"):
        if RECORDS["turntable"][name].kind == "i" and name not in one_sided:
            assert model[name].min() < 0 < model[name].max(), name


@pytest.mark.slow
@pytest.mark.parametrize("name", turntable.TUNINGS)
def test_ordinary_runs_agree_in_every_bit(name: str) -> None:
    drawn = turntable.scenario("analog" if name == "analog" else "motion", 5, seconds=10.8)
    params, raw = quantise(drawn.fit(turntable.TUNINGS[name])), drawn.counts()
    assert first_divergence(run_fixed.run_control(params, raw, drawn.setpoint()), run(params, raw)) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "tuning"),
    [
        ("motion", "data"),
        ("motion", "attitude"),
        ("motion", "printed"),
        ("untrimmed", "untrimmed"),
        ("no_lag", "no_lag"),
    ],
)
def test_counts_to_attitude_stay_close_to_float64(scenario: str, tuning: str) -> None:
    """docs/explanation/accuracy.md: 5e-4 deg over the whole run."""
    drawn = turntable.scenario(scenario, 1000, seconds=20.0)
    params = quantise(drawn.fit(turntable.TUNINGS[tuning]))
    ideal = run_reference.run_control(dequantise(params), drawn.counts())
    apart = rotation_deg(reference_attitude(ideal), attitude(run(params, drawn.counts())))
    assert np.abs(apart).max() <= 5e-4


QUIET = turntable.with_fusion(turntable.KNOWN, rest_s=0.4, gyro_phase_s=0.0)
"""Steps at rest: 100; the gyro samples in step 0, then every two and a half steps."""


def counts(
    rate_dps: Any, angular_dps2: Any, steps: int = 1000, *, phase_s: float = 0.0, tuning: TurntableTuning = QUIET
) -> npt.NDArray[np.int16]:
    """Samples of functions of time, (steps, 6), each sensor by its own clock: functions give three axes."""
    raw = np.full((steps, 6), NONE, np.int16)
    period_s = tuning.period_us * 1e-6
    for k in range(steps):
        raw[k, 3:] = np.rint(np.array(angular_dps2(k * period_s)) * turntable.ANGULAR_LSB_PER_DPS2)
    for n in range(int((steps - 1) * period_s / 0.01 - phase_s / 0.01) + 1):
        time_s = phase_s + 0.01 * n
        raw[int(np.ceil(time_s / period_s - 1e-9)), :3] = np.rint(
            np.array(rate_dps(time_s)) * turntable.GYRO_LSB_PER_DPS
        )
    return raw


def nothing(_: float) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def ramp(time_s: float) -> tuple[float, float, float]:
    """20 deg/s^2 about x from the end of the rest."""
    return 20.0 * max(time_s - 0.4, 0.0), 0.0, 0.0


def ramp_angular(time_s: float) -> tuple[float, float, float]:
    return (20.0 if time_s > 0.4 else 10.0 if time_s > 0.398 else 0.0), 0.0, 0.0


def test_at_rest_the_attitude_stays_and_both_biases_are_found() -> None:
    biased = turntable.with_fusion(QUIET, rest_s=4.0)
    words = run(quantise(biased), counts(lambda _: (0.5, -0.25, 0.0), lambda _: (1.0, 0.0, -2.0)))
    assert np.all(words["flags"] & REST) and np.all(words["attitude_w_q30"] == 1 << 30)
    for axis, (gyro, angular) in enumerate(((0.5, 1.0), (-0.25, 0.0), (0.0, -2.0))):
        assert words[f"bias_gyro_turnps_q34_{axis}"][-1] * BIAS_DPS == pytest.approx(gyro, abs=0.01)
        assert words[f"bias_angular_turnps_q42_{axis}"][-1] * BIAS_DPS2 == pytest.approx(angular, abs=0.05)
        assert abs(words[f"rate_fused_turnps_q28_{axis}"][-1] * RATE_DPS) < 0.01


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("layer", ["data", "attitude", "printed"])
def test_a_turn_has_the_sign_and_the_size_that_the_gyro_says(axis: int, layer: str) -> None:
    """Half a second of acceleration, a second and a half of turning: 20 * (0.125 + 0.75) = 17.5 deg."""

    def about(value: float) -> tuple[float, ...]:
        return tuple(value if i == axis else 0.0 for i in range(3))

    tuning = turntable.with_fusion(QUIET, layer=layer, lag_s=0.0)
    raw = counts(
        lambda t: about(20.0 * min(max(t - 0.4, 0.0), 0.5)), lambda t: about(20.0 if 0.4 < t <= 0.9 else 0.0), 601
    )
    words = run(quantise(tuning), raw)
    turned = rotation_deg(attitude(words)[0], attitude(words)[-1])
    assert turned == pytest.approx(about(17.5), abs=0.1)
    assert words[f"rate_corrected_turnps_q28_{axis}"][-1] * RATE_DPS == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize("phase_s", [0.0, 0.0013, 0.0079])
def test_streams_of_unrelated_phase_are_aligned(phase_s: float) -> None:
    """On a ramp of 60 deg/s^2 the gyro's sample is what is expected at its own instant, whenever that is; half a step
    next to it would be 0.12 deg/s."""
    tuning = turntable.with_fusion(QUIET, gyro_phase_s=phase_s, lag_s=0.0)
    raw = counts(
        lambda t: (3.0 * ramp(t)[0], 0.0, 0.0), lambda t: (3.0 * ramp_angular(t)[0], 0.0, 0.0), phase_s=phase_s
    )
    words = run(quantise(tuning), raw)
    sampled = ((words["flags"] & GYRO) != 0) & (np.arange(1000) > 150)
    assert np.abs(words["innovation_turnps_q28_0"][sampled] * RATE_DPS).max() < 0.015


@pytest.mark.parametrize("phase_s", [0.0004, 0.0037, 0.0081])
def test_a_phase_that_nobody_knows_is_found_from_the_steps_of_the_samples(phase_s: float) -> None:
    """Within a quarter of a step: 1 ms of 20 deg/s^2."""
    words = run(quantise(turntable.with_fusion(QUIET, lag_s=0.0)), counts(ramp, ramp_angular, phase_s=phase_s))
    sampled = np.flatnonzero((words["flags"] & GYRO) != 0)[4:]
    true_age = 1.0 - ((phase_s / 0.004 + 2.5 * np.arange(4, 4 + len(sampled)) - 1e-9) % 1.0)
    assert np.abs(words["gyro_age_step_q24"][sampled] / 2.0**24 - true_age).max() <= 0.5


def test_the_gyros_lag_is_undone() -> None:
    """Behind 8 ms of lag the gyro is 0.16 deg/s behind a ramp of 20 deg/s^2; the rate that is given out is not."""

    def lagging(time_s: float) -> tuple[float, float, float]:
        passed = max(time_s - 0.4, 0.0)
        return 20.0 * (passed - 0.008 * (1.0 - np.exp(-passed / 0.008))), 0.0, 0.0

    raw = counts(lagging, ramp_angular)
    with_lag, without = (run(quantise(turntable.with_fusion(QUIET, lag_s=lag)), raw) for lag in (0.008, 0.0))
    truth = ramp(999 * 0.004)[0]
    assert with_lag["rate_corrected_turnps_q28_0"][-1] * RATE_DPS == pytest.approx(truth, abs=0.02)
    assert without["rate_corrected_turnps_q28_0"][-1] * RATE_DPS < truth - 0.12


@pytest.mark.parametrize(("column", "flag"), [(1, GYRO_SPIKE), (4, ANGULAR_SPIKE)])
def test_a_spike_is_replaced_once_and_believed_the_second_time(column: int, flag: int) -> None:
    raw = counts(nothing, nothing)
    at = np.flatnonzero(raw[:, column] != NONE)[300]
    spiked = raw.copy()
    spiked[at, column] = 20_000
    words, clean = run(quantise(QUIET), spiked), run(quantise(QUIET), raw)
    assert np.flatnonzero(words["flags"] & flag).tolist() == [at]
    assert np.all(words["attitude_y_q30"] == clean["attitude_y_q30"])
    following = np.flatnonzero(raw[:, column] != NONE)[301]
    spiked[following, column] = 20_000
    twice = run(quantise(QUIET), spiked)
    sensor = "gyro" if column < 3 else "angular"
    assert np.flatnonzero(twice["flags"] & flag)[0] == at and not twice["flags"][following] & flag
    assert twice[f"{sensor}_last_{column % 3}"][following] == 20_000


@pytest.mark.parametrize(
    ("column", "sample", "saturated"), [(0, GYRO, GYRO_SATURATED), (5, ANGULAR, ANGULAR_SATURATED)]
)
def test_a_missing_axis_or_a_rail_is_no_sample(column: int, sample: int, saturated: int) -> None:
    raw = counts(nothing, nothing)
    at = np.flatnonzero(raw[:, column] != NONE)[300]
    for value, flag in ((NONE, 0), (32767, saturated), (-32767, saturated)):
        raw[at, column] = value
        flags = run(quantise(QUIET), raw)["flags"]
        assert not flags[at] & sample and flags[at] & saturated == flag
        assert run(quantise(QUIET), raw)["clamped_steps"][-1] == (1 if flag else 0)


@pytest.mark.parametrize("layer", ["data", "attitude"])
def test_it_goes_on_through_the_loss_of_either_sensor(layer: str) -> None:
    """On a ramp of the rate: without the gyro the other sensor's integral, without that the gyro's samples."""
    tuning = turntable.with_fusion(QUIET, layer=layer, lag_s=0.0)
    for lost, flag in ((slice(0, 3), GYRO_LOST), (slice(3, 6), 0)):
        raw = counts(ramp, ramp_angular)
        raw[500:900, lost] = NONE
        words = run(quantise(tuning), raw)
        assert words["flags"][520] & GYRO_LOST == flag and not words["flags"][-1] & GYRO_LOST
        truth = np.array([10.0 * max(0.004 * k - 0.4, 0.0) ** 2 for k in range(1000)])
        found = np.unwrap(np.degrees(2.0 * np.arctan2(words["attitude_x_q30"], words["attitude_w_q30"])), period=360.0)
        assert found[899] == pytest.approx(truth[899], abs=0.2) and found[-1] == pytest.approx(truth[-1], abs=0.3)


def test_a_rate_that_only_the_gyro_saw_is_a_shock_and_is_followed() -> None:
    raw = counts(lambda t: (30.0 if t > 1.0 else 0.0, 0.0, 0.0), nothing)
    words = run(quantise(QUIET), raw)
    assert words["flags"][250:256].max() & SHOCK
    assert words["rate_corrected_turnps_q28_0"][300] * RATE_DPS == pytest.approx(30.0, abs=0.5)


def test_the_attitude_layer_keeps_two_attitudes_that_correct_each_other() -> None:
    """A bias that comes after the rest tears them apart; the difference takes it back."""
    drawn = turntable.scenario("motion", 1003)
    words = run(quantise(drawn.fit(turntable.TUNINGS["attitude"])), drawn.counts())
    other = np.stack([words[f"attitude_angular_{axis}_q30"] / 2.0**30 for axis in "wxyz"], axis=-1)
    apart = np.linalg.norm(rotation_deg(other, attitude(words)), axis=1)
    assert 0.0 < apart[drawn.scored].max() < 0.5
    assert np.any(words["innovation_turnps_q28_0"][drawn.scored] != 0)


def test_quaternions_keep_their_length() -> None:
    params, raw = wild_runs()
    words = native_core.run_control(params, raw, np.zeros((STEPS, RUNS), np.int32))
    for name in ("attitude", "attitude_angular"):
        square = sum((words[f"{name}_{axis}_q30"] / 2.0**30) ** 2 for axis in "wxyz")
        assert np.abs(square - 1.0).max() < 1e-5


def test_dequantised_is_what_was_asked_within_a_thousandth() -> None:
    asked = replace(
        turntable.DATA,
        gyro_filter=Prefilter(3.0, 0.5),
        fusion=replace(turntable.DATA.fusion, layer="attitude", gyro_phase_s=0.0047, gyro_scale=0.02, lag_s=0.004),
    )
    got = dequantise(quantise(asked))
    assert isinstance(got, TurntableTuning)
    assert (got.fusion.layer, got.period_us) == ("attitude", turntable.PERIOD_US)
    assert (got.gyro_filter.smooth, got.gyro_filter.spike) == pytest.approx((0.5, 3.0), rel=1e-3)
    for field in fields(asked.fusion):
        if field.name != "layer":
            wanted = getattr(asked.fusion, field.name)
            assert getattr(got.fusion, field.name) == pytest.approx(wanted, rel=1e-3), field.name


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"layer": "both"}, "data, attitude, printed"),
        ({"gyro_period_s": 0.001}, "every 1 to 16 steps"),
        ({"lag_s": 0.1}, "the most is 0.064"),
        ({"gyro_dps": -1.0}, "gyro_dps"),
        ({"start_gyro_dps": 1e6}, "start_gyro_dps"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        quantise(turntable.with_fusion(turntable.DATA, **change))


@pytest.mark.parametrize(
    "change",
    [
        {"gyro.gain": 1 << 30},
        {"angular.gain": 1 << 30},
        {"fusion.gyro_age_step_q24": 1 << 28, "fusion.gyro_period_step_q24": 1 << 27},
    ],
    ids=["gyro", "angular", "age"],
)
def test_what_would_overflow_is_refused_by_the_core(change: dict[str, int]) -> None:
    params = quantise(turntable.DATA)
    assert native_core.params_valid(params)
    assert not native_core.params_valid(replace(params, values={**params.values, **change}))


@pytest.mark.parametrize(("layer", "times"), [("data", 1.1), ("attitude", 1.3)])
def test_a_gyro_that_comes_back_does_not_throw_the_attitude(layer: str, times: float) -> None:
    """Its first sample says what the rate is, not how far the attitude has gone."""
    outage = turntable.faults([disturbance.parse("lost:gyro@15-20")])
    drawn = turntable.scenario("motion", 1000, seconds=21.0, faults=outage)
    words = run(quantise(drawn.fit(turntable.TUNINGS[layer])), drawn.counts())
    residual = np.linalg.norm(rotation_deg(drawn.attitude, attitude(words)), axis=1)
    assert residual[4999] > 2.0 and residual[5000:].max() < times * residual[4999]
