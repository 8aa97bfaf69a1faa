"""`turntable` as prescribed: motion and rates belong together, sensors and faults are as stated, figures reached."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from plumb.contract import disturbance
from plumb.errors import UsageError
from plumb.judging.turntable import figures as turntable_figures
from plumb.judging.turntable import gyro as turntable_gyro
from plumb.proof import figures
from plumb.systems.turntable import reference as reference_turntable
from plumb.systems.turntable import scenarios as turntable
from plumb.systems.turntable.motion import FADE_S, REST_S, lagged, motion
from plumb.systems.turntable.reference import multiply, rotation_deg, turned
from support.campaigns import campaign
from support.once_per_run import once_per_run, run_folder

SEEDS = range(1000, 1000 + campaign(2, 6))


def test_rates_carry_the_attitude_to_where_the_truth_has_it() -> None:
    run = turntable.scenario("motion", 7, seconds=16.0, period_us=1000)
    mean = (run.rate_dps[1:] + run.rate_dps[:-1]) / 2.0
    attitude = run.attitude[0]
    for rate in mean:
        attitude = turned(attitude, rate * 1e-3)
    assert np.abs(rotation_deg(run.attitude[-1], attitude)).max() < 2e-3


def test_it_is_at_rest_then_fades_into_two_waves_about_each_axis() -> None:
    slow, quick = (np.full(3, 0.2), np.full(3, 40.0)), (np.full(3, 0.8), np.full(3, 8.0))
    time_s = np.arange(0.0, 30.0, 1e-3)
    attitude, rate = motion(time_s, slow, quick)
    rest = time_s < REST_S
    assert not rate[rest].any() and np.all(attitude[rest] == [1.0, 0.0, 0.0, 0.0])
    assert np.abs(np.diff(rate, axis=0)).max() < 1.0, "no step of the rate, at the start of the motion neither"
    later = time_s[time_s > REST_S + FADE_S] - REST_S
    wave = np.radians(40.0 * np.sin(2 * np.pi * 0.2 * later) + 8.0 * np.sin(2 * np.pi * 0.8 * later))
    half = [np.array([np.cos(wave / 2), *(np.sin(wave / 2) * (i == axis) for i in range(3))]).T for axis in range(3)]
    expected = multiply(multiply(half[2], half[1]), half[0])
    assert np.abs(rotation_deg(attitude[time_s > REST_S + FADE_S], expected)).max() < 1e-6


def test_the_sensors_are_as_stated() -> None:
    """At rest: bias, white noise of the stated density, 20 sigma in 0.5 % of the samples; later the scale."""
    excess, spikes, biases = [], [], []
    for seed in range(8):
        run = turntable.scenario("motion", seed)
        rest = run.gyro_s < REST_S
        gyro = run.gyro_clean[rest] / turntable.GYRO_LSB_PER_DPS
        biases.append(gyro.mean(axis=0))
        excess.append((gyro - gyro.mean(axis=0)).std())
        spikes.append(np.mean(run.gyro != run.gyro_clean))
    assert np.mean(excess) == pytest.approx(0.03 / np.sqrt(0.01), rel=0.02)
    assert np.mean(spikes) == pytest.approx(0.005, rel=0.2)
    assert 0.6 < np.abs(biases).max() <= 1.05
    angular = turntable.scenario("clean", 3)
    counts = angular.angular[angular.time_s < REST_S] / turntable.ANGULAR_LSB_PER_DPS2
    assert np.mean(counts.std(axis=0)) == pytest.approx(0.3 / np.sqrt(0.004), rel=0.02)
    assert np.all(np.diff(angular.gyro_s) == pytest.approx(0.01)) and 0.0 <= angular.gyro_s[0] < 0.01


def test_the_gyro_lags_by_8_ms() -> None:
    time_s = np.arange(0.0, 2.0, 2e-4)
    ramp = np.stack([100.0 * time_s] * 3, axis=1)
    assert lagged(ramp, 0.008, 2e-4)[-1] == pytest.approx(100.0 * (time_s[-1] - 0.008), rel=1e-6)
    assert lagged(ramp, 0.0, 2e-4) is ramp


def test_each_sample_of_the_gyro_is_in_the_first_step_after_it() -> None:
    run = turntable.scenario("motion", 4, seconds=2.0)
    raw = run.counts()
    steps = np.flatnonzero(raw[:, 0] != turntable.NO_SAMPLE)
    age_s = run.time_s[steps] - run.gyro_s
    assert len(steps) == len(run.gyro_s) and np.all((age_s >= -1e-9) & (age_s < 0.004))
    assert np.all(raw[:, 3:] != turntable.NO_SAMPLE)
    assert run.fit(turntable.DATA).fusion.gyro_phase_s == run.gyro_s[0]


@pytest.mark.parametrize(
    ("kind", "what", "columns"), [("lost", "gyro", slice(0, 3)), ("railed", "angular", slice(3, 6))]
)
def test_a_fault_touches_its_sensor_and_its_time(kind: str, what: str, columns: slice) -> None:
    asked = turntable.faults([disturbance.parse(f"{kind}:{what}@2-3")])
    clean, spoiled = (turntable.scenario("motion", 5, seconds=5.0, faults=f).counts() for f in ((), asked))
    differs = np.flatnonzero((clean != spoiled).any(axis=1))
    assert 500 <= differs.min() < 503 and 747 <= differs.max() < 750
    assert not (np.delete(clean, columns, 1) != np.delete(spoiled, columns, 1)).any()
    value = turntable.NO_SAMPLE if kind == "lost" else turntable.COUNT_MAX
    assert np.all(spoiled[differs][:, columns] == value)


def test_what_no_run_has_is_refused() -> None:
    for text in ("lost:accel@1-2", "push:0.1@1-2"):
        with pytest.raises(UsageError, match="turntable has no fault"):
            turntable.faults([disturbance.parse(text)])
    with pytest.raises(UsageError, match="has no scenario"):
        turntable.scenario("still", 1)


def test_the_gyro_alone_is_a_trapezium_of_its_own_samples() -> None:
    """On a gyro without errors it is the truth, and what its lag takes off is what undoing it gives back."""
    perfect: dict[str, Any] = {"gyro_scale": 0.0, "spike_share": 0.0, "bias": 0.0, "walk_dps": 0.0, "gyro_dps": 0.0}
    run = turntable.scenario("motion", 5, seconds=20.0, **perfect, lag_s=0.0)
    assert np.abs(turntable_gyro.residuals_deg(run)).max() < 0.06
    behind = turntable.scenario("motion", 5, seconds=20.0, **perfect)
    assert np.abs(turntable_gyro.residuals_deg(behind)).max() > 0.5
    assert np.abs(turntable_gyro.residuals_deg(behind, lag_s=0.008)).max() < 0.06


Rows = dict[tuple[str, str, str], figures.Figure]


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """On SEEDS."""

    def found() -> Rows:
        parts = (turntable_figures.motion_rows, turntable_figures.white_rows, turntable_figures.preset_rows)
        return {(row.scenario, row.tuning, row.claim): row for part in parts for row in part(SEEDS)}

    return once_per_run(run_folder(tmp_path_factory), "turntable, figures", found)


@pytest.mark.slow
def test_the_figures_are_reached(rows: Rows) -> None:
    asked = [row for row in rows.values() if row.sense not in figures.UNASKED]
    assert len(asked) >= 9 and [row.claim for row in asked if not row.met] == []


def test_the_honest_rows_are_there(rows: Rows) -> None:
    for scenario in ("motion", "white", "untrimmed", "warm_up"):
        claims = " / ".join(claim for name, _, claim in rows if name == scenario)
        assert "exactly as printed" in claims and "gyro alone, mean" in claims
        assert "known lag undone" in claims or scenario == "untrimmed"
    compared = {row.claim for row in rows.values() if row.scenario == "motion" and row.sense == "compared"}
    for honest in ("gyro alone, its known lag undone", "data layer exactly as printed"):
        assert {f"{honest}, mean", f"{honest}, max"} <= compared, "also in the short table"
    for row in rows.values():
        assert row.sense in figures.UNASKED or row.reference is not None or row.unit == "points"
        assert row.reference is None or row.reference == pytest.approx(row.reached, abs=0.05), row.claim


def test_the_printed_data_layer_is_no_better_than_the_compensated_gyro(rows: Rows) -> None:
    """Integrating the corrected rate forgets what the correction says about the angle."""
    printed = rows["motion", "printed", "as printed, known lag undone, mean"]
    undone = rows["motion", "-", "gyro alone, its known lag undone, mean"]
    assert printed.reached > undone.reached - 1.0


def test_a_wrong_belief_about_the_scale_is_worse_than_no_fusion_and_loose_angular_survives_it() -> None:
    """Set to 0.5 % where the angular accelerometer is 3 % wrong; with 3 %, about the gyro with its lag undone is
    left."""
    found = {
        (row.scenario, row.tuning): row.reached
        for row in turntable_figures.belief_rows(SEEDS)
        if row.claim.endswith("mean")
    }
    wrong = "motion, angular_scale=0.03"
    assert found[wrong, "data"] > 120.0, "worse than the gyro alone"
    assert found[wrong, "loose_angular"] < min(found[wrong, "-"] + 5.0, 100.0)
    assert found["motion, gyro_scale=0.03", "data"] < found["motion, gyro_scale=0.03", "-"] - 20.0


def test_rectangles_of_angular_acceleration_run_half_a_step_ahead() -> None:
    """Ramp of the rate without a gyro: both integrate to the same slope, the printed rule half a step earlier."""
    counts = np.full((600, 6), float(turntable.NO_SAMPLE))
    counts[:, 3:] = 0.0
    counts[300:, 3] = turntable.ANGULAR_LSB_PER_DPS2 * (np.arange(300) + 1.0)  # deg/s^2, rising by 1 a step
    tuning = turntable.with_fusion(turntable.DATA, rest_s=0.0, start_angular_dps2=0.0)
    trapezium = reference_turntable.run_control(tuning, counts)["rate_fused_dps_0"]
    rectangle = reference_turntable.run_control(tuning, counts, rule="rectangle")["rate_fused_dps_0"]
    ahead = rectangle[310:] - trapezium[310:]
    half_a_step = (np.arange(310, 600) - 299.0) * tuning.period_s / 2.0
    assert ahead == pytest.approx(half_a_step, rel=1e-6)


def test_the_headline_of_many_seeds_is_over_each_of_them_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks have at most TOGETHER seeds, so that a table over hundreds of seeds neither repeats nor multiplies them;
    the float64 reference takes as many at once, and gives the same."""
    short = turntable_figures.Batch(tuple(turntable.scenario("motion", seed, seconds=16.0) for seed in (1, 2, 3)))
    whole = short.float64("data")
    monkeypatch.setattr(turntable_figures, "TOGETHER", 2)
    monkeypatch.setattr(turntable_figures, "MANY", 1)
    parted = short.float64("data")
    assert parted.mean.tolist() == whole.mean.tolist() and parted.maximum.tolist() == whole.maximum.tolist()
    first, _, least, *_ = turntable_figures.many_rows([1000, 1001, 1002])
    assert first.claim == "data layer, seeds 1000-1002, mean" and least.claim.endswith("of 2 blocks of 2, mean")
    batch = turntable_figures.Batch.of("motion", range(1000, 1003))
    assert first.reached == pytest.approx(batch.integers("data").share_of(batch.gyro)[0], rel=1e-12)


def test_the_headline_is_over_ten_times_the_seeds_in_blocks() -> None:
    first, worst, *_ = many = list(turntable_figures.many_rows([1000]))
    assert first.claim == "data layer, seeds 1000-1009, mean" and worst.claim == "data layer, seeds 1000-1009, max"
    least, most = many[2], many[3]
    assert least.reached < first.reached < most.reached and least.sense == most.sense == "compared"
    whole = turntable_figures.Batch.of("motion", range(1000, 1010))
    assert first.reached == pytest.approx(whole.integers("data").share_of(whole.gyro)[0], rel=1e-12)
    assert turntable_figures.HEADLINE[0] == "data layer, seeds 1000-1399, mean", "of the 40 seeds of the other rows"
