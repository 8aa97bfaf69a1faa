"""The folder of a campaign: every batch is a file as soon as it is done, so that what is killed can go on.

campaign.json       the study, its hash, the identity of what runs it
batches/000012.json results of one batch, written whole or not at all
.lock               held by the process that writes
runs.parquet        all runs, when the campaign is done (runs.csv without pyarrow)
summary.json        what --json prints, and the identity
report.html         distributions, intervals, worst seeds, sensitivity
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from plumb.campaign import results
from plumb.campaign.batch import Batch
from plumb.campaign.results import Results
from plumb.campaign.study import Study
from plumb.errors import UsageError
from plumb.files import whole_files

ADVICE = "free some space or choose another folder with --out; --resume goes on from what is kept"
ABOUT, LOCK = "campaign.json", ".lock"


class Folder:
    """batch_runs: runs of a batch."""

    def __init__(self, path: Path, of: Study, identity: Mapping[str, object], batch_runs: int) -> None:
        self.path, self._study, self._identity, self._batch_runs = path, of, dict(identity), batch_runs
        self._lock: IO[str] | None = None

    def begin(self, *, resume: bool) -> None:
        """Make the folder, or with resume check that it has the same campaign. Raises UsageError for a folder that has
        another campaign, one that resume was not asked for, or one that another process is writing."""
        self._claim()
        about = {
            "study": self._study.to_json(),
            "study_sha256": self._study.sha256(),
            "identity": self._identity,
            "batch_runs": self._batch_runs,
        }
        if (self.path / ABOUT).exists():
            if not resume:
                raise UsageError(
                    f"{self.path} has a campaign: go on with --resume, or choose another folder with --out"
                )
            kept = about_of(self.path)
            if kept.get("study_sha256") != about["study_sha256"]:
                raise UsageError(f"{self.path} has the campaign of another study: choose another folder with --out")
            if kept.get("identity") != self._identity:
                odd = differences(kept.get("identity", {}), self._identity)
                raise UsageError(
                    f"{self.path} was begun with another version ({odd}): choose another folder with --out"
                )
            return
        whole_files.write_whole({self.path / ABOUT: json.dumps(about, indent=2) + "\n"}, ADVICE)

    def _claim(self) -> None:
        """Keep other processes out until `end`, or until this one is gone however it ended. Where the system or the
        file system knows no locks, nobody is kept out."""
        whole_files.require_writable(self.path / ABOUT, ADVICE)
        self.path.mkdir(parents=True, exist_ok=True)
        try:
            fcntl = importlib.import_module("fcntl")
            self._lock = (self.path / LOCK).open("w", encoding="ascii")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.end()
            busy = f"another campaign is being written to {self.path}"
            raise UsageError(f"{busy}: wait for its end, or choose another folder with --out") from None
        except (ImportError, OSError):
            return

    def end(self) -> None:
        """Let others write to the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _file(self, number: int) -> Path:
        return self.path / "batches" / f"{number:06d}.json"

    def batch(self, number: int, indices: range) -> Batch | None:
        """A batch that is kept whole; None: it is to be run."""
        found = results.read_batch(self._file(number))
        return found if found is not None and found.index == list(indices) else None

    def keep(self, number: int, batch: Batch) -> None:
        """Write a batch. Raises UsageError for a full disk."""
        whole_files.write_whole({self._file(number): results.batch_bytes(batch)}, ADVICE)

    def finish(self, files: Mapping[str, str | bytes]) -> None:
        whole_files.write_whole({self.path / name: content for name, content in files.items()}, ADVICE)


def differences(kept: Mapping[str, object], now: Mapping[str, object]) -> str:
    """The difference between two identities, in words."""
    names = [name for name in now if kept.get(name) != now[name]]
    return ", ".join(f"{name} {_short(kept.get(name))}, here {_short(now[name])}" for name in names) or "another layout"


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 24 else f"{text[:12]}...{text[-6:]}"


def about_of(path: Path) -> dict[str, Any]:  # Any: JSON
    """campaign.json of a folder; raises UsageError for a folder that has no campaign."""
    try:
        found = json.loads((path / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        raise UsageError(f"{path} has no campaign: give a folder that `plumb campaign --out` has written") from None
    if not isinstance(found, dict) or not isinstance(found.get("study"), dict):
        raise UsageError(f"{path / ABOUT} is not one of a campaign")
    return found


def results_of(path: Path, study: Study) -> Results:
    """The runs in a folder, to compare a study with. Raises UsageError for a folder without a campaign, for one that is
    not finished, and for runs that share no noise with those of the study: of another system, but for recordings."""
    about = about_of(path)["study"]
    found, runs, system = Results(batches_of(path)), about.get("runs"), about.get("system")
    if not isinstance(runs, int) or not isinstance(system, str):
        raise UsageError(f"{path / ABOUT} is not one of a campaign")
    if len(found) < runs:
        raise UsageError(f"{path} has {len(found)} of its {runs} runs: finish it with --resume")
    recorded = bool(about.get("recording") or "recording" in (about.get("vary") or {}))
    if system != study.system and not (recorded and study.recordings_named):
        shared = f"whose noise is not that of {study.system}: compare two campaigns of one system"
        raise UsageError(f"{path} has runs of {system}, {shared}")
    return found


def batches_of(path: Path) -> Iterator[Batch]:
    """Every whole batch of a folder, in order."""
    for file in sorted((path / "batches").glob("*.json")):
        found = results.read_batch(file)
        if found is not None:
            yield found
