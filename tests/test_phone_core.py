"""The step of `phone`: every bit on both hands, close to float64, and what it does where an angle cannot be told."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from plumb import accuracy, fixed, metrics, native, reference
from plumb.compare import first_divergence
from plumb.errors import UsageError
from plumb.quantise import ControlParams, dequantise, quantise
from plumb.reference.phone import rates_of
from plumb.systems import phone
from plumb.tuning import PhoneTuning, Start
from plumb.words import PHONE, Words, names_of
from wild_params import wild_phone_params

RUNS, STEPS = 400, 300
TURN_DEG, RATE_DPS = 360.0 / 2**32, 360.0 / 2**28
CLAMPED_GYRO, CLAMPED_ACCEL, ROLL_UNCORRECTED, PITCH_UNCORRECTED = 1, 2, 4, 8


@lru_cache(maxsize=1)
def wild_runs() -> tuple[tuple[ControlParams, ...], npt.NDArray[np.int16]]:
    """Counts of any value, in some runs only the extremes, in some held for a while, in some small."""
    rng = np.random.default_rng(40)
    params = tuple(wild_phone_params(rng) for _ in range(RUNS))
    raw = rng.integers(-32768, 32768, (STEPS, 6, RUNS)).astype(np.int16)
    part = RUNS // 4
    raw[:, :, :part] = rng.choice(np.array([-32768, -1, 0, 1, 32767], np.int16), (STEPS, 6, part))
    raw[:, :, part : 2 * part] = raw[np.arange(STEPS) // 40 * 40][:, :, part : 2 * part]
    raw[:, :, 2 * part : 3 * part] //= 500
    return params, raw


def run(params: ControlParams, raw: npt.ArrayLike) -> Words:
    counts = np.asarray(raw, np.int16)
    return native.run_control(params, counts, np.zeros((len(counts), *counts.shape[2:]), np.int32))


def samples(rate_dps: Any, force_g: Any, steps: int) -> npt.NDArray[np.int16]:
    """The same sample over and over, (steps, 6)."""
    columns = [np.repeat(np.array(values, np.float64)[:, None], steps, axis=1) for values in (rate_dps, force_g)]
    return phone.counts_of(*columns)


def test_wild_parameters_are_valid() -> None:
    assert all(native.params_valid(params) for params in wild_runs()[0])


def test_wild_runs_agree_in_every_bit() -> None:
    params, raw = wild_runs()
    setpoint = np.random.default_rng(41).integers(-(1 << 31), 1 << 31, (STEPS, RUNS)).astype(np.int32)
    model = fixed.run_control(params, raw, setpoint)
    assert first_divergence(model, native.run_control(params, raw, setpoint)) is None
    assert np.bitwise_or.reduce(model["flags"], axis=None) == 15
    never_negative = ("pitch_p00", "pitch_p11", "pitch_k0_q29", "roll_p00", "roll_p11", "roll_k0_q29")
    for name in names_of("phone"):
        if PHONE[name].kind == "i" and name not in never_negative:
            assert model[name].min() < 0 < model[name].max(), name
    limits = np.iinfo(np.int32)
    assert model["roll_rate_turnps_q28"].min() == limits.min and model["roll_rate_turnps_q28"].max() == limits.max


def test_one_run_and_many_runs_are_the_same_code() -> None:
    params, raw = wild_runs()
    setpoint = np.zeros((60, 30), np.int32)
    chosen = [*range(0, RUNS, 13)][:30]
    many = fixed.run_control([params[i] for i in chosen], raw[:60][:, :, chosen], setpoint)
    for column, i in enumerate(chosen):
        alone = fixed.run_control(params[i], raw[:60, :, i], setpoint[:, column])
        assert first_divergence(Words(many.record[:, column]), alone) is None


@pytest.mark.parametrize("name", phone.TUNINGS)
@pytest.mark.parametrize("scenario", phone.SCENARIOS)
def test_ordinary_runs_agree_in_every_bit(name: str, scenario: str) -> None:
    params, drawn = quantise(phone.TUNINGS[name]), phone.scenario(scenario, 5, period_us=50_000)
    assert (
        first_divergence(fixed.run_control(params, drawn.counts(), drawn.setpoint()), run(params, drawn.counts()))
        is None
    )


@pytest.mark.parametrize("name", phone.TUNINGS)
def test_both_filters_keep_the_budget_of_shipped_tunings(name: str) -> None:
    """5e-4 deg against float64 on inputs that sweep the whole turn, R jumping over all that it can be."""
    params = quantise(phone.TUNINGS[name])
    own = {key.removeprefix("roll."): value for key, value in params.values.items() if key.startswith("roll.start.")}
    own |= {f"kalman.{key}": params[f"roll.{key}"] for key in ("qa_hi", "qa_lo", "qb", "qb_frac_q30")}
    own |= {f"tilt.{key}": params[f"roll.{key}"] for key in ("r_base", "r_max")}
    for one in (params, replace(params, values={**params.values, **own})):
        assert np.abs(accuracy.filter_error_deg(one, accuracy.hard_inputs(one, 100_000, seed=7))).max() <= 5e-4


def apart_deg(tuning: PhoneTuning, raw: npt.NDArray[np.int16]) -> npt.NDArray[np.float64]:
    """Between the verticals of the integers and of float64 on the dequantised parameters, (steps, runs)."""
    params = quantise(tuning)
    words, ideal = run(params, raw), reference.run_control(params, raw)
    ours = phone.up(words["pitch_turn_q32"] * TURN_DEG, words["roll_turn_q32"] * TURN_DEG)
    return phone.inclination_deg(ours, phone.up(ideal["pitch_deg"], ideal["roll_deg"]))


THROUGH_THE_VERTICAL = (1010, 1013)
"""Of seeds 1000-1039 the two in which x comes nearest to the vertical, within 0.05 deg."""


@lru_cache(maxsize=1)
def general() -> tuple[npt.NDArray[np.int16], npt.NDArray[np.float64]]:
    """Counts (steps, 6, runs), and how far the acceleration at rest would be from x, g (steps, runs)."""
    runs = [phone.scenario("general", seed) for seed in (1000, 1001, *THROUGH_THE_VERTICAL)]
    lateral = np.stack([np.hypot(one.vertical[1], one.vertical[2]) for one in runs], axis=-1)
    return np.stack([one.counts() for one in runs], axis=-1), lateral


@pytest.mark.parametrize(("name", "bound_deg"), [("euler", 2e-2), ("printed", 5e-5)])
def test_counts_to_angles_stay_close_to_float64(name: str, bound_deg: float) -> None:
    """DESIGN.md, "Error bounds": what the filter rounds, and what the coupling makes of it beside the vertical."""
    raw, lateral_g = general()
    apart = apart_deg(phone.TUNINGS[name], raw)
    assert apart.max() <= bound_deg
    not_yet = np.cumsum(lateral_g < 0.15, axis=0) == 0
    assert not_yet.sum() > 10_000 and apart[not_yet].max() <= 5e-4


def test_beside_the_vertical_the_equations_themselves_magnify_a_difference() -> None:
    """Two runs in float64 that start a thousandth of a degree apart: passing by the vertical magnifies what is left of
    it as much as it magnifies the distance of the integers, so that this is no error of theirs."""
    raw, lateral_g = (values[..., 2:] for values in general())
    assert np.all(lateral_g.min(axis=0) < np.radians(0.05))
    tuning = dequantise(quantise(phone.EULER))
    assert isinstance(tuning, PhoneTuning)
    moved = [replace(axis, start=replace(axis.start, tilt_deg=1e-3)) for axis in (tuning.pitch, tuning.roll)]
    verticals = [
        phone.up(angles["pitch_deg"], angles["roll_deg"])
        for angles in (
            reference.run_control(one, raw) for one in (tuning, replace(tuning, pitch=moved[0], roll=moved[1]))
        )
    ]
    ideal, ours = phone.inclination_deg(*verticals), apart_deg(phone.EULER, raw)
    for run_index in range(raw.shape[2]):
        at = int(np.argmax(ours[:, run_index]))
        gains = [
            one[at - 100 : at + 100, run_index].max() / one[at - 700 : at - 150, run_index].max()
            for one in (ideal, ours)
        ]
        assert 20.0 < gains[1] < 100.0 and gains[0] == pytest.approx(gains[1], rel=0.5)


def test_the_rates_of_the_angles_are_as_exact_as_the_formats() -> None:
    """All along `general`, through the vertical too: against the formulas on the integers' own angles and rates."""
    raw, lateral_g = general()
    words = run(quantise(phone.EULER), raw)
    angles = [words[f"{axis}_turn_q32"][:-1] * TURN_DEG for axis in ("pitch", "roll")]
    body = np.stack([words[f"rate_{axis}_turnps_q28"][:-1] * RATE_DPS for axis in "xyz"])
    lost = (words["flags"][1:] & ROLL_UNCORRECTED) != 0
    expected = rates_of(phone.EULER, *angles, body, lost)
    assert lateral_g.min() < 1e-3 and lost.any()
    for axis, ideal, bound_dps in zip(("pitch", "roll"), expected, (4e-6, 5e-5), strict=True):
        assert np.abs(words[f"{axis}_rate_turnps_q28"][1:] * RATE_DPS - ideal).max() <= bound_dps


def test_dequantised_is_what_was_asked_within_a_thousandth() -> None:
    asked = replace(
        phone.EULER,
        pitch=phone.PhoneAxis(0.3, 2e-3, 4.0, Start(12.0, -1.0, 400.0, 0.01, 9.0)),
        roll=phone.PhoneAxis(0.02, 5e-5, 25.0, Start(-160.0, 2.0, 900.0, 0.0, 16.0)),
        rates="body",
        rate="current",
        r_left_out_deg2=5e3,
    )
    got = dequantise(quantise(asked))
    assert isinstance(got, PhoneTuning)
    assert (got.rates, got.rate, got.period_us) == ("body", "current", phone.PERIOD_US)
    assert got.r_left_out_deg2 == pytest.approx(5e3, rel=1e-3)
    for ours, theirs in ((got.pitch, asked.pitch), (got.roll, asked.roll)):
        assert ours.q_angle_deg2_per_s == pytest.approx(theirs.q_angle_deg2_per_s, rel=1e-3)
        assert ours.q_bias_dps2_per_s == pytest.approx(theirs.q_bias_dps2_per_s, rel=1e-3)
        assert ours.r_deg2 == pytest.approx(theirs.r_deg2, rel=1e-3)
        assert vars(ours.start) == pytest.approx(vars(theirs.start), rel=1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rates": "earth"}, "body or euler"),
        ({"r_left_out_deg2": 1.0}, "less than pitch.r_deg2"),
        ({"roll": replace(phone.EULER.roll, r_deg2=-1.0)}, "roll: "),
        ({"pitch": replace(phone.EULER.pitch, q_angle_deg2_per_s=-1.0)}, "pitch: "),
        ({"period_us": 100}, "period"),
        ({"bias_max_dps": 400.0}, "below 360"),
    ],
)
def test_what_cannot_be_is_refused_with_the_axis(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        quantise(replace(phone.EULER, **change))


BAD = [
    {"phone.rates": 2},
    {"roll.r_base": 0},
    {"roll.r_base": 300, "roll.r_max": 200},
    {"roll.r_max": (1 << 24) + 1},
    {"roll.qb_frac_q30": 1 << 30},
    {"roll.start.p01_hi": 1},
    {"gyro.gain": 1 << 30},
    {"accel_y.gain": 1 << 30},
]


@pytest.mark.parametrize("change", BAD, ids=[" ".join(change) for change in BAD])
def test_what_would_overflow_is_refused_by_the_core(change: dict[str, int]) -> None:
    params = quantise(phone.EULER)
    assert native.params_valid(params)
    assert not native.params_valid(replace(params, values={**params.values, **change}))


def test_level_and_each_axis_have_the_signs_of_the_design() -> None:
    """The screen's right edge down is a positive roll... the top edge up a negative pitch: as the force reads."""
    params = quantise(phone.EULER)
    for pitch_deg, roll_deg in ((0.0, 0.0), (30.0, 0.0), (-30.0, 0.0), (0.0, 40.0), (20.0, -50.0), (0.0, 180.0)):
        words = run(params, samples((0, 0, 0), phone.up(pitch_deg, roll_deg), 200))
        assert words["pitch_turn_q32"][-1] * TURN_DEG == pytest.approx(pitch_deg, abs=0.1)
        assert metrics.wrap_deg(words["roll_turn_q32"][-1] * TURN_DEG - roll_deg) == pytest.approx(0.0, abs=0.1)
    turning = run(params, samples((10, 20, 0), (0, 0, 1), 2))
    assert turning["roll_rate_turnps_q28"][-1] * RATE_DPS == pytest.approx(10.0, abs=0.1)
    assert turning["pitch_rate_turnps_q28"][-1] * RATE_DPS == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize("pitch_deg", [-85.0, -60.0, 0.0, 35.0, 80.0])
@pytest.mark.parametrize("roll_deg", [-170.0, -45.0, 0.0, 90.0])
def test_the_rates_of_the_angles_are_the_formulas(pitch_deg: float, roll_deg: float) -> None:
    start = [
        replace(axis, start=Start(deg)) for axis, deg in ((phone.EULER.pitch, pitch_deg), (phone.EULER.roll, roll_deg))
    ]
    tuning = replace(phone.EULER, pitch=start[0], roll=start[1])
    raw = samples((50, -80, 120), phone.up(pitch_deg, roll_deg), 1)
    words = run(quantise(tuning), raw)
    body = np.array([float(words[f"rate_{axis}_turnps_q28"][0]) for axis in "xyz"]) * RATE_DPS
    expected = rates_of(tuning, pitch_deg, roll_deg, body, False)
    got = [int(words[f"{axis}_rate_turnps_q28"][0]) * RATE_DPS for axis in ("pitch", "roll")]
    assert got == pytest.approx([float(value) for value in expected], abs=4e-5)


def test_roll_is_not_corrected_beside_the_vertical() -> None:
    """Within 0.15 g across x: the innovation is 0, the variance grows, and a phone at rest keeps its roll."""
    params = quantise(phone.EULER)
    level = samples((0, 0, 0), phone.up(0.0, 25.0), 500)
    upright = samples((0, 0, 0), phone.up(85.0, -100.0), 2000)
    back = samples((0, 0, 0), phone.up(80.0, -100.0), 200)
    words = run(params, np.concatenate([level, upright, back]))
    lost = slice(500, 2500)
    assert np.all(words["flags"][lost] == ROLL_UNCORRECTED) and not words["flags"][:500].any()
    assert not words["roll_innovation_turn_q32"][lost].any() and words["pitch_innovation_turn_q32"][lost].any()
    assert np.ptp(words["roll_turn_q32"][lost] * TURN_DEG) < 0.2
    assert words["roll_p00"][2499] > 2 * words["roll_p00"][500] > 2 * words["roll_p00"][499]
    assert words["uncorrected_steps"][-1] == 2000
    assert words["flags"][-1] == 0 and words["roll_innovation_turn_q32"][2500] != 0
    assert np.all(words["roll_variance"][lost] == params["roll.r_max"])
    assert np.all(words["pitch_variance"][lost] == params["tilt.r_base"])


def test_the_edge_of_the_singular_region_is_at_0_15_g() -> None:
    params = quantise(phone.EULER)
    for lateral_g, lost in ((0.149, True), (0.151, False)):
        words = run(params, samples((0, 0, 0), (-1.0, lateral_g, 0.0), 1))
        assert bool(words["flags"][0] & ROLL_UNCORRECTED) is lost


def test_turning_over_the_top_roll_follows_the_tangent_only_while_it_turns() -> None:
    params = quantise(replace(phone.EULER, pitch=replace(phone.EULER.pitch, start=Start(88.0, p00_deg2=1.0))))
    for rate_dps, tangent in ((4.0, 0.0), (6.0, 2**26 * 16 * np.sin(np.radians(88.0)))):
        words = run(params, samples((0, 0, rate_dps), phone.up(88.0, 0.0), 1))
        assert words["tangent_q26"][0] == pytest.approx(tangent, rel=1e-6)


def test_a_falling_phone_corrects_nothing() -> None:
    params = quantise(phone.EULER)
    words = run(
        params, np.concatenate([samples((0, 0, 0), phone.up(30.0, 20.0), 300), samples((0, 0, 0), (0.1, 0, 0.1), 50)])
    )
    assert np.all(words["flags"][300:] == ROLL_UNCORRECTED | PITCH_UNCORRECTED)
    assert not words["pitch_innovation_turn_q32"][300:].any()
    assert words["pitch_turn_q32"][-1] * TURN_DEG == pytest.approx(30.0, abs=0.05)
    assert words["roll_turn_q32"][-1] * TURN_DEG == pytest.approx(20.0, abs=0.05)


def test_counts_beyond_the_range_are_clamped_and_counted() -> None:
    tuning = replace(
        phone.EULER, gyro=replace(phone.GYRO, max_counts=1000), accel=replace(phone.ACCEL, min_counts=-5000)
    )
    raw = np.array([[0, 0, 0, 0, 0, 4096], [0, 0, 1001, 0, 0, 4096], [0, 0, 0, 0, -5001, 4096], [0, 0, 0, 0, 0, 4096]])
    words = run(quantise(tuning), raw)
    assert words["flags"].tolist() == [0, CLAMPED_GYRO, CLAMPED_ACCEL, 0] and words["clamped_steps"].tolist() == [
        0,
        1,
        2,
        2,
    ]
    assert words["raw_2"][1] == 1001 and words["rate_z_turnps_q28"][1] == words["rate_z_turnps_q28"].max()


def test_the_previous_sample_drives_the_filter_unless_asked() -> None:
    raw = np.concatenate([samples((0, 0, 0), (0, 0, 1), 1), samples((0, 100, 0), (0, 0, 1), 2)])
    previous = run(quantise(phone.EULER), raw)["pitch_rate_turnps_q28"] * RATE_DPS
    current = run(quantise(replace(phone.EULER, rate="current")), raw)["pitch_rate_turnps_q28"] * RATE_DPS
    assert previous == pytest.approx([0.0, 0.0, 100.0], abs=0.05) and current == pytest.approx(
        [0.0, 100.0, 100.0], abs=0.05
    )
