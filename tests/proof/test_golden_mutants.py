"""The golden vectors notice a core that is wrong: mutants of the code that a step runs, each a small change of the C.

A sample in every run of the tests; in `make test-long` 300 of them, and for those that the vectors let pass the tests
of kernels and systems: what these notice and the vectors do not is at most 2 % of what anything notices.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb.boards.native_core import CORE_VARIABLE
from plumb.proof import golden
from support.campaigns import LONG, campaign
from support.mutant_judges import Prepared, killer
from support.mutants import FIRMWARE, Mutant, Workshop, mutants

ROOT = Path(__file__).resolve().parents[2]
SEED = 2026
OTHERS = [
    "tests/kernels",
    *(f"tests/systems/test_{name}_core.py" for name in ("attitude", "balancer", "phone", "turntable")),
]
"""Tests of the native core with inputs of their own."""
VECTORS = Prepared.all(golden.load(ROOT / "tests/vectors"))
DEFECTS = {
    "bias bound": ("core/kalman.h", "-(1 << 26), (1 << 26) - 1)", "-(1 << 26), (1 << 26))"),
    "p11 bound": ("core/kalman.h", "0, (1 << 24) - 1)", "-1, (1 << 24) - 1)"),
    "free fall": ("systems/attitude.c", "lever < asr32(time_q32, 2) ?", "false ?"),
    "a fall turns nothing": ("systems/attitude.c", "if (half < least)", "if (false)"),
    "wheel clamp flag": ("core/wheel.h", "return used != edges || ", "return "),
    "wheel acceleration flag": ("core/wheel.h", " || limited_q24 != accel_q24", ""),
    "variance limit of the fusion": ("core/fusion.c", "(int64_t)1 << 58)", "(int64_t)1 << 57)"),
    "first entry of the roots": ("core/angle.c", "0xfffd03e9U", "0xfffc03e9U"),
    "last entry of the roots": ("core/angle.c", "0x80810081U", "0x80800081U"),
}  # fmt: skip
"""One change each, at places that vectors have missed before: file, what stands there, what takes its place."""


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    """A workshop whose unchanged library passes."""
    made = Workshop(tmp_path_factory.mktemp("mutants"))
    baseline = made.library()
    assert baseline is not None and killer(baseline, VECTORS) is None, "the core itself differs from the vectors"
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
    assert killer(library, VECTORS) is not None


def test_what_the_vectors_miss_is_at_most_2_percent(workshop: Workshop) -> None:
    sample = mutants()
    random.Random(SEED).shuffle(sample)
    killed, passed = 0, []
    for number, mutant in enumerate(sample[: campaign(12, 300)]):
        library = workshop.library(mutant, f"mutant_{number}")
        if library is None:
            continue
        if killer(library, VECTORS):
            killed += 1
        else:
            passed.append((mutant, library))
    missed = [str(mutant) for mutant, library in passed if LONG and others_notice(library)]
    print(f"{killed} killed, {len(passed)} pass the vectors, of which other tests notice {len(missed)}: {missed}")
    assert killed >= 0.7 * (killed + len(passed)), "more of them pass than are equal to the core or nearly so"
    assert len(missed) <= 0.02 * (killed + len(missed)), missed


def others_notice(library: Path) -> bool:
    """Whether the tests of kernels and systems fail with this library, and not for want of it."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", *OTHERS]
    environment = {**os.environ, CORE_VARIABLE: str(library), "PLUMB_LONG": ""}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode in (0, 1), done.stdout[-2000:] + done.stderr[-2000:]
    return done.returncode == 1
