"""A report says what it was made with, and the same run gives the same page."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb import __version__
from plumb.boards.native.board import NativeBoard
from plumb.boards.native.core import core_path
from plumb.checkout import CHECKOUT
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.judging import angles
from plumb.proof import limits, run_identity, runs
from plumb.proof.measures import main_of
from plumb.spec.protocol import protocol
from plumb.systems.quad import scenarios as quad

EPOCH, DATE = "1700000000", "2023-11-14T22:13:20Z"


def made(folder: Path, *arguments: str, board: str = "native") -> dict[str, Any]:
    """summary.json of a run of two seconds."""
    assert front.main(["run", "quad", "--board", board, "--seconds", "2", *arguments, "--out", str(folder)]) == 0
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return found


def test_the_identity_is_complete_and_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(run_identity.DATE_VARIABLE, EPOCH)
    summary = made(tmp_path, "--seed", "7")
    found, core = summary["identity"], core_path().read_bytes()
    assert found["plumb"]["version"] == __version__
    head = subprocess.run(["git", "-C", CHECKOUT, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    commit = found["plumb"]["git_hash"].rstrip("+")
    assert len(commit) >= 16 and head.stdout.startswith(commit)
    assert found["protocol"] == {"version": protocol().version, "dbc_hash": f"0x{protocol().dbc_hash:08x}"}
    assert found["date_utc"] == DATE
    assert found["command"] == f"plumb run quad --board native --seconds 2 --seed 7 --out {tmp_path}"
    assert (found["part"]["board"], found["part"]["image"]["file"]) == ("native", core_path().name)
    assert found["part"]["image"]["sha256"] == hashlib.sha256(core).hexdigest()
    assert found["part"]["image"]["compiler"].split()[0].strip(":") in ("GCC", "clang")
    assert found["host"]["python"] == platform.python_version()
    params = quantise(quad.TUNINGS[quad.DEFAULT_TUNING])
    assert found["parameters_crc32"] == f"0x{params.crc32():08x}"
    assert {name: row["word"] for name, row in found["parameters"].items()} == {"system": 0, **params.own()}
    period = found["parameters"]["kalman.dt_s_q33"]
    assert (period["unit"], period["value"]) == ("s", pytest.approx(0.02, rel=1e-3))
    page = (tmp_path / "report.html").read_text()
    for text in (found["part"]["image"]["sha256"], found["plumb"]["git_hash"], DATE, "--seed 7", *found["parameters"]):
        assert text in page


def test_the_hash_is_that_of_the_flash_image_that_ran(tmp_path: Path) -> None:
    pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")
    from plumb.flash.image import find_image

    image = tmp_path / "my image.bin"
    image.write_bytes(find_image().read_bytes())
    part = made(tmp_path / "out", "--image", str(image), board="virtual")["identity"]["part"]
    assert part["image"]["file"] == image.name
    assert part["image"]["sha256"] == hashlib.sha256(image.read_bytes()).hexdigest()
    assert len(part["unique_id"]) == 24 and part["flash_kib"] >= 64 and part["part_id"].startswith("0x")


def test_two_runs_with_a_set_date_give_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(run_identity.DATE_VARIABLE, EPOCH)
    seen = []
    for _ in range(2):
        made(tmp_path)
        seen.append({path.name: path.read_bytes() for path in tmp_path.iterdir()})
    assert seen[0] == seen[1] and set(seen[0]) == {"report.html", "summary.json", "steps.csv"}
    monkeypatch.setenv(run_identity.DATE_VARIABLE, "1700000001")
    made(tmp_path)
    assert (tmp_path / "report.html").read_bytes() != seen[0]["report.html"]


def test_a_date_that_is_none_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(run_identity.DATE_VARIABLE, "yesterday")
    with pytest.raises(UsageError, match=r"SOURCE_DATE_EPOCH='yesterday'.*unset it"):
        run_identity.date_utc()


def test_a_hostile_command_line_is_text(tmp_path: Path) -> None:
    folder = tmp_path / "<img src=x onerror=1>"
    made(folder)
    page = (folder / "report.html").read_text()
    assert "<img" not in page and "&lt;img" in page


def test_the_page_needs_no_extra(tmp_path: Path) -> None:
    code = (
        "import sys; [sys.modules.__setitem__(name, None) for name in ('matplotlib', 'plotly', 'bokeh')];"
        "from plumb.__main__ import main;"
        f"sys.exit(main(['run', 'quad', '--board', 'native', '--seconds', '2', '--out', {str(tmp_path)!r}]))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120.0, check=False)
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines()[-2:] == [
        f"report: {tmp_path}/report.html",
        f"files: {tmp_path}/summary.json, {tmp_path}/steps.csv",
    ]


HEADING = {"scenario": "motion", "tuning": "adaptive", "loop": "open"}


def test_bits_and_accuracy_are_separate() -> None:
    """An estimate that is wrong in every step and agrees in every bit."""
    params = quantise(quad.TUNINGS["adaptive"])
    run = runs.open_loop(NativeBoard(), runs.prescribed(quad.scenario("motion", 3)), params)
    summary = run.summary(**HEADING)
    assert (summary["verdict"], summary["bit_exact"], summary["accuracy"]) == ("pass", True, "pass")
    assert [row["metric"] for row in summary["accuracy_limits"]] == ["angle_rmse_deg"]
    turned = {**run.inputs.truth, "tilt_deg": run.inputs.truth["tilt_deg"] + 93.0}
    wrong = replace(run, inputs=replace(run.inputs, truth=turned))
    summary = wrong.summary(**HEADING)
    assert (summary["verdict"], summary["bit_exact"], summary["accuracy"]) == ("pass", True, "fail")
    bits, accuracy = wrong.statements(HEADING)
    assert str(bits) == "bit-exact: every one of the 6000 steps equals the model"
    assert str(accuracy).startswith("accuracy: 93")
    assert "outside the limit: at most 0.6 deg rms (asked of" in str(accuracy)
    faulty = wrong.accuracy({**HEADING, "faults": ["stuck:gyro@1"]})
    assert faulty.verdict == "fail" and faulty.text.endswith("; without faults or conditions)")
    summary = wrong.summary(**{**HEADING, "scenario": "recording.npz"})
    assert summary["accuracy"] is None and summary["accuracy_limits"] == []
    assert str(wrong.statements({"scenario": None})[1]).endswith("no limit: only the system's scenarios have one")


def test_a_measured_limit_stands_where_none_was_asked_for() -> None:
    """Of another tuning, and of a shorter run."""
    inputs = runs.prescribed(quad.scenario("motion", 3, seconds=12.0))
    run = runs.open_loop(NativeBoard(), inputs, quantise(quad.TUNINGS["paper"]))
    [row] = run.summary(**{**HEADING, "tuning": "paper"})["accuracy_limits"]
    assert (row["metric"], row["basis"], row["kept"]) == (angles.MAIN, limits.BASIS, True)
    assert row["value"] == limits.table("quad", "open", "motion", shorter=True)["paper"]
    text = run.accuracy({**HEADING, "tuning": "paper"}).text
    assert f"within the limit: at most {row['value']:g} deg rms ({limits.BASIS}; for less than 120 s)" in text
    own = run.accuracy({**HEADING, "tuning": "own"}).limits[0]["value"]
    assert own == limits.table("quad", "open", "motion", shorter=True)["*"]


@pytest.mark.parametrize(("reached", "verdict"), [(0.9, "pass"), (1.0, "pass"), (1.1, "fail"), (None, None)])
def test_a_limit_holds_up_to_its_value(reached: float | None, verdict: str | None) -> None:
    most, least = limits.Limit("angle_rmse_deg", "at most", 1.0, "deg"), limits.Limit("gain", "at least", -1.0, "%")
    metrics = {"angle_rmse_deg": reached, "gain": None if reached is None else -reached}
    found = limits.judged(metrics, [most, least], main_of("quad"))
    assert found.verdict == verdict
