"""Cycles over recordings: every step of the image's code counts, and mean and worst step are held to their budgets."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="the bench needs the emulator")

from plumb.__main__ import main
from plumb.bench.bench import find_image
from plumb.bench.recordings import Load, compared_systems, within_budget
from plumb.errors import UsageError
from plumb.spec import declarations

STEPS = 500


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    path = tmp_path / "still.npz"
    np.savez(
        path,
        gyr=0.01 * rng.standard_normal((STEPS, 3)),
        acc=np.array([0.0, 0.0, 9.81]) + 0.02 * rng.standard_normal((STEPS, 3)),
        ref_quat=np.tile([1.0, 0.0, 0.0, 0.0], (STEPS, 1)),
        movement=np.ones(STEPS, bool),
        rate_hz=np.float64(200.0),
    )
    return path


def test_every_step_of_a_recording_is_counted(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        find_image()
    except UsageError as missing:
        pytest.skip(str(missing))
    assert main(["bench", "--recording", str(recording), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["loads"]
    assert [one["system"] for one in found] == compared_systems()
    for one in found:
        assert one["steps"] == STEPS and one["recording"] == "still"
        # From below: no step of the systems compared has fewer than 300 instructions.
        assert 300 < one["cycles_mean"] < one["cycles_max"] <= (declarations.system(one["system"]).cycles or 0)


def test_a_mean_or_a_worst_step_over_its_budget_is_seen() -> None:
    for name in compared_systems():
        declared = declarations.system(name)
        assert declared.cycles and declared.cycles_mean
        good = Load(name, "a", declared.cycles_mean, declared.cycles, 100)
        assert within_budget([good])
        assert not within_budget([good, Load(name, "b", declared.cycles_mean + 1.0, declared.cycles, 100)])
        assert not within_budget([good, Load(name, "b", 1.0, declared.cycles + 1, 100)])


def test_a_recording_without_a_reference_is_refused_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bare.npz"
    np.savez(path, gyr=np.zeros((STEPS, 3)), acc=np.ones((STEPS, 3)), rate_hz=np.float64(100.0))
    assert main(["bench", "--recording", str(path)]) == 2
    assert "no reference" in capsys.readouterr().err
