"""The studies of examples/studies can be run, and the command of a run gives that run again."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from plumb.__main__ import main
from plumb.checkout import CHECKOUT

STUDIES = sorted((CHECKOUT / "examples" / "studies").glob("*.toml"))


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_the_largest_figure_is_repeated_by_its_command(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["campaign", str(path), "--runs", "6", "--seconds", "21", "--json"])
    said = json.loads(capsys.readouterr().out)
    assert code == bool(said.get("violations")), "1 where an invariant is violated"
    words = shlex.split(said["worst"]["angle_rmse_deg"])[1:]
    assert main([*words, "--json"]) == 0
    alone = json.loads(capsys.readouterr().out)["metrics"]["angle_rmse_deg"]
    assert (alone["max"] if isinstance(alone, dict) else alone) == said["metrics"]["angle_rmse_deg"]["max"]


def test_there_are_studies() -> None:
    assert len(STUDIES) >= 3
