"""Campaigns: the same runs whoever makes them, nothing lost when they are killed, failing runs kept."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import plumb
from plumb.__main__ import main
from plumb.boards.contract import Answer
from plumb.boards.fixed import FixedBoard
from plumb.campaign import batch, campaign, folder, workers
from plumb.campaign.campaign import Where
from plumb.campaign.results import Results
from plumb.campaign.study import Study, from_table
from plumb.errors import UsageError
from support.declared_systems import without_output

STUDY = {"system": "quad", "runs": 24, "seconds": 2, "vary": {"scenario": ["motion", "quiet"]}}


def rows(study: Study, where: Where) -> list[dict[str, object]]:
    return list(Results(campaign.run(study, where)).rows())


def test_processes_give_what_one_process_gives() -> None:
    study = from_table(STUDY)
    assert rows(study, Where(workers=2)) == rows(study, Where(workers=1))


def test_a_resumed_campaign_runs_what_is_missing_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study, out = from_table(STUDY), tmp_path / "out"
    whole = rows(study, Where(1, out=out))
    kept = sorted((out / "batches").iterdir())
    kept[3].unlink()
    kept[5].write_bytes(kept[5].read_bytes()[:100])  # cut by a full disk
    run: list[range] = []

    def noted(of: Study, indices: range) -> batch.Batch:
        run.append(indices)
        return batch.run_batch(of, indices)

    monkeypatch.setattr(workers, "run_batch", noted)
    assert rows(study, Where(1, out=out, resume=True)) == whole
    assert run == [range(6, 8), range(10, 12)]


def test_a_limit_without_a_figure_is_reported_after_the_first_batch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "study.toml", tmp_path / "out"
    text = 'system = "quad"\nruns = 32\nseconds = 2\n[limits]\nangle_rms_deg = 1\n'
    path.write_text(text, encoding="utf-8")
    words = ["campaign", str(path), "--workers", "1", "--out", str(out)]
    assert main(words) == 2
    assert "limits.angle_rms_deg: no run has it (did you mean angle_rmse_deg?)" in capsys.readouterr().err
    assert len(list((out / "batches").iterdir())) == 1
    path.write_text(text.replace("rms_", "rmse_"), encoding="utf-8")
    assert main([*words, "--resume"]) == 0
    assert "100.0 % of the runs have angle_rmse_deg of at most 1" in capsys.readouterr().out


def test_a_killed_campaign_keeps_its_batches_and_its_processes_end(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "plumb", "campaign", "quad", "--runs", "4000", "--seconds", "20", "--workers", "2"]
    process = subprocess.Popen([*words, "--out", str(tmp_path / "out")], stderr=subprocess.DEVNULL)
    end_s = time.monotonic() + 60.0
    while not list(tmp_path.glob("out/batches/*.json")) and time.monotonic() < end_s:
        time.sleep(0.05)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
    process.kill()
    process.wait()
    kept = list(folder.batches_of(tmp_path / "out"))
    assert kept and all(len(one.index) == len(one.digest) for one in kept)
    while any(Path(f"/proc/{child}").exists() for child in children) and time.monotonic() < end_s:
        time.sleep(0.05)
    left = [child for child in children if Path(f"/proc/{child}").exists()]
    for child in left:
        os.kill(int(child), signal.SIGKILL)
    assert not left, "processes of a killed campaign wait for ever"


@pytest.mark.parametrize(
    ("change", "said"),
    [({"runs": 26}, "the campaign of another study"), ({"first_seed": 1}, "the campaign of another study")],
)
def test_a_folder_of_another_campaign_is_left_alone(tmp_path: Path, change: dict[str, object], said: str) -> None:
    rows(from_table(STUDY), Where(1, out=tmp_path))
    with pytest.raises(UsageError, match="go on with --resume"):
        rows(from_table(STUDY), Where(1, out=tmp_path))
    with pytest.raises(UsageError, match=said):
        rows(from_table({**STUDY, **change}), Where(1, out=tmp_path, resume=True))


def test_a_campaign_of_another_core_is_not_resumed(tmp_path: Path) -> None:
    rows(from_table(STUDY), Where(1, out=tmp_path))
    about = json.loads((tmp_path / "campaign.json").read_text(encoding="utf-8"))
    about["identity"]["core_sha256"] = "0" * 64
    (tmp_path / "campaign.json").write_text(json.dumps(about), encoding="utf-8")
    with pytest.raises(UsageError, match=r"another version .core_sha256 0{12}...0{6}, here"):
        rows(from_table(STUDY), Where(1, out=tmp_path, resume=True))


def test_a_full_disk_is_one_sentence_and_the_batches_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[int] = []

    def full(path: Path, data: bytes) -> int:
        written.append(len(data))
        if len(written) > 3:
            raise OSError(28, "No space left on device")
        with path.open("wb") as file:
            return file.write(data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(UsageError, match=r"No space left on device; free some space .* --resume goes on"):
        rows(from_table(STUDY), Where(1, out=tmp_path))
    assert len(list(folder.batches_of(tmp_path))) == 2


def test_a_script_needs_no_guard_for_the_processes_of_its_campaign(tmp_path: Path) -> None:
    """A spawned process imports the script that began it: this one would begin its campaign again in every worker."""
    script = tmp_path / "own.py"
    script.write_text(
        "import plumb\n"
        "print(len(plumb.runs('quad', runs=32, seconds=2, open_loop=True, workers=2).table()['seed']))\n"
        "print(__file__, __spec__)\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"32\n{script} None\n", "")


def test_a_failing_run_is_kept_with_its_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = batch.run_one

    def failing(request: object) -> object:
        if getattr(request, "seed") == 1003:  # noqa: B009
            raise ZeroDivisionError("float division by zero")
        return one(request)  # type: ignore[arg-type]

    monkeypatch.setattr(batch, "run_one", failing)
    code = main(["campaign", "quad", "--runs", "8", "--seconds", "2", "--workers", "1", "--json"])
    said = json.loads(capsys.readouterr().out)
    assert code == 1 and said["runs"] == 8 and said["metrics"]["angle_rmse_deg"]["runs"] == 7
    assert said["failed"] == [
        {
            "seed": 1003,
            "reason": "ZeroDivisionError: float division by zero",
            "command": "plumb run quad --board native --seed 1003 --seconds 2",
        }
    ]


def test_the_json_has_means_with_intervals(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "balancer", "--runs", "10", "--seconds", "3", "--open-loop", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    figure = said["metrics"]["angle_rmse_deg"]
    assert said["runs"] == 10 and figure["low"] < figure["mean"] < figure["high"]
    assert said["worst"]["angle_rmse_deg"].startswith("plumb run balancer --board native --seed 10")


def test_a_run_of_a_campaign_has_the_figures_of_its_command(capsys: pytest.CaptureFixture[str]) -> None:
    main(["campaign", "quad", "--runs", "6", "--seconds", "3", "--json"])
    campaign_said = json.loads(capsys.readouterr().out)
    words = campaign_said["worst"]["angle_rmse_deg"].split()[1:]
    main([*words, "--json"])
    alone = json.loads(capsys.readouterr().out)
    assert alone["metrics"]["angle_rmse_deg"] == campaign_said["metrics"]["angle_rmse_deg"]["max"]


def test_another_board_confirms_every_run(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["campaign", "quad", "--runs", "3", "--seconds", "2", "--workers", "1", "--confirm", "fixed", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["metrics"]["confirmed_mismatches"]["max"] == 0


def test_a_run_that_another_board_gives_otherwise_is_named_with_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of four runs the board gives one step of the third one otherwise."""
    right, asked = FixedBoard.run_injected, []

    def wrong(board: FixedBoard, *given: Any) -> Answer:  # Any: as the board has them
        answer = right(board, *given)
        asked.append(answer)
        if len(asked) == 3:
            answer.digests[7] ^= 1
        return answer

    monkeypatch.setattr(FixedBoard, "run_injected", wrong)
    words = ["campaign", "quad", "--runs", "4", "--seconds", "2", "--workers", "1", "--confirm", "fixed"]
    assert main([*words, "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "confirmed: 3 of 4 runs are the same on fixed in every step" in said
    command = "plumb run quad --board fixed --seed 1002 --seconds 2"
    assert f"differs: 1 of 100 steps ({command})" in said
    differing = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["differing"]
    assert differing == [{"seed": 1002, "steps": 1, "command": command}]
    assert command in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_command_that_confirms_has_link_and_board() -> None:
    study = from_table({**STUDY, "confirm": "virtual", "link": "can", "image": "quad"})
    board = "plumb run quad --board virtual --link can --image quad --seed 1000 "
    assert study.confirming_command(0).startswith(board)
    study = from_table({**STUDY, "confirm": "qemu", "vary": {"tuning.trust.r_deg2": [0.2, 0.3]}})
    assert study.confirming_command(1).endswith(" --confirm qemu")


def test_the_folder_has_the_runs_a_summary_and_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    study = tmp_path / "study.toml"
    study.write_text(
        'system = "quad"\nruns = 16\nseconds = 2\n[vary]\ntuning = ["quiet", "adaptive"]\n', encoding="utf-8"
    )
    out = tmp_path / "out"
    assert main(["campaign", str(study), "--out", str(out)]) == 0
    table = parquet.read_table(out / "runs.parquet")
    about = json.loads(table.schema.metadata[b"plumb"])
    assert table.num_rows == 16 and {"seed", "digest", "tuning", "angle_rmse_deg"} <= set(table.column_names)
    assert about["study"]["runs"] == 16 and about["identity"]["part"]["core_sha256"]
    page = (out / "report.html").read_text(encoding="utf-8")
    for part in ("Figures", "Distribution of angle_rmse_deg", "What moves a figure", "plumb run quad --board native"):
        assert part in page, part
    capsys.readouterr()
    compared = tmp_path / "compared"
    words = ["campaign", "quad", "--runs", "8", "--seconds", "2", "--tuning", "paper", "--against", str(out), "--json"]
    assert main([*words, "--out", str(compared)]) == 0
    page = (compared / "report.html").read_text(encoding="utf-8")
    for part in (
        "Compared with the other campaign",
        "scenario motion, tuning paper, closed loop, 2 s. An",
        "not shown",
    ):
        assert part in page, part
    against = {one["metric"]: one for one in json.loads(capsys.readouterr().out)["against"]}
    assert against["angle_rmse_deg"]["pairs"] == 8 and against["angle_rmse_deg"]["real"]
    assert against["accel_only_rmse_deg"]["difference"] == 0.0 and not against["accel_only_rmse_deg"]["real"]


def test_two_campaigns_do_not_write_to_one_folder(tmp_path: Path) -> None:
    """Nor does one that goes on with the other; when the first has ended, anyone may."""
    study, out = from_table(STUDY), tmp_path / "out"
    first = campaign.run(study, Where(1, out=out))
    next(first)
    with pytest.raises(UsageError, match=r"another campaign is being written to .*: wait for its end"):
        rows(study, Where(1, out=out, resume=True))
    first.close()  # type: ignore[attr-defined]  # a generator
    assert len(rows(study, Where(1, out=out, resume=True))) == study.runs


def test_comparing_campaigns_needs_the_same_runs_and_system(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other"
    words = ["--runs", "16", "--seconds", "2", "--workers", "1"]
    assert main(["campaign", "quad", *words, "--out", str(other)]) == 0
    capsys.readouterr()
    assert main(["campaign", "balancer", *words, "--against", str(other)]) == 2
    assert "has runs of quad, whose noise is not that of balancer" in capsys.readouterr().err
    batches = sorted((other / "batches").iterdir())
    batches[2].write_bytes(batches[2].read_bytes()[:40])
    for kept, broken in (
        (4, ('"steps":[', '"steps":["x",')),
        (5, ('"seed":[', '"seed":[2,')),
        (6, ('"metrics":{', '"metrics":{"a":[],')),
    ):
        batches[kept].write_text(batches[kept].read_text().replace(*broken, 1))
    assert main(["campaign", "quad", *words, "--against", str(other)]) == 2
    assert capsys.readouterr().err == f"plumb: {other} has 12 of its 16 runs: finish it with --resume\n"
    assert main(["campaign", "quad", *words, "--out", str(other), "--resume"]) == 0
    assert main(["campaign", "quad", *words, "--against", str(other)]) == 0


def test_seeds_that_the_other_campaign_does_not_have_are_refused_before_a_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["campaign", "quad", "--runs", "2", "--seconds", "2", "--workers", "1", "--out", str(tmp_path)]) == 0
    monkeypatch.setattr(batch, "run_one", lambda request: pytest.fail("a run was begun"))
    capsys.readouterr()
    words = ["campaign", "quad", "--first-seed", "2000", "--runs", "2", "--workers", "1", "--against", str(tmp_path)]
    assert main(words) == 2
    assert "no seed in common" in capsys.readouterr().err


def test_runs_is_an_iterator_and_a_table() -> None:
    system = without_output()
    runs = plumb.runs(system, runs=4, seconds=4, workers=1)
    seen = [row["seed"] for row in runs]
    table = runs.table()
    assert sorted(seen) == [1000, 1001, 1002, 1003] == table["seed"].tolist() and len(runs) == 4
    alone = plumb.run(system, seed=1002, seconds=4)
    assert table["digest"][2] == batch.digest_of(alone.words)
    assert table["angle_rmse_deg"][2] == pytest.approx(alone.metrics["angle_rmse_deg"])
    assert runs.figures["angle_rmse_deg"]["mean"] == pytest.approx(table["angle_rmse_deg"].mean())


def peak_kib(runs: int) -> int:
    """Most memory that a campaign of so many runs takes in a process of its own."""
    words = ["campaign", "quad", "--runs", str(runs), "--seconds", "2", "--open-loop", "--workers", "1", "--json"]
    code = (
        "import resource; from plumb.__main__ import main; "
        f"assert main({words!r}) == 0; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(ran.stdout.splitlines()[-1])


def test_memory_does_not_grow_with_the_number_of_runs() -> None:
    # The record of a run has 100 steps of more than 100 bytes: 1400 runs that were kept would be 14 MiB and more.
    assert peak_kib(1500) - peak_kib(100) < 6 * 1024
