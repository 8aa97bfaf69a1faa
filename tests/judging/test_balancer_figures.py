"""`balancer` reaches its figures with the integers running: each one bounded from both sides, so that luck is noticed
too, and the source's own filter, which does not reach them, says by how much.

Seeds 1000-1039, which no tuning has seen: the first of them in `make test`, all in `make test-long`. Loops are closed
on some of them. `plumb systems --table` has them all.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb import __main__ as front
from plumb.judging.balancer import figures as balancer_figures
from plumb.judging.balancer.closed_loops import Float64, Integers, balance, settled_since
from plumb.judging.balancer.plots import TURN_DEG
from plumb.judging.balancer.rides import Batch
from plumb.proof import figures
from plumb.proof.figures import Figure
from plumb.systems.balancer import scenarios as balancer
from support.campaigns import LONG, campaign
from support.once_per_run import once_per_run, run_folder

Rows = dict[tuple[str, str, str], Figure]
PAGE = Path(__file__).parents[2] / "docs/systems/balancer.md"


def keyed(rows: Iterable[Figure]) -> Rows:
    """By claim (what stands before a comma or a bracket), scenario and tuning."""
    return {(re.split(r"[,(]", row.claim)[0].strip(), row.scenario, row.tuning): row for row in rows}


@pytest.fixture(scope="module")
def ridden(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    seeds = figures.SEEDS[: campaign(6, 40)]
    compared = balancer_figures.COMPARED if LONG else {}  # the tests of the source's filter are long
    rows = lambda: keyed(balancer_figures.open_rows(seeds, compared))  # noqa: E731
    return once_per_run(run_folder(tmp_path_factory), "balancer, open loop", rows)


@pytest.fixture(scope="module")
def rocked(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    seeds = figures.SEEDS[: campaign(10, 40)]
    rows = lambda: keyed(balancer_figures.rocked_rows(seeds))  # noqa: E731
    return once_per_run(run_folder(tmp_path_factory), "balancer, rocked", rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("claim", "scenario", "tuning", "lowest", "highest", "worst_seed"),
    [
        ("accelerometer only", "rough", "-", 5.55, 6.13, 6.2),
        ("accelerometer only", "smooth", "-", 1.47, 1.62, 1.8),
        ("tilt error", "rough", "tuned", 0.30, 0.48, 0.55),
        ("tilt error", "smooth", "tuned", 0.15, 0.40, 0.48),
        ("corrected rate", "rough", "tuned", 0.38, 0.42, 0.42),
        ("corrected rate", "smooth", "tuned", 0.38, 0.42, 0.42),
    ],
)
def test_figures_are_reached(
    ridden: Rows, claim: str, scenario: str, tuning: str, lowest: float, highest: float, worst_seed: float
) -> None:
    row = ridden[claim, scenario, tuning]
    assert row.sense in ("at most", "near") and row.met and lowest < row.reached <= highest
    assert row.worst is not None and row.reached < row.worst < worst_seed
    if row.reference is not None:
        assert row.reached == pytest.approx(row.reference, abs=1e-4), "the integers cost nothing"


@pytest.mark.parametrize(("scenario", "below", "most"), [("rough", 92.0, 95.0), ("smooth", 74.0, 90.0)])
def test_so_much_of_the_accelerometers_error_is_gone(ridden: Rows, scenario: str, below: float, most: float) -> None:
    row = ridden["below accelerometer only", scenario, "tuned"]
    assert row.sense == "at least" and row.reach == below and row.met and row.reached < most


@pytest.mark.long
@pytest.mark.parametrize(("scenario", "asked_deg"), [("rough", 0.48), ("smooth", 0.40)])
def test_the_sources_filter_is_listed_and_falls_short(ridden: Rows, scenario: str, asked_deg: float) -> None:
    """With nothing taken off the figure is missed by a little with constants of its own, by more with the paper's rule;
    with the axle's acceleration taken off the very same constants come nearer."""
    own = ridden["tilt error", scenario, "tuned"].reached
    fitted, same, rule = (ridden["tilt error", scenario, name] for name in ("arctan_fitted", "arctan", "paper_rule"))
    assert {row.sense for row in (fitted, same, rule)} == {"compared"} and {row.reach for row in (same, rule)} == {0.0}
    wheel = ridden["tilt error", scenario, "paper_rule_wheel"]
    assert wheel.sense == "compared" and own < wheel.reached < rule.reached, "its runs scatter: shown, and not judged"
    # 1.27 and 1.29 times what is asked, over seeds 1000 to 1039; beyond 1.4 it would be another filter.
    assert own < asked_deg < fitted.reached < same.reached < rule.reached < 1.4 * asked_deg
    assert ridden["corrected rate", scenario, "arctan"].sense == "shown"


@pytest.mark.slow
def test_the_comparison_is_a_fair_one() -> None:
    """On seeds 0-19 neither more nor less R or Q of the bias is better for the arctangent alone."""
    from dataclasses import replace

    from plumb.boards.native import core as native_core
    from plumb.contract.parameters import quantise

    batches = [Batch.of(name, range(0, 20, 2)) for name in ("rough", "smooth")]

    def cost(r: float, q: float) -> float:
        tuning = balancer.TUNINGS["arctan_fitted"]
        tuning = replace(
            tuning,
            trust=replace(tuning.trust, r_deg2=tuning.trust.r_deg2 * r),
            kalman=replace(tuning.kalman, q_bias_dps2_per_s=tuning.kalman.q_bias_dps2_per_s * q),
        )
        params, sums = quantise(tuning), 0.0
        for batch, asked_deg in zip(batches, (0.48, 0.40), strict=True):
            words = native_core.run_control(params, batch.raw, batch.setpoint)
            tilt_deg = np.asarray(words["tilt_turn_q32"] * TURN_DEG)
            sums += float(np.mean(batch.tilt_rms(tilt_deg))) / asked_deg
        return sums

    best = cost(1.0, 1.0)
    assert all(best < cost(*factors) for factors in ((2.0, 1.0), (0.5, 1.0), (1.0, 2.0), (1.0, 0.5)))


@pytest.mark.long
def test_what_the_raw_rate_is_expected_to_be(ridden: Rows) -> None:
    """The closed form is the scenario's: 400 drawn biases agree; these 40 seeds drew small ones, within 2.5 sigma."""
    mean, scatter = balancer_figures.expected_raw_dps()
    drawn = []
    for seed in range(400):
        run = balancer.scenario("rough", seed)
        drawn.append(np.sqrt(np.mean(run.bias_dps[run.scored] ** 2) + balancer.GYRO_NOISE_DPS**2))
    assert np.mean(drawn) == pytest.approx(mean, abs=3.0 * scatter / np.sqrt(400))
    assert np.std(drawn) == pytest.approx(scatter, rel=0.1)
    row = ridden["raw rate", "rough", "-"]
    assert row.met and row.reached == mean and row.reach == 1.7
    for scenario in ("rough", "smooth"):
        these = ridden["raw rate of these seeds", scenario, "-"]
        assert these.sense == "compared" and abs(these.reached - mean) < 2.5 * scatter / np.sqrt(40)
        corrected = ridden["corrected rate", scenario, "tuned"]
        # 0.38 of 1.4 deg/s: the noise of 0.38 deg/s is left, the bias is gone.
        assert corrected.gyro_only == these.reached and corrected.reached < 0.3 * these.reached


@pytest.mark.parametrize("tuning", ["tuned", "paper_rule"])
def test_noise_of_10_deg_before_the_filter_is_below_1_5_after_it(rocked: Rows, tuning: str) -> None:
    before, after = rocked["before the filter", "rocked", "-"], rocked["after the filter", "rocked", tuning]
    assert before.source == "+-10 deg" and 9.0 < before.reached < 13.0, "or it is another experiment"
    assert after.source == "+-5 deg" and after.reach == 5.0 and after.met
    # 1.1 deg is reached, the paper claims 5; below 0.5 its noise of 10 deg would be missing.
    assert after.worst is not None and 0.5 < after.reached < after.worst < 1.5


@pytest.mark.long
def test_the_closed_loop_stays_up_and_float64_is_no_better() -> None:
    rows = keyed(balancer_figures.closed_rows(range(1000, 1004)))
    for scenario, lowest in (("rough", 0.25), ("smooth", 0.12)):
        error, leaned = (
            rows[claim, scenario, "tuned"] for claim in ("closed loop", "stays up: largest tilt of any run")
        )
        assert error.met and lowest < error.reached and error.reference is not None
        # The same noise, other rounding: the loop amplifies it until a push hides it.
        assert error.reached == pytest.approx(error.reference, rel=0.05)
        # The speed loop asks for a lean of 8 deg at most, the largest push adds 2; twice that is allowed.
        assert leaned.met and 3.0 < leaned.reached < 12.0 and leaned.reference == pytest.approx(leaned.reached, rel=0.1)
        follows, settled = (
            rows[claim, scenario, "tuned"] for claim in ("velocity asked for minus velocity", "the same")
        )
        # Half of the largest command, 0.6 m/s: above it the vehicle would not follow.
        assert follows.sense == settled.sense == "shown" and settled.reached < follows.reached < 0.3
    assert {row.reach for row in rows.values() if row.sense != "shown"} == {0.55, 0.48, 20.0}


@pytest.mark.long
def test_ten_minutes_under_pushes() -> None:
    rows = keyed(balancer_figures.endured_rows([1000]))
    error, leaned = rows["ten minutes", "endure", "tuned"], rows["stays up: largest tilt of any run", "endure", "tuned"]
    # with a fifth of this vibration, on `smooth`, 0.2 deg are left: or it is another ride
    assert error.met and error.reached > 0.2 and error.reach == 0.55
    assert leaned.met and 5.0 < leaned.reached < 12.0, "the commands alone make it lean so far"
    assert balancer.SECONDS["endure"] == 600.0


def test_a_vehicle_that_falls_is_noticed() -> None:
    """Driven the wrong way round it lies; the same plant, driven right, follows its command."""
    from dataclasses import replace

    wrong = replace(balancer.TUNED, drive=replace(balancer.TUNED.drive, span=-balancer.TUNED.drive.span))
    # It lies at 85 deg, and stays there.
    assert balance(Integers(wrong), "rough", 1000, 8.0).tilt_max_deg > 80.0
    for controller in (Integers(balancer.TUNED), Float64(balancer.TUNED)):
        run = balance(controller, "rough", 1000, 40.0)
        # 8 deg is the largest lean that is asked for; 3.3 are seen, and 0.11 m/s of a command of up to 0.6.
        assert run.tilt_max_deg < 10.0 and 0.01 < run.velocity_rms_mps < 0.25


def test_a_command_counts_as_settled_5_s_behind_it() -> None:
    setpoint, time_s = np.repeat([0, 3, 3, 1], 100), 0.1 * np.arange(400, dtype=np.float64)
    settled = settled_since(setpoint, time_s)
    assert settled[:100].all(), "before the first command there is nothing to wait for"
    assert settled.tolist() == [not (100 <= k < 150 or 300 <= k < 350) for k in range(400)]


def test_the_vehicle_follows_its_command_better_once_it_is_settled() -> None:
    run = balance(Integers(balancer.TUNED), "rough", 1000, 40.0)
    # 0.11 m/s is seen of commands of up to 0.6; above 0.25 it would not follow.
    assert 0.01 < run.settled_rms_mps < run.velocity_rms_mps < 0.25


def test_a_push_tips_it_and_it_comes_back() -> None:
    """The largest of the prescribed pushes: 6 m/s^2 for 0.15 s, before there is any command."""
    from plumb.boards.native.board import NativeBoard
    from plumb.contract.parameters import quantise
    from plumb.physics.sensors import Push
    from plumb.proof import runs

    tilt = {}
    for size in (0.0, 6.0, -6.0):
        run = balancer.scenario("smooth", 1000, seconds=8.0, faults=(Push(size, 5.0, 5.15),))
        inputs = runs.closed_loop(NativeBoard(), run, quantise(balancer.TUNED)).inputs
        tilt[size] = inputs.truth["tilt_deg"]
    pushed = slice(500, 540)
    # A push of 6 m/s^2 is 12 rad/s^2 for 0.15 s: 7.7 deg were nothing done against it; 1.9 and 2.2 are seen.
    assert 1.0 < np.max(tilt[6.0][pushed] - tilt[0.0][pushed]) < 5.0
    assert 1.0 < np.max(tilt[0.0][pushed] - tilt[-6.0][pushed]) < 5.0
    # Back to the noise of the balance: 0.8 deg at most are seen 2.4 s later.
    assert np.max(np.abs(tilt[6.0][-50:])) < 1.5 and np.max(np.abs(tilt[-6.0][-50:])) < 1.5


def test_every_section_is_in_the_table() -> None:
    assert list(balancer_figures.SECTIONS) == ["open loop", "blended", "rocked", "closed loop", "ten minutes", "loops"]


@pytest.mark.slow
@pytest.mark.parametrize("link", [pytest.param("serial", marks=pytest.mark.long), "can"])
def test_the_flash_image_stays_up(link: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Of the ten minutes of docs/systems/balancer.md the first 25 s: commands and pushes, the plant on the host."""
    pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
    command = ["run", "balancer", "--board", "virtual", "--link", link, "--scenario", "endure", "--seconds", "25"]
    assert front.main([*command, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    found = summary["metrics"]
    assert summary["verdict"] == "pass" and summary["steps"] == 2500 and summary["loop"] == "closed"
    assert found["target_vs_fixed_mismatches"] == 0 and found["fallen_steps"] == 0
    # 8 deg of lean and twice the 2 of a push; 0.55 deg is what is asked of the closed loop.
    assert 1.0 < found["tilt_max_deg"] < 12.0 and found["angle_rmse_deg"] < 0.55


@pytest.mark.long
def test_the_page_shows_the_figures(ridden: Rows) -> None:
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| ([\d.]+) \| ([\d.]+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {row[0] for row in rows} == set(balancer.TUNINGS)
    for tuning, rough, smooth in rows:
        for scenario, documented in (("rough", rough), ("smooth", smooth)):
            assert documented == f"{ridden['tilt error', scenario, tuning].reached:.3f}", (tuning, scenario)


@pytest.mark.slow
def test_the_complementary_filter_falls_short_of_the_kalman_filter() -> None:
    """At its best constants, and with the same measured tilt."""
    for row in balancer_figures.blended_rows(range(1000, 1004)):
        batch = Batch.of(row.scenario, range(1000, 1004))
        tilt, _ = balancer_figures._estimate(batch, "tuned", "tilt error", "shown", 0.0)
        # 0.53 of it in both scenarios; half the error is the claim, with the scatter of four seeds.
        assert tilt.reached < 0.7 * row.reached < 0.7


@pytest.mark.parametrize("road", ["rough", "smooth"])
def test_the_shipped_filter_states_how_far_its_error_spreads_on_both_roads(road: str) -> None:
    """Spread about the mean by stated sigma, mean over 40 seeds: R of 33 deg^2 gives 0.33 on smooth."""
    spread = plumb.runs("balancer", scenario=road, open_loop=True, runs=40, first_seed=1000).table()["spread_per_sigma"]
    assert 0.5 < np.mean(spread) < 1.4
