"""`quad` reaches its figures with the integers running: each one bounded from both sides, so that luck is noticed too.

Seeds 1000-1039, which no tuning has seen: the first of them in `make test`, all in `make test-long`. The upper bound is
the figure to reach; the lower one is what these scenarios allow at best, so that a scenario which became easier by
accident fails as well.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from plumb.contract import run_reference
from plumb.judging.quad import figures as quad_figures
from plumb.proof import figures
from plumb.proof.figures import Figure, Sense
from plumb.systems.quad import scenarios as quad
from support.campaigns import campaign
from support.once_per_run import once_per_run, run_folder

Rows = dict[tuple[str, str, str], Figure]


@pytest.fixture(scope="module")
def estimator(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    rows = lambda: keyed(quad_figures.estimator_rows(figures.SEEDS[: campaign(10, 40)]))  # noqa: E731
    return once_per_run(run_folder(tmp_path_factory), "quad, estimator", rows)


@pytest.fixture(scope="module")
def convergence() -> Rows:
    return keyed(quad_figures.convergence_rows(figures.SEEDS))


@pytest.fixture(scope="module")
def hold(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Figure]:
    """By claim."""
    rows = lambda: {row.claim: row for row in quad_figures.hold_rows(figures.SEEDS[: campaign(3, 40)])}  # noqa: E731
    return once_per_run(run_folder(tmp_path_factory), "quad, hold", rows)


def keyed(rows: object) -> Rows:
    return {(row.scenario, row.tuning, row.unit): row for row in rows}  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "lowest", "highest", "worst_seed"),
    [
        (("motion", "-", "deg rms"), 2.28, 2.52, 3.0),
        (("motion", "paper", "deg rms"), 1.78, 1.96, 2.2),
        (("motion", "adaptive", "deg rms"), 0.44, 0.60, 0.90),
        (("quiet", "adaptive", "deg rms"), 0.30, 0.40, 0.70),
        (("motion", "trapezium", "deg rms"), 0.36, 0.47, 0.80),
        (("quiet", "trapezium", "deg rms"), 0.18, 0.30, 0.60),
        (("quiet", "quiet", "deg rms"), 0.20, 0.33, 0.60),
    ],
)
def test_tilt_errors(
    estimator: Rows, key: tuple[str, str, str], lowest: float, highest: float, worst_seed: float
) -> None:
    row = estimator[key]
    assert lowest < row.reached <= highest and row.met
    assert row.worst is not None and row.reached < row.worst < worst_seed
    if row.reference is not None:
        assert row.reached == pytest.approx(row.reference, abs=1e-5), "the integers cost nothing"


@pytest.mark.parametrize("tuning", ["paper_arcsine", "trapezium"])
def test_the_filter_alone_is_that_of_the_whole_reference(tuning: str) -> None:
    """A figure that needs no controller leaves it out: the same floats, in every bit."""
    batch, settings = quad_figures.Batch.of("converge", range(1000, 1003)), quad.TUNINGS[tuning]
    alone, whole = quad_figures.float64(settings, batch.raw), run_reference.run_control(settings, batch.raw)
    assert np.array_equal(alone.tilt_deg, whole["tilt_deg"]) and np.array_equal(alone.bias_dps, whole["bias_dps"])


def test_the_filter_takes_75_percent_off_the_accelerometers_error(estimator: Rows) -> None:
    row = estimator[("motion", "trapezium", "%")]
    # 75 % is asked, 81 is reached; 86 would be 0.34 deg on this motion, less than any tuning gets.
    assert row.met and 80.0 <= row.reached < 86.0


def test_r_that_adapts_beats_the_best_constant_r(estimator: Rows) -> None:
    """0.7 to 0.97 deg is what a constant R gives; the source's arcsine of one axis does worse than both axes."""
    constant, adaptive = estimator[("motion", "constant", "deg rms")], estimator[("motion", "adaptive", "deg rms")]
    # Adaptive: 0.73 of the best constant R on these seeds; the gain is what the variance is measured for.
    assert 0.68 < constant.reached < 0.97 and adaptive.reached < 0.75 * constant.reached
    assert estimator[("motion", "paper_arcsine", "deg rms")].reached > estimator[("motion", "paper", "deg rms")].reached


def test_one_tuning_gives_the_motion_and_the_quiet_figure(estimator: Rows) -> None:
    assert {key[1] for key, row in estimator.items() if row.reach in (0.60, 0.40, 75.0)} == {"adaptive", "trapezium"}
    for tuning in ("adaptive", "trapezium"):
        trust = quad.TUNINGS[tuning].trust
        assert trust.r_max_deg2 / trust.r_deg2 == pytest.approx(1000.0), "R adapts over 1000:1"


def test_the_mean_of_two_samples_is_better_on_both_scenarios(estimator: Rows) -> None:
    """On `quiet` constants for it alone are a little ahead, and far behind on `motion`; with the printed U, half a
    period late, `adaptive` is behind on both."""
    reached = {key[:2]: row.reached for key, row in estimator.items() if key[2] == "deg rms"}
    fitted, shipped = reached["quiet", "quiet_fitted"], reached["quiet", "trapezium"]
    # 2 % behind the fitted set, and 0.68 of `adaptive`.
    assert fitted < shipped < 1.1 * fitted and shipped < 0.75 * reached["quiet", "adaptive"]
    # 0.87: half a period of lag is 0.3 deg of the fastest swing, and adds as a square.
    assert reached["motion", "trapezium"] < 0.9 * reached["motion", "adaptive"]
    # 3.3 times: without trust in |a| the bursts of 0.3 g, 17 deg each, come through.
    assert reached["motion", "quiet_fitted"] > 3.0 * reached["motion", "trapezium"]


def test_the_shipped_tuning_states_its_own_error(estimator: Rows) -> None:
    """The spread about the mean of a run is 0.5 to 1.4 times the filter's own sigma; the mean is the accelerometer's
    offset, which no filter sees."""
    least, most = quad_figures.CONSISTENT
    for scenario in ("motion", "quiet"):
        row = estimator[scenario, "trapezium", "times"]
        assert least <= row.reached <= most and row.reach == most
        assert row.low is not None and row.high is not None and row.low < row.reached < row.high
    # 5.4 times: the lag of half a period is not in its sigma.
    assert estimator["motion", "adaptive", "times"].reached > 3.0
    assert estimator["quiet", "trapezium", "deg"].reached == pytest.approx(
        np.degrees(quad.OFFSET_G) * np.sqrt(2.0 / np.pi), rel=0.6
    )


@pytest.mark.slow
def test_the_simple_filters_fall_short_of_the_kalman_filter(estimator: Rows) -> None:
    """At their best constants, on seeds that these were not fitted on; a weighted average keeps the drift."""
    simple = {(row.scenario, row.claim.split()[0]): row for row in quad_figures.blended_rows(range(1000, 1008))}
    for scenario, kalman in (("motion", "trapezium"), ("quiet", "trapezium")):
        complementary, average = simple[scenario, "complementary"], simple[scenario, "weighted"]
        assert estimator[scenario, kalman, "deg rms"].reached < complementary.reached < average.reached
        assert average.accel_only is not None and average.reached == pytest.approx(average.accel_only, rel=0.05)
        assert complementary.sense == "shown" and complementary.reference == complementary.reached


def test_the_bias_converges_within_half_a_second(convergence: Rows) -> None:
    paper = convergence[("converge", "paper", "s, median")]
    assert paper.reached == pytest.approx(1.5, rel=0.05), "the source's own figure, or the scenario is another"
    for tuning in ("adaptive", "trapezium", "fast_start"):
        row = convergence[("converge", tuning, "s, median")]
        # 0.5 s is asked of the median; a single seed of 40 may take three times as long (1.0 s is seen).
        assert row.met and 0.3 < row.reached <= 0.5 and row.worst is not None and row.worst < 1.5
    after = convergence[("converge", "trapezium", "deg max")]
    # 2 deg is asked; the noise of 0.5 deg through the gain of the start is more than 0.1.
    assert after.met and 0.1 < after.reached <= 2.0


@pytest.mark.slow
def test_the_loop_recovers_and_holds(hold: dict[str, Figure]) -> None:
    """The means have their requirements: 2 s and 1 deg rms. The worst seed has more room.

    4 s: the band of 2 deg is twice the rms that is allowed, so one further excursion is no fault; it begins the dwell
    of 1 s anew, and takes about as long to come back. 1.3 deg: the square of the tilt is correlated for 0.39 s (mean of
    seeds 1000 to 1005), so that the rms of 17.4 s has a standard deviation of sqrt(2 * 0.39 / 17.4) / 2, 10.6 %; the
    bound is 1 deg and three of these. 0.9 s and 0.5 deg below: half of what these seeds give, or nothing was disturbed.
    """
    recovery, rms = hold["20 deg disturbance, back within 2 deg"], hold["holds, from 2 s after"]
    assert recovery.met and recovery.reached > 0.9 and recovery.worst is not None and recovery.worst <= 4.0
    assert rms.met and rms.reached > 0.5 and rms.worst is not None and rms.worst <= 1.3


@pytest.mark.slow
def test_the_loop_survives_20_ms_of_further_delay(hold: dict[str, Figure]) -> None:
    """No limit cycle: the axis stays about as level as without the delay."""
    late = hold["holds with 20 ms of further delay"]
    assert late.met and late.reached == pytest.approx(hold["holds, from 2 s after"].reached, rel=0.15)
    largest = hold["largest tilt with 20 ms of further delay"]
    assert largest.met and largest.worst is not None and largest.worst < quad_figures.LATE_MAX_DEG


@pytest.mark.long
def test_float64_in_the_loop_does_no_better(hold: dict[str, Figure]) -> None:
    for claim in ("20 deg disturbance, back within 2 deg", "holds, from 2 s after"):
        row = hold[claim]
        # Both loops see the same noise: what differs is rounding, amplified by the loop for a while.
        assert row.reached == pytest.approx(row.reference, rel=0.02)


@pytest.mark.slow
def test_less_bandwidth_is_less_noise_and_more_lag() -> None:
    """5, 20, 50 and 350 Hz: the accelerometer alone gets worse with every wider low-pass, the filter hardly minds."""
    rows = list(quad_figures.bandwidth_rows(range(1000, 1010)))
    assert [row.claim.split()[1] for row in rows] == ["5", "20", "50", "350"]
    alone = [row.accel_only for row in rows]
    assert None not in alone and alone == sorted(alone)  # type: ignore[type-var]
    # 0.5 deg, to a fifth, while the bandwidth changes by 70.
    assert all(0.44 < row.reached <= 0.60 for row in rows)
    narrowest, *wider = (row.reached for row in rows)
    assert narrowest > min(wider), "lag costs more than the noise that it keeps out"


def test_a_missed_figure_is_printed_as_missed() -> None:
    rows = [
        Figure("too much", "motion", "adaptive", "deg rms", "at most", 0.60, 0.61),
        Figure("too little", "motion", "adaptive", "%", "at least", 75.0, 74.0),
        Figure("elsewhere", "motion", "paper", "deg rms", "near", 1.87, 1.97),
        Figure("good", "motion", "paper", "deg rms", "near", 1.87, 1.95, 2.0, 1.95, 2.4, 71.0),
        Figure("not about", "motion", "paper", "%", "about", 20.0, 17.3),
        Figure("about", "motion", "paper", "%", "about", 20.0, 17.5),
        Figure("compared", "motion", "paper", "deg rms", "shown", 0.0, 7.5, source="+-5 deg"),
    ]
    named = [("quad", row) for row in rows]
    lines = figures.render(named).splitlines()
    verdicts = [line.split()[-1] for line in lines[1 : len(rows) + 1]]
    missed = ["MISSED", "MISSED", "MISSED", "met", "MISSED", "met"]
    assert verdicts == [*missed, "7.500"], "what is only shown has no verdict"
    assert "+-5 deg" in lines[7] and "source" in lines[0]
    behind = lines[len(rows) + 2 :]
    assert any(line.startswith("Assumed: gyro noise 0.5 deg/s") for line in behind), "no figure without its assumptions"
    assert [line.startswith(figures.RED) for line in figures.render(named, colour=True).splitlines()[1:7]] == [
        True, True, True, False, True, False,
    ]  # fmt: skip
    assert [row.to_json()["met"] for row in rows] == [False, False, False, True, False, True, True]


@pytest.mark.parametrize("sense", ["at most", "at least", "near", "about"])
def test_a_figure_that_numpy_computed_goes_into_json(sense: Sense) -> None:
    row = Figure("a", "motion", "paper", "deg", sense, 1.0, np.float64(1.0), np.float64(2.0))
    assert json.loads(json.dumps(row.to_json()))["met"] is True


def test_a_short_table_keeps_targets_and_compared_rows() -> None:
    senses: tuple[Sense, ...] = ("at most", "at least", "near", "about", "compared", "shown")
    rows = [("quad", Figure(f"row {sense}", "motion", "paper", "deg rms", sense, 1.0, 1.0)) for sense in senses]
    whole, short = (figures.render(rows, short=short).splitlines() for short in (False, True))
    assert [line[:14] for line in whole if line not in short] == ["row shown     "]
    assert "row compared" in short[5] and not short[5].endswith("met"), "no verdict without a target"
