"""The golden vectors notice a core that is wrong: mutants of the code that a step runs, each a small change of the C.

Here a sample of them. `make test-long` tries 300 by tools/measure_mutants.py, which gives those that the vectors let
pass to the tests of kernels and systems, too.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from plumb.proof import golden
from support.mutant_judges import Prepared, killer, other_killers
from support.mutants import FIRMWARE, Mutant, Workshop, mutants

ROOT = Path(__file__).resolve().parents[2]
SEED, SAMPLE = 1, 12
DEFECTS = {
    "bias bound": ("core/kalman.h", "-(1 << 26), (1 << 26) - 1)", "-(1 << 26), (1 << 26))"),
    "p11 bound": ("core/kalman.h", "0, (1 << 24) - 1)", "-1, (1 << 24) - 1)"),
    "free fall": ("systems/attitude_block.c", "lever < asr32(time_q32, 2) ?", "false ?"),
    "a fall turns nothing": ("systems/attitude_turns.c", "if (half < least)", "if (false)"),
    "wheel clamp flag": ("core/wheel.h", "return used != edges || ", "return "),
    "wheel acceleration flag": ("core/wheel.h", " || limited_q24 != accel_q24", ""),
    "limit of growth": ("core/error_filter.c", "*variance < VARIANCE", "*variance <= VARIANCE"),
    "variance limit of the fusion": ("core/fusion.c", "(int64_t)1 << 58)", "(int64_t)1 << 57)"),
    "half the angle's limit in the fusion": ("core/fusion.c", "(int64_t)1 << 61)", "(int64_t)1 << 60)"),
    "twice the angle's limit in the fusion": ("core/fusion.c", "(int64_t)1 << 61)", "(int64_t)1 << 62)"),
    "first entry of the roots": ("core/angle.c", "0xfffd03e9U", "0xfffc03e9U"),
    "last entry of the roots": ("core/angle.c", "0x80810081U", "0x80800081U"),
}  # fmt: skip
"""One change each, at places that vectors have missed before: file, what stands there, what takes its place."""


@cache
def vectors() -> list[Prepared]:
    return Prepared.all(golden.load(ROOT / "tests/vectors"))


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    """A workshop whose unchanged library passes."""
    made = Workshop(tmp_path_factory.mktemp("mutants"))
    baseline = made.library()
    assert baseline is not None and killer(baseline, vectors()) is None, "the core itself differs from the vectors"
    yield made


def defect(name: str) -> Mutant:
    file, old, new = DEFECTS[name]
    lines = (FIRMWARE / file).read_text(encoding="utf-8").split("\n")
    places = [(number, line.index(old)) for number, line in enumerate(lines, 1) if old in line]
    assert len(places) == 1, f"{old} stands {len(places)} times in {file}"
    return Mutant(file, *places[0], old, new)


@pytest.mark.parametrize("name", DEFECTS)
def test_a_defect_is_noticed(workshop: Workshop, name: str) -> None:
    library = workshop.library(defect(name), name.replace(" ", "_"))
    assert library is not None
    assert killer(library, vectors()) is not None


def test_a_sample_of_mutants_is_killed(workshop: Workshop) -> None:
    sample = mutants()
    random.Random(SEED).shuffle(sample)
    libraries = [workshop.library(mutant, f"mutant_{number}") for number, mutant in enumerate(sample[:SAMPLE])]
    killed = [killer(library, vectors()) is not None for library in libraries if library is not None]
    # 258 of 300 are killed (docs/explanation/design.md); of twelve then fewer than half once in 2,000 samples, which
    # every change of the core draws anew.
    assert sum(killed) >= 0.5 * len(killed), "more of them pass than are equal to the core or nearly so"


def test_another_test_that_kills_is_named(workshop: Workshop, tmp_path: Path) -> None:
    """The second is the core itself, built once more: nothing notices it."""
    wrong, same = workshop.library(defect("first entry of the roots"), "wrong_roots"), workshop.library()
    assert wrong is not None and same is not None
    test = "tests/kernels/test_angle.py::test_both_hands_agree_on_sine_cosine_and_length"
    assert other_killers([wrong, same], tmp_path / "report.txt", [test]) == {wrong: test, same: None}
