"""A run of a campaign on a recording of real sensors, instead of on a scenario.

Without a grade it has the counts and the parameters of `plumb replay`; with one, those of `plumb compare --grade`.
"""

from __future__ import annotations

import hashlib
import os
import shlex
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from plumb import systems
from plumb.analyses.comparison.contenders import COMPARE
from plumb.analyses.comparison.grades import GRADES
from plumb.analyses.comparison.samples import DECIMATIONS, motion_of
from plumb.audit import audited_files
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.near_names import did_you_mean
from plumb.proof.runs import RunInputs
from plumb.readers import recording
from plumb.readers.recording import Recording
from plumb.readers.replay import REPLAY, ReplayRequest
from plumb.spec.tuning import AnyTuning

DATA = "PLUMB_DATA"
"""Environment variable: the folder of recordings, where a study names none."""


@dataclass(frozen=True)
class RecordedRequest:
    """grade: whose errors are added, as `plumb compare` names them, drawn from the seed; None: none. seconds: only so
    much of the beginning. decimate: means of blocks of so many samples. tuning: None for that of a replay. as_found:
    what an audit is sure of is undone first."""

    system: str
    file: Path
    seed: int
    grade: str | None = None
    seconds: float | None = None
    decimate: int = 1
    tuning: AnyTuning | None = None
    as_found: bool = False

    def command(self) -> str | None:
        """The command line that gives this run; None where no other command gives it."""
        if self.grade is not None or self.tuning is not None:
            return None
        words = ["plumb", "replay", str(self.file), "--system", self.system, "--board", "native"]
        words += ["--seconds", f"{self.seconds:g}"] if self.seconds is not None else []
        words += ["--as-found"] if self.as_found else []
        return shlex.join([*words, *(["--decimate", str(self.decimate)] if self.decimate > 1 else [])])


def folder(named: str | None, study: str | None) -> Path:
    """The folder of the recordings: named, seen from the folder of the study's file, else that of PLUMB_DATA. Raises
    UsageError where there is none."""
    given = named if named is not None else os.environ.get(DATA)
    if not given:
        raise UsageError(
            f"the study names recordings and no folder: give recordings = 'FOLDER', or set {DATA} to the folder"
        )
    path = Path(given) if named is None or study is None else Path(study).parent / given
    if not path.is_dir():
        by = f" ({DATA})" if named is None else ""
        raise UsageError(f"there is no folder {path}{by}: name the one that has the recordings")
    return path


def check(request: RecordedRequest) -> None:
    """Raises UsageError for what is wrong whatever the recording has in it."""
    systems.load(request.system, REPLAY if request.grade is None else COMPARE)
    if not request.file.is_file():
        held = sorted(one.name for one in request.file.parent.glob("*") if one.suffix in (".npz", ".csv"))
        near = did_you_mean(request.file.name, held)
        raise UsageError(f"there is no recording {request.file.name} in {request.file.parent}{near}")
    if request.decimate not in DECIMATIONS:
        raise UsageError(f"decimate = {request.decimate}: it is {', '.join(map(str, DECIMATIONS))}")
    if request.grade is None:
        return
    if request.grade not in GRADES:
        raise UsageError(f"there is no grade '{request.grade}'; there are {', '.join(GRADES)}")
    if GRADES[request.grade].window_s is not None:
        raise UsageError(f"grade '{request.grade}' makes several runs of a recording: `plumb compare` has it")


@lru_cache(maxsize=8)
def _recording(path: Path, as_found: bool) -> Recording:
    return audited_files.recording_of(path, audited_files.audited(path), True) if as_found else recording.load(path)


@lru_cache(maxsize=8)
def _sha256(path: Path, size: int, changed_ns: int) -> str:
    """SHA-256 of a file, read again when its size or its time has changed."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def content_sha256(paths: list[Path]) -> str:
    """SHA-256 of the recordings of a study: other content gives another campaign. Raises UsageError for one that is not
    there."""
    parts = []
    for path in paths:
        try:
            about = path.stat()
            parts.append(_sha256(path, about.st_size, about.st_mtime_ns))
        except OSError:
            raise UsageError(f"there is no recording {path.name} in {path.parent}") from None
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def inputs_of(request: RecordedRequest) -> tuple[RunInputs, ControlParams]:
    """Inputs and parameters of the run. Raises UsageError for a recording that the system cannot run on."""
    check(request)
    if request.grade is None:
        asked = ReplayRequest(
            request.file,
            seconds=request.seconds,
            decimate=request.decimate,
            tuning=request.tuning,
            loaded=_recording(request.file, request.as_found),
        )
        inputs, params, _ = systems.load(request.system, REPLAY).inputs_of(asked)
        return inputs, params
    part = systems.load(request.system, COMPARE)
    (samples,) = GRADES[request.grade].samples(
        motion_of(_recording(request.file, request.as_found)), request.seed, request.decimate
    )
    if request.seconds is not None:
        steps = recording.steps_in(request.seconds, samples.period_us, len(samples.counts))
        samples = samples.first(steps)
    return part.inputs(samples), part.params(samples, request.tuning)
