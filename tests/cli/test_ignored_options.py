"""An option that a command would ignore is refused; a report that cannot be written is refused before the run."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.files import whole_files

OF_VIRTUAL = "is for board virtual: name virtual among the boards, or leave"
ONE_WORK = "give one of --table, --confirm and --plots"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run quad --board native --link can --seconds 1", f"--link {OF_VIRTUAL} --link out"),
        ("run quad --board native --link serial --seconds 1", f"--link {OF_VIRTUAL} --link out"),
        ("run quad --board native --image quad --seconds 1", f"--image {OF_VIRTUAL} --image out"),
        ("monitor --board serial:/dev/none --link can", f"--link {OF_VIRTUAL} --link out"),
        ("golden check --link can", f"--link {OF_VIRTUAL} --link out"),
        ("golden check --board native --board qemu --link can", f"--link {OF_VIRTUAL} --link out"),
        ("doctor --link can", f"--link {OF_VIRTUAL} --link out"),
        ("setup --board native --link can", f"--link {OF_VIRTUAL} --link out"),
        ("record --bus file:none.log --link can --out x", f"--link {OF_VIRTUAL} --link out"),
        ("systems --link can", f"--link {OF_VIRTUAL} --link out"),
        ("systems --confirm native --link can", f"--link {OF_VIRTUAL} --link out"),
        ("campaign quad --link can", f"--link {OF_VIRTUAL} --link out"),
        ("campaign quad --confirm qemu --image quad", f"--image {OF_VIRTUAL} --image out"),
        ("systems --seeds 0", "--seeds is for --table"),
        ("systems --seeds 3 --system quad", "--seeds is for --table"),
        ("systems --first-seed 0 --confirm native", "--first-seed is for --table"),
        ("systems --short", "--short is for --table"),
        ("systems --seconds 3 --table", "--seconds is for --confirm"),
        ("systems --table --confirm native", ONE_WORK),
        ("systems --plots figures --table", ONE_WORK),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(
    words: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert front.main(words.split()) == 2
    assert capsys.readouterr().err == f"plumb: {sentence}\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", ["demo", "run quad --board native", "replay walk.csv --board native"])
def test_a_report_that_cannot_be_written_is_refused_before_the_run(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_late(*_: object, **__: object) -> None:
        raise AssertionError("the run has begun")

    monkeypatch.setattr("plumb.proof.scenario_run.perform", too_late)
    monkeypatch.setattr("plumb.readers.replay.prepare", too_late)
    for name in ("file", "walk.csv"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    assert front.main([*words.split(), "--out", str(tmp_path / "file" / "folder")]) == 2
    said = capsys.readouterr().err
    assert "cannot write" in said and "choose another folder with --out" in said


def test_asking_whether_a_file_can_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    whole_files.require_writable(tmp_path / "kept" / "a" / "b" / "report.html", "advice")
    assert [path.name for path in tmp_path.rglob("*")] == ["kept"]
