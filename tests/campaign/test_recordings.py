"""Studies on recordings: a run has the figures of `plumb replay`, and with a grade those of `plumb compare`."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb import systems
from plumb.__main__ import main
from plumb.analyses.comparison.contenders import contenders
from plumb.analyses.comparison.samples import motion_of
from plumb.analyses.comparison.table import compare, of_recordings
from plumb.campaign import batch, campaign
from plumb.campaign.campaign import Where
from plumb.campaign.recorded import DATA
from plumb.campaign.results import Results
from plumb.campaign.study import from_table
from plumb.errors import UsageError
from plumb.readers import recording

NAMES = ("slow.npz", "fast.npz")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two made-up recordings of 12 s: turning about x, with their reference."""
    for name, hz in zip(NAMES, (0.2, 0.7), strict=True):
        time_s = np.arange(2400) / 200.0
        tilt = np.radians(20.0) * np.sin(2.0 * np.pi * hz * time_s)
        zero = np.zeros_like(tilt)
        np.savez(
            tmp_path / name,
            gyr=np.column_stack([np.gradient(tilt, time_s), zero, zero]),
            acc=9.80665 * np.column_stack([zero, np.sin(tilt), np.cos(tilt)]),
            ref_quat=np.column_stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero]),
            movement=time_s > 2.0,
            rate_hz=200.0,
        )
    return tmp_path


def results(table: dict[str, object]) -> Results:
    return Results(campaign.run(from_table(table), Where(workers=1)))


@pytest.mark.parametrize("system", systems.with_part("replay"))
def test_a_run_on_a_recording_has_the_figures_of_replay(
    system: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = {"recordings": str(folder), "vary": {"recording": list(NAMES)}}
    table: dict[str, object] = {"system": system, "runs": 2, "seconds": 9.5, **recorded}
    found, study = results({**table, "reference": True}), from_table(table)
    for index in range(2):
        words = shlex.split(study.command(index))
        assert words[:3] == ["plumb", "replay", str(folder / NAMES[index])]
        assert main([*words[1:], "--json"]) == 0
        alone = json.loads(capsys.readouterr().out)
        assert found.steps[index] == alone["steps"]
        assert found.metrics["angle_rmse_deg"][index] == alone["metrics"]["angle_rmse_deg"]
        assert found.metrics["angle_max_deg"][index] == alone["metrics"]["angle_max_deg"]


@pytest.mark.parametrize("system", systems.with_part("compare"))
@pytest.mark.parametrize("grade", ["recorded", "mpu6050-whole", "missing-10", "lost-2"])
def test_a_grade_gives_the_error_of_compare(system: str, grade: str, folder: Path) -> None:
    table = {
        "system": system, "runs": 2, "recordings": str(folder), "recording": NAMES[0], "decimate": 3, "first_seed": 1,
        "grade": grade,
    }  # fmt: skip
    found = results(table)
    motion = motion_of(recording.load(folder / NAMES[0]))
    (report,) = compare([of_recordings([motion], grade, 3)], contenders([system]), lambda: None)
    rows = {row.seed: row for row in report.rows}
    for index in range(2):
        row = rows.get(index + 1) or rows[0]  # seed 0: a grade that draws nothing
        # The same errors, summed in another order.
        assert abs(found.metrics["angle_rmse_deg"][index] - row.rmse_deg) < 1e-9
        assert abs(found.metrics["angle_max_deg"][index] - row.max_deg) < 1e-9


def test_settings_of_a_tuning_are_varied_on_a_recording(folder: Path) -> None:
    table = {"system": "quad", "runs": 2, "recordings": str(folder), "recording": NAMES[1]}
    shipped = results(table).digest
    varied = results({**table, "tuning": "recording", "vary": {"tuning.kalman.q_bias_dps2_per_s": [1e-6, 0.5]}}).digest
    assert len(set(shipped)) == 1 and len({*shipped, *varied}) == 3
    command = from_table({**table, "tuning": "recording", "vary": {"tuning.trust.r_deg2": [1, 2]}}, "a.toml")
    assert command.command(1) == "plumb campaign a.toml --only 1 --runs 2 --first-seed 1000 --tuning recording"


def test_the_folder_is_that_of_the_study_or_of_the_environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f'system = "attitude"\nrecording = "{NAMES[0]}"\nruns = 1\n'
    (folder / "studies").mkdir()
    (folder / "studies" / "next_to_it.toml").write_text(f'{text}recordings = ".."\n', encoding="utf-8")
    (folder / "studies" / "data.toml").write_text(text, encoding="utf-8")
    monkeypatch.delenv(DATA, raising=False)
    assert main(["campaign", str(folder / "studies" / "next_to_it.toml"), "--json"]) == 0
    assert main(["campaign", str(folder / "studies" / "data.toml"), "--json"]) == 2
    monkeypatch.setenv(DATA, str(folder))
    assert main(["campaign", str(folder / "studies" / "data.toml"), "--json"]) == 0


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"recordings": "nowhere"}, "there is no folder nowhere: name the one that has the recordings"),
        ({"recording": "slwo.npz"}, "there is no recording slwo.npz in"),
        ({"recording": "slwo.npz"}, r"did you mean slow.npz\?"),
        ({"scenario": "flight"}, "scenario is for scenarios: a recording has none"),
        ({"vary": {"faults": [[], ["stuck:gyro_x@3"]]}}, "faults is for scenarios"),
        ({"grade": "mpu"}, "there is no grade 'mpu'; there are recorded, "),
        ({"grade": "moving-start"}, "makes several runs of a recording: `plumb compare` has it"),
        ({"decimate": 2}, "decimate = 2: it is 1, 3, 6"),
        ({"system": "balancer"}, "balancer: no recording can be made its inputs"),
        ({"system": "quad", "grade": "bias"}, "quad: "),
        ({"vary": {"tuning.gyro.min_counts": [1, 2]}}, "name the tuning, with tuning = 'NAME'"),
    ],
)
def test_a_broken_study_on_recordings_is_one_sentence(entry: dict[str, object], said: str, folder: Path) -> None:
    with pytest.raises(UsageError, match=said):
        from_table({"system": "attitude", "recording": NAMES[0], "recordings": str(folder), **entry})


@pytest.mark.parametrize("entry", [{"grade": "bias"}, {"recordings": "."}, {"decimate": 3}, {"as_found": True}])
def test_what_belongs_to_recordings_is_refused_without_one(entry: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(entry))} is for recordings: name one with recording"):
        from_table({"system": "attitude", **entry})


def test_other_content_is_another_campaign(folder: Path) -> None:
    study = from_table({"system": "attitude", "recording": NAMES[0], "recordings": str(folder), "runs": 1})
    before = batch.identity(study)
    (folder / NAMES[1]).replace(folder / NAMES[0])
    assert batch.identity(study)["recordings_sha256"] != before["recordings_sha256"]
    assert "recordings_sha256" not in batch.identity()


def test_a_file_that_is_no_recording_names_the_study(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "text.npz").write_text("no recording", encoding="utf-8")
    path = folder / "broken.toml"
    path.write_text('system = "attitude"\nrecording = "text.npz"\nrecordings = "."\n', encoding="utf-8")
    assert main(["campaign", str(path), "--json"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"plumb: {path}: run 0 cannot be drawn: text.npz is damaged") and said.count("\n") == 1


def test_a_scenario_that_cannot_be_drawn_names_the_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "negative.toml"
    path.write_text('system = "quad"\n[vary]\n"tuning.trust.r_deg2" = [-1, 1]\n', encoding="utf-8")
    assert main(["campaign", str(path), "--json"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"plumb: {path}: run 0 cannot be drawn: ") and said.count("\n") == 1


def test_python_names_a_folder_and_its_recordings(folder: Path) -> None:
    table = plumb.runs("attitude", runs=2, vary={"recording": list(NAMES)}, recordings=folder, workers=1).table()
    assert table["recording"] == list(NAMES) and table["steps"].tolist() == [2400, 2400]


@pytest.fixture
def study_of_faulty(folder: Path) -> Path:
    """A study on a recording in g and a good one."""
    with np.load(folder / NAMES[0]) as held:
        np.savez(folder / "in-g.npz", **{**held, "acc": held["acc"] / 9.80665})
    study = folder / "study.toml"
    study.write_text(
        f'system = "phone"\nruns = 3\nseconds = 3.0\nrecordings = "."\n'
        f'vary.recording = ["in-g.npz", "{NAMES[0]}", "{NAMES[1]}"]\n'
    )
    return study


def test_a_campaign_says_the_faults_of_its_recordings_first(
    study_of_faulty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["campaign", str(study_of_faulty), "--workers", "1", "--json"])
    said = capsys.readouterr()
    assert said.err.startswith("plumb: warning: in-g.npz: accelerometer-units: sure")
    assert "in-g.npz: --as-found undoes acc*9.80665\n" in said.err
    check = json.loads(said.out)["check"]
    assert list(check) == ["in-g.npz", *NAMES]
    wrong = [[one["kind"] for one in check[name]["findings"] if one["wrong"]] for name in check]
    assert "accelerometer-units" in wrong[0] and "accelerometer-units" not in wrong[1] + wrong[2]


def test_a_campaign_undoes_what_is_found(study_of_faulty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", str(study_of_faulty), "--as-found", "--workers", "1", "--json"]) == 0
    said = capsys.readouterr()
    assert "in-g.npz as found: acc*9.80665\n" in said.err
    assert json.loads(said.out)["check"]["in-g.npz"]["undone"] == ["acc*9.80665"]
    vary = {"recording": ["in-g.npz", NAMES[0]]}
    recorded = {"recordings": str(study_of_faulty.parent), "vary": vary, "runs": 2, "seconds": 3.0}
    found = results({"system": "phone", **recorded, "as_found": True})
    assert found.metrics["angle_rmse_deg"][0] == pytest.approx(found.metrics["angle_rmse_deg"][1], abs=1e-3)
    assert main(shlex.split(f"campaign {study_of_faulty} --as-found --only 0 --json")) == 0


@pytest.mark.parametrize(("runs", "said"), [(1, "1 run of quad from"), (2, "2 runs of quad from")])
def test_the_number_of_runs_is_said_in_its_number(runs: int, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["campaign", "quad", "--runs", str(runs), "--seconds", "1", "--workers", "1"])
    assert capsys.readouterr().out.startswith(said)
