"""Studies whose runs are judged by invariants: what is found, made smaller, named with its command, and kept."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from plumb.__main__ import main
from plumb.campaign import batch, smaller, violated, workers
from plumb.campaign.study import Study, from_table
from plumb.errors import UsageError
from plumb.proof.invariants import Violation
from plumb.proof.scenario_run import RunRequest
from support import judged_system
from support.judged_system import judged_quad

RUNS = 8
BROKEN = [seed for seed in range(1000, 1000 + RUNS) if judged_system.has_fault(seed)]


@pytest.fixture(autouse=True)
def quad(monkeypatch: pytest.MonkeyPatch) -> None:
    judged_quad(monkeypatch)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return study_file(tmp_path, f"runs = {RUNS}")


def study_file(folder: Path, *lines: str) -> Path:
    path = folder / "own.toml"
    head = ('system = "quad"', 'scenario = "random"', "invariants = true")
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")
    return path


def said(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict[str, Any]]:  # Any: JSON
    code = main([*map(str, words), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_violation_is_a_bad_verdict_with_the_smallest_run(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = said(capsys, "campaign", file)
    assert code == 1 and found["violations"] == len(BROKEN) == 2
    assert found["invariants"] == {"moves": 2, "counts": 0} and found["failed"] == []
    for one, seed in zip(found["violated"], BROKEN, strict=True):
        event, time_s = judged_system.fault(seed)
        end_s = time_s + judged_system.STILL_S
        assert (one["seed"], one["invariant"], one["limit"]) == (seed, "moves", judged_system.STILL_S)
        assert end_s <= one["time_s"] <= end_s + 0.05 and one["value"] > one["limit"]
        kept, length = (
            one["command"].split(f"plumb run quad --board native --seed {seed} --scenario random ")[1],
            "--se",
        )
        assert kept.startswith(length) and kept.endswith(f"--condition events={1 << event} --condition plain_frame=1")
        assert float(kept.split()[1]) <= end_s + 0.15


def test_the_command_of_a_violation_shows_it(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, found = said(capsys, "campaign", file)
    for one in found["violated"]:
        _, again = said(capsys, *shlex.split(one["command"])[1:])
        asked = {name: one[name] for name in ("invariant", "time_s", "value", "limit")}
        assert again["violations"] == [asked]


def test_a_run_shows_its_violations_on_the_terminal_and_in_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "quad", "--board", "native", "--scenario", "random", "--seed", str(BROKEN[0])]
    assert main([*words, "--out", str(tmp_path)]) == 0  # the verdict of a run is about its bits
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("violated: moves at "))
    assert line.endswith("the limit is 0.5 (the gyro is never still for 0.5 s)")
    assert line.removeprefix("violated: ") in (tmp_path / "report.html").read_text(encoding="utf-8")
    kept = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert [one["invariant"] for one in kept["violations"]] == ["moves"]


def test_a_run_that_holds_says_so_and_others_say_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "quad", "--board", "native", "--seconds", "3"]
    assert main([*words, "--scenario", "random", "--seed", "1000"]) == 0
    assert "\ninvariants: all 2 hold\n" in capsys.readouterr().out
    assert main([*words, "--scenario", "quiet", "--seed", "1000"]) == 0
    assert "invariants" not in capsys.readouterr().out


def test_a_study_without_a_violation_is_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = said(capsys, "campaign", study_file(tmp_path, "runs = 1"))
    assert (code, found["violations"], found["violated"]) == (0, 0, [])
    assert found["invariants"] == {"moves": 0, "counts": 0}


def test_runs_are_not_judged_unless_the_study_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = study_file(tmp_path, f"runs = {RUNS}")
    path.write_text(path.read_text().replace("true", "false"), encoding="utf-8")
    code, found = said(capsys, "campaign", path)
    assert code == 0 and "violations" not in found


def test_folder_page_and_terminal_have_the_violations(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["campaign", str(file), "--workers", "1", "--out", str(out)]) == 1
    text = capsys.readouterr().out
    kept = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "invariants: 2 violations in 8 runs, judged by 2 invariants" in text
    assert "violated by 2 of 8 runs: moves at " in text and kept["violations"] == 2
    assert any(one["command"] in text for one in kept["violated"])
    assert all(one["command"] in page for one in kept["violated"])
    assert "2 violations in 8 runs, judged by 2 invariants" in page
    assert "the gyro is never still for 0.5 s" in page and "every count is a count" in page


def test_a_resumed_campaign_has_the_violations_that_were_kept(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    words = ["campaign", file, "--workers", 1, "--out", out]
    code, whole = said(capsys, *words)
    broken = sorted((out / "batches").iterdir())[BROKEN[0] - 1000]
    broken.write_text(broken.read_text().replace('"limit":0.5', '"limit":"x"', 1))
    run: list[range] = []

    def noted(study: Study, part: range) -> batch.Batch:
        run.append(part)
        return batch.run_batch(study, part)

    monkeypatch.setattr(workers, "run_batch", noted)
    assert said(capsys, *words, "--resume") == (code, whole)
    assert run == [range(1, 2)]


def test_a_study_of_settings_names_the_run_of_the_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No other command has its settings; a condition that it varies stays as it is."""
    varied = ("[vary]", '"tuning.trust.r_deg2" = [0.2, 0.3]', '"condition.plain_frame" = [0, 1]')
    code, found = said(capsys, "campaign", study_file(tmp_path, "runs = 8", *varied))
    assert code == 1 and found["violations"] == 4
    for one in found["violated"][:2]:
        assert one["command"].startswith("plumb campaign ") and "plain_frame" not in one["command"]
        code, again = said(capsys, *shlex.split(one["command"])[1:])
        same = {name: one[name] for name in ("index", "seed", "invariant", "time_s", "value", "limit")}
        assert code == 1 and [{name: two[name] for name in same} for two in again["violated"]] == [same]


def test_what_a_study_varies_is_not_made_smaller() -> None:
    table = {"system": "quad", "scenario": "random", "runs": 1, "first_seed": BROKEN[0], "invariants": True}
    study = from_table({**table, "vary": {"condition.plain_frame": [0]}})
    (one,) = batch.run_batch(study, range(1)).violations
    assert one.command.endswith(f"--condition plain_frame=0.0 --condition events={1 << judged_system.fault(1001)[0]}")


def test_a_batch_makes_few_runs_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judged_system, "has_fault", lambda seed: True)
    study = from_table({"system": "quad", "scenario": "random", "runs": 5, "invariants": True})
    found = batch.run_batch(study, range(5)).violations
    assert [one.smaller for one in found] == [True] * violated.SMALLER_MOST + [False] * 3
    assert found[-1].command == "plumb run quad --board native --seed 1004 --scenario random"


def always(violation: tuple[Any, ...]) -> Callable[[object], Sequence[Violation]]:  # Any: also what is wrong
    return lambda run: [Violation(*violation)]


@pytest.mark.parametrize(
    ("violation", "reason"),
    [
        (("turns", 1.0, 2.0, 1.0), "invariants.py of quad does not declare 'turns'"),
        (("moves", 1.0, float("nan"), 1.0), "invariants.py of quad has no finite numbers for moves"),
    ],
)
def test_a_violation_that_is_stated_wrongly_is_a_failed_run(
    violation: tuple[Any, ...], reason: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:  # fmt: skip
    judged_quad(monkeypatch, violations=always(violation))
    code, found = said(capsys, "campaign", study_file(tmp_path, "runs = 1"))
    assert code == 1 and found["violations"] == 0 and found["failed"][0]["reason"].startswith(reason)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"invariants": 1}, "invariants = 1: it is true or false"),
        ({"invariants": "yes"}, "invariants = 'yes': it is true or false"),
        ({"invariant": True}, "no entry 'invariant' (did you mean invariants?)"),
        ({"invariants": True, "system": "balancer", "scenario": None}, "no invariants are declared for its runs"),
        ({"invariants": True, "scenario": "quiet"}, "the invariants of quad judge the scenario 'random' alone"),
        ({"invariants": True, "scenario": None}, "judge the scenario 'random' alone: scenario = 'random'"),
        ({"invariants": True, "scenario": None, "vary": {"scenario": ["random", "quiet"]}}, "'random' alone"),
        ({"conditions": {"events": -1}, "invariants": True}, "'events=-1.0': a number from 0 up"),
        ({"invariants": True, "scenario": None, "recording": "walk.npz"}, "invariants is for scenarios"),
    ],
)
def test_a_study_that_cannot_be_judged_is_one_sentence(entry: dict[str, object], said: str) -> None:
    table = {"system": "quad", "scenario": "random", **entry}
    with pytest.raises(UsageError) as refused:
        from_table({name: value for name, value in table.items() if value is not None}, "own.toml")
    assert said in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("guilty", [(), (0,), (6,), (2, 3), (0, 7), (1, 4, 6)])
def test_events_are_left_out_until_those_that_matter_are_left(guilty: tuple[int, ...]) -> None:
    trials: list[Sequence[int]] = []

    def violates(events: Sequence[int]) -> bool:
        trials.append(events)
        return set(guilty) <= set(events)

    assert smaller.fewest(range(8), violates) == list(guilty)
    assert len(trials) <= 2 * 8


def test_a_violation_that_needs_time_keeps_the_time_that_it_needs() -> None:
    """It is found only 3 s behind its moment: the first end that is tried from there on is 4 s behind."""
    request = RunRequest("quad", "native", "random", seed=BROKEN[0])
    found = Violation("moves", 5.0, 1.0, 0.5)

    def judge(trial: RunRequest) -> Violation | None:
        return found if (trial.seconds or judged_system.SECONDS) >= 8.0 else None

    assert smaller.smallest(request, found, judge, frozenset())[0].seconds == 9.1
