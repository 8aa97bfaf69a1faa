"""The golden vectors take every branch of the core, but for those that a list gives with their reasons."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from plumb.contract import run_fixed
from plumb.proof import golden
from plumb.spec import declarations
from support.core_coverage import lacking, unreached

HERE = Path(__file__).parent
FOLDER = HERE.parent / "vectors"
NO_STEP = ("core/commutation.c", "core/digest.c", "core/takeoff.c", "generated/", "ports/")
"""The port's motor, the digest that judges, what is asked before a takeoff (tests/systems/test_takeoff.py), and the
callers of the core."""


@pytest.mark.slow
@pytest.mark.skipif(bool(lacking()), reason=f"{lacking()}: tools/setup.sh test")
def test_every_branch_is_taken_or_has_a_reason(tmp_path: Path) -> None:
    listed = tomllib.loads((HERE / "golden_unreached.toml").read_text(encoding="utf-8"))["branch"]
    assert all(row["reason"].startswith(("cannot: ", "not found: ")) for row in listed)
    found = {
        (one.file, one.condition, one.outcome)
        for one in unreached(tmp_path, FOLDER)
        if not one.file.startswith(NO_STEP)
    }
    assert found == {(row["file"], row["condition"], row["outcome"]) for row in listed}


@pytest.mark.parametrize("system", declarations.names())
def test_every_flag_is_set_and_clear(system: str) -> None:
    ever = never = 0
    for vector in golden.load(FOLDER, [system]):
        if vector.task is None and len(vector.raw) <= 1600:
            flags = run_fixed.run_control(vector.params, vector.raw, vector.setpoint)["flags"].tolist()
            for value in flags:
                ever, never = ever | value, never | ~value
    for bit, flag in enumerate(declarations.system(system).flags):
        assert ever >> bit & 1 and never >> bit & 1, flag.name
