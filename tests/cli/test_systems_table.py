"""The exit code of `plumb systems --table`: what is judged."""

from __future__ import annotations

import pytest

from plumb.__main__ import main
from plumb.proof import figures
from plumb.proof.figures import Figure, Sense


@pytest.mark.parametrize(
    ("sense", "seeds", "code"),
    [
        ("near", [], 1),
        ("near", ["--first-seed", "5000"], 0),
        ("near", ["--seeds", "3"], 0),
        ("at most", ["--seeds", "3"], 1),
    ],
)
def test_a_figure_of_the_scenario_is_judged_with_its_own_seeds_alone(
    sense: Sense, seeds: list[str], code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missed = Figure("accelerometer only", "rough", "-", "deg rms", sense, 1.0, 2.0)
    assert not missed.met
    monkeypatch.setattr(figures, "compute", lambda names, seeds: iter([(name, missed) for name in names]))
    assert main(["systems", "--table", *seeds]) == code
    assert "accelerometer only" in capsys.readouterr().out
