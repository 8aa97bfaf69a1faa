"""The step of `phone`: every bit on both hands, close to float64, and its behaviour where an angle is not
determined."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed, run_reference
from plumb.contract.parameters import ControlParams, dequantise, quantise
from plumb.errors import UsageError
from plumb.proof import accuracy, golden, metrics
from plumb.proof.compare import first_divergence
from plumb.spec.records import RECORDS, Words, names_of
from plumb.spec.tuning import Start
from plumb.systems.phone import scenarios as phone
from plumb.systems.phone.reference import rates_of
from plumb.systems.phone.tuning import PhoneAxis, PhoneTuning
from support.each_run import agreed
from support.wild_params import wild_phone_params

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
    return native_core.run_control(params, counts, np.zeros((len(counts), *counts.shape[2:]), np.int32))


def samples(rate_dps: Any, force_g: Any, steps: int) -> npt.NDArray[np.int16]:
    """The same sample over and over, (steps, 6)."""
    columns = [np.repeat(np.array(values, np.float64)[:, None], steps, axis=1) for values in (rate_dps, force_g)]
    return phone.counts_of(*columns)


def test_wild_parameters_are_valid() -> None:
    assert all(native_core.params_valid(params) for params in wild_runs()[0])


def test_wild_runs_agree_in_every_bit() -> None:
    params, raw = wild_runs()
    setpoint = np.random.default_rng(41).integers(-(1 << 31), 1 << 31, (STEPS, RUNS)).astype(np.int32)
    model = agreed(params, raw, setpoint, begun=30, every=10)
    assert np.bitwise_or.reduce(model["flags"]) == 15
    never_negative = ("pitch_p00", "pitch_p11", "pitch_k0_q29", "roll_p00", "roll_p11", "roll_k0_q29")
    for name in names_of("phone"):
        if RECORDS["phone"][name].kind == "i" and name not in never_negative:
            assert model[name].min() < 0 < model[name].max(), name
    limits = np.iinfo(np.int32)
    assert model["roll_rate_turnps_q28"].min() == limits.min and model["roll_rate_turnps_q28"].max() == limits.max


@pytest.mark.parametrize("name", phone.TUNINGS)
@pytest.mark.parametrize("scenario", phone.SCENARIOS)
def test_ordinary_runs_agree_in_every_bit(name: str, scenario: str) -> None:
    params, drawn = quantise(phone.TUNINGS[name]), phone.scenario(scenario, 5, period_us=50_000)
    assert (
        first_divergence(run_fixed.run_control(params, drawn.counts(), drawn.setpoint()), run(params, drawn.counts()))
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
    words, ideal = run(params, raw), run_reference.run_control(params, raw)
    ours = phone.up(words["pitch_turn_q32"] * TURN_DEG, words["roll_turn_q32"] * TURN_DEG)
    return phone.inclination_deg(ours, phone.up(ideal["pitch_deg"], ideal["roll_deg"]))


@lru_cache(maxsize=1)
def general() -> tuple[npt.NDArray[np.int16], npt.NDArray[np.float64]]:
    """Counts (steps, 6, runs), and how far the acceleration at rest would be from x, g (steps, runs). On the last three
    of these seeds x comes within 0.1 deg of the vertical."""
    runs = [phone.scenario("general", seed) for seed in (1000, 1017, 1010, 1013, 1018)]
    lateral = np.stack([np.hypot(one.vertical[1], one.vertical[2]) for one in runs], axis=-1)
    return np.stack([one.counts() for one in runs], axis=-1), lateral


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bound_deg"), [("euler", 5e-4), ("printed", 5e-5)])
def test_counts_to_angles_stay_close_to_float64(name: str, bound_deg: float) -> None:
    """docs/explanation/accuracy.md: what the filter rounds, through the vertical too."""
    raw, lateral_g = general()
    assert np.all(lateral_g.min(axis=0)[2:] < np.radians(0.1))
    assert apart_deg(phone.TUNINGS[name], raw).max() <= bound_deg


def test_the_rates_of_the_angles_are_as_exact_as_the_formats() -> None:
    """All along `general`, through the vertical too: against the formulas on the integers' own angles and rates."""
    raw, lateral_g = general()
    words = run(quantise(phone.EULER), raw)
    pitch_deg, roll_deg = (words[f"{axis}_turn_q32"][:-1] * TURN_DEG for axis in ("pitch", "roll"))
    body = np.stack([words[f"rate_{axis}_turnps_q28"][:-1] * RATE_DPS for axis in "xyz"])
    lost = (words["flags"][1:] & ROLL_UNCORRECTED) != 0
    over = (np.abs(pitch_deg) > 90.0) & ~lost
    sided = np.where(over, 180.0 - pitch_deg, pitch_deg), np.where(over, roll_deg + 180.0, roll_deg)
    expected = rates_of(phone.EULER, *sided, body, lost)
    assert lateral_g.min() < 1e-3 and lost.any() and over.any()
    for axis, ideal, bound_dps in zip(("pitch", "roll"), expected, (4e-6, 5e-5), strict=True):
        assert np.abs(words[f"{axis}_rate_turnps_q28"][1:] * RATE_DPS - ideal).max() <= bound_dps


def test_dequantised_is_what_was_asked_within_a_thousandth() -> None:
    asked = replace(
        phone.EULER,
        pitch=PhoneAxis(0.3, 2e-3, 4.0, Start(12.0, -1.0, 400.0, 0.01, 9.0)),
        roll=PhoneAxis(0.02, 5e-5, 25.0, Start(-160.0, 2.0, 900.0, 0.0, 16.0)),
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
    {"accel.gain": 1 << 30},
]


@pytest.mark.parametrize("change", BAD, ids=[" ".join(change) for change in BAD])
def test_what_would_overflow_is_refused_by_the_core(change: dict[str, int]) -> None:
    params = quantise(phone.EULER)
    assert native_core.params_valid(params)
    assert not native_core.params_valid(replace(params, values={**params.values, **change}))


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


def test_roll_is_not_corrected_near_the_vertical() -> None:
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


def turned_over(top_deg: float) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.float64]]:
    """Counts of a phone that is turned about y in 4 s, held for 20 s, with 0.2 deg/s of bias; and its true vertical."""
    time_s = np.arange(0.0, 29.0, 0.01)
    euler_deg = np.zeros((3, len(time_s)))
    euler_deg[1] = np.clip((time_s - 5.0) / 4.0, 0.0, 1.0) * top_deg
    vertical = phone.up(euler_deg[1], euler_deg[2])
    return phone.counts_of(phone.body_rates(euler_deg, 0.01) + 0.2, vertical), vertical


@pytest.mark.parametrize("top_deg", [100.0, 120.0, -150.0])
def test_over_the_top_the_angles_change_sides(top_deg: float) -> None:
    """Beyond 90 degrees the acceleration shows 180 - pitch and roll + 180; angles that stayed would be pulled away."""
    raw, vertical = turned_over(top_deg)
    words = run(quantise(phone.EULER), raw)
    pitch_deg, roll_deg = (words[f"{axis}_turn_q32"] * TURN_DEG for axis in ("pitch", "roll"))
    error_deg = phone.inclination_deg(phone.up(pitch_deg, roll_deg), vertical)
    assert pitch_deg[-1] == pytest.approx(np.copysign(180.0, top_deg) - top_deg, abs=0.5)
    assert abs(metrics.wrap_deg(roll_deg[-1] - 180.0)) < 6.0, "of roll, 80 degrees up, the vertical shows a sixth"
    assert np.all(np.abs(pitch_deg[1:][(words["flags"][1:] & ROLL_UNCORRECTED) == 0]) < 90.5)
    assert error_deg.max() < 10.0 and error_deg[-1] < 1.0


def test_a_golden_vector_goes_over_the_top_on_every_board() -> None:
    (vector,) = (
        one for one in golden.load(golden.vectors_folder(), ["phone"]) if one.name == "phone_over_the_top_link"
    )
    words = native_core.run_control(vector.params, vector.raw, vector.setpoint)
    over = np.abs(words["pitch_turn_q32"][:-1].astype(np.int64)) > 1 << 30
    assert vector.on_link and np.count_nonzero(over & (words["flags"][1:] & ROLL_UNCORRECTED == 0)) == 2


@pytest.mark.parametrize(
    ("lateral_deg", "rates", "changes"), [(80.0, "euler", True), (85.0, "euler", False), (80.0, "body", False)]
)
def test_sides_change_with_the_bias_and_only_where_roll_is_determined(
    lateral_deg: float, rates: Literal["body", "euler"], changes: bool
) -> None:
    """In the singular zone nothing shows the side, and the source's filter has none."""
    tuning = replace(
        phone.EULER,
        rates=rates,
        pitch=replace(phone.EULER.pitch, start=Start(100.0, 2.0, 1e-6, 0.0, 1e-6)),
        roll=replace(phone.EULER.roll, start=Start(10.0, 0.5, 1e-6, 0.0, 1e-6)),
    )
    words = run(quantise(tuning), samples((0, 0, 0), phone.up(lateral_deg, 10.0), 1))
    got = [
        words[name][0] * unit
        for name, unit in (
            ("pitch_turn_q32", TURN_DEG),
            ("pitch_bias_turnps_q28", RATE_DPS),
            ("roll_turn_q32", TURN_DEG),
            ("roll_bias_turnps_q28", RATE_DPS),
        )
    ]
    assert got == pytest.approx([80.0, -2.0, -170.0, 0.5] if changes else [100.0, 2.0, 10.0, 0.5], abs=0.05)


def test_a_rate_of_an_angle_at_its_limit_is_counted() -> None:
    """16 times 200 deg/s across is more than 8 turn/s."""
    tuning = replace(phone.EULER, pitch=replace(phone.EULER.pitch, start=Start(88.0, p00_deg2=1.0)))
    for rate_dps, limit in ((175.0, 0), (200.0, CLAMPED_GYRO)):
        raw = samples((0, 0, rate_dps), phone.up(80.0, 0.0), 1)
        words = run(quantise(tuning), raw)
        assert (words["flags"][0], words["clamped_steps"][0]) == (limit, limit)
        assert abs(words["roll_rate_turnps_q28"][0] * RATE_DPS) <= 2880.0
        assert run_reference.run_control(tuning, raw)["roll_rate_dps"][0] == pytest.approx(
            min(16 * rate_dps, 2880.0), rel=1e-3
        )


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
