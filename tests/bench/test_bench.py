"""Every kernel of the shipped image is within its budget, and a budget that is exceeded is seen."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

pytest.importorskip("unicorn")
pytest.importorskip("capstone")
pytest.importorskip("elftools")

from plumb.bench import bench
from plumb.bench.bench import BenchResult, Row
from plumb.bench.instruction_counter import Image
from plumb.errors import UsageError
from support.campaigns import LONG
from support.once_per_run import once_per_run, run_folder

KERNEL_KEYS = {"instructions_max", "cycles_max", "cycles_mean", "cycles_2ws_max", "bytes", "stack", "max_err"}


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> BenchResult:
    try:
        return once_per_run(run_folder(tmp_path_factory), bench.find_image(), bench.measure)
    except UsageError as error:
        if "make image" in str(error):
            pytest.skip(str(error))
        raise


@pytest.mark.slow
@pytest.mark.parametrize("kernel", bench.BUDGETS)
def test_every_kernel_is_within_its_budget(measured: BenchResult, kernel: str) -> None:
    row, budget = measured.kernels[kernel], bench.BUDGETS[kernel]
    assert row.max_err <= budget.max_err
    assert row.instructions_max <= (budget.instructions or math.inf)
    assert row.cycles_mean <= (budget.cycles_mean or math.inf) and row.cycles_2ws_max < budget.cycles_2ws
    if budget.period_us is None and budget.cycles is None:
        assert row.cycles_2ws_max < 0.75 * bench.SHORTEST_PERIOD_CYCLES, "the rest is the link's and the interrupts'"
    assert row.cycles_max <= (budget.cycles or math.inf), measured.render()


@pytest.mark.slow
def test_the_check_of_memory_takes_the_time_of_the_crc_unit(measured: BenchResult) -> None:
    """A word every 4 cycles (RM0008 4.2), with 200 cycles for the rest."""
    elf = Image(bench.find_image())
    areas = ("guarded", "guarded_parameters")
    size = sum(elf.symbol(f"{area}_end").address - elf.symbol(f"{area}_start").address for area in areas)
    assert size < measured.kernels["board_memory_intact"].cycles_max < size + 200


def test_the_image_is_within_its_budget(measured: BenchResult) -> None:
    assert measured.image["flash"] <= measured.limits["flash"]
    assert measured.image["ram"] + measured.image["stack"] <= measured.limits["ram"]


@pytest.mark.parametrize("kernel", ["kalman_step", "pid_step", "atan2"])
def test_straight_line_kernels_take_the_same_instructions_for_every_input(measured: BenchResult, kernel: str) -> None:
    row = measured.kernels[kernel]
    assert row.instructions_min == row.instructions_max


def test_figures_are_plausible_from_below(measured: BenchResult) -> None:
    """A kernel that costs nothing, or is too exact to be true, was not measured."""
    for name, row in measured.kernels.items():
        assert row.cycles_max >= row.instructions_max >= 15, name
        assert row.cycles_2ws_max >= row.cycles_max, name
        assert row.bytes >= 40, name
        assert row.max_err > 1e-12 or bench.BUDGETS[name].max_err == 0.0, name
    step, parts = measured.kernels["control_step"], measured.kernels
    assert step.cycles_max > parts["kalman_step"].cycles_max + parts["pid_step"].cycles_max
    assert step.bytes > parts["kalman_step"].bytes


@pytest.mark.slow
def test_measuring_twice_gives_the_same_figures(measured: BenchResult) -> None:
    """With PLUMB_LONG=1 all of them, else two kernels."""
    if LONG:
        assert bench.measure().to_json() == measured.to_json()
        return
    elf = Image(bench.find_image())
    assert bench._digest(elf) == measured.kernels["digest_crc32"]
    assert bench._lockstep(elf) == measured.kernels["lockstep_step"]


def test_json_has_the_promised_keys(measured: BenchResult) -> None:
    data = measured.to_json()
    assert set(data) == {"kernels", "image"}
    assert set(data["kernels"]) >= {"kalman_step", "pid_step", "atan2", "asin", "control_step"}
    assert all(set(row) == KERNEL_KEYS for row in data["kernels"].values())
    assert set(data["image"]) == {"flash", "ram", "stack"}


GOOD = Row(100, 100, 10, 10, 20, 100, 40, 1e-9)
SIZES = {"flash": 1000, "ram": 1000, "stack": 100}
LIMITS = {"flash": 1000, "ram": 1100}


def result(**change: float) -> BenchResult:
    row = dataclasses.replace(GOOD, **change)  # type: ignore[arg-type]
    return BenchResult({"pid_step": row}, SIZES, LIMITS, {})


def test_a_budget_that_is_exceeded_is_seen() -> None:
    budget = bench.BUDGETS["pid_step"]
    assert budget.cycles is not None and result().within_budget
    assert not result(cycles_max=budget.cycles + 1).within_budget
    assert result(cycles_max=budget.cycles).within_budget
    assert "1 cycles over" in result(cycles_max=budget.cycles + 1).render()
    for error in (budget.max_err * 1.01, math.nan, math.inf):
        assert not result(max_err=error).within_budget
        assert "error over" in result(max_err=error).render()
    for key, size in SIZES.items():
        assert not dataclasses.replace(result(), image={**SIZES, key: size + 1}).within_budget


def test_a_step_without_a_budget_is_a_share_of_the_shortest_period() -> None:
    own = {"plausibility_step": dataclasses.replace(GOOD, cycles_2ws_max=9000, max_err=0.0)}
    assert "25 % of 500 us" in BenchResult(own, SIZES, LIMITS, {}).render()
    wrong = {"plausibility_step": dataclasses.replace(GOOD, max_err=1.0)}
    shown = BenchResult(wrong, SIZES, LIMITS, {})
    assert not shown.within_budget and "error over" in shown.render()


def test_a_budget_of_instructions_that_is_exceeded_is_seen() -> None:
    budget = bench.BUDGETS["lockstep_step"].instructions
    assert budget is not None
    for instructions, within in ((budget, True), (budget + 1, False)):
        row = dataclasses.replace(GOOD, instructions_max=instructions, max_err=0.0)
        shown = BenchResult({"lockstep_step": row}, SIZES, LIMITS, {})
        assert shown.within_budget is within
        assert ("1 instructions over" in shown.render()) is not within


def test_a_frame_in_flight_that_takes_too_long_is_seen() -> None:
    budget = bench.BUDGETS["live_frame"]
    mean = budget.cycles_mean
    assert mean is not None and budget.cycles_2ws == 54_000.0

    def shown(**figures: int) -> BenchResult:
        good = dataclasses.replace(GOOD, cycles_mean=mean, cycles_2ws_max=54_000, max_err=0.0)
        return BenchResult({"live_frame": dataclasses.replace(good, **figures)}, SIZES, LIMITS, {})

    assert shown().within_budget and f"in the mean of {mean}; 30 % of 2500 us" in shown().render()
    slow = shown(cycles_mean=mean + 1)
    assert not slow.within_budget and "1 cycles over in the mean" in slow.render()
    worst = shown(cycles_2ws_max=54_001)
    assert not worst.within_budget and "1 cycles over at two wait states" in worst.render()
    assert not shown(max_err=1).within_budget


def test_without_an_image_one_sentence_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="make image"):
        bench.measure(tmp_path / "none.elf")
