"""The systems of examples/systems: outside the package, built for it, with vectors and tests of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.built_systems import Plumb, build

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "systems"
LIMIT_S = 600


@pytest.fixture(scope="module")
def plumb(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """A core and an image of these systems alone."""
    python, target = Path(sys.executable), tmp_path_factory.mktemp("examples")
    core, image = build(ROOT, target, python, "-DPLUMB_SYSTEMS=quadrotor", f"-DPLUMB_SYSTEM_PATH={FOLDER}")
    return Plumb(python, core, image, {"PLUMB_SYSTEM_PATH": str(FOLDER)})


def test_their_vectors_hold_on_the_native_core_and_on_the_flash_image(plumb: Plumb) -> None:
    vectors = FOLDER / "vectors"
    said = plumb("golden", "check", "--vectors", str(vectors), "--board", "native", "--board", "virtual").stdout
    assert said.splitlines()[-1] == "pass"


def test_a_flight_in_closed_loop_on_the_flash_image_is_the_model_bit_for_bit(plumb: Plumb) -> None:
    said = plumb("run", "quadrotor", "--board", "virtual", "--scenario", "lean", "--seconds", "8").stdout
    assert "every one of the 3200 steps equals the model" in said


def test_their_own_tests_pass(plumb: Plumb) -> None:
    environment = {**os.environ, "PLUMB_NATIVE_CORE": str(plumb.core), **plumb.environment}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-n0", "-q", "-p", "no:cacheprovider", "-c", os.devnull, "."],
        cwd=FOLDER / "tests", env=environment, capture_output=True, text=True, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
