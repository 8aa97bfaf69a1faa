"""Replay a recorded run: the raw counts of a log through a board, and three answers compared step by step: what the
recording says, what the board says, and the integer model.

A step whose counts were lost leaves the steps from there on unverified, because the state after it is unknown; a step
whose digest was lost is itself unverified, the ones after it are not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards import Board
from plumb.errors import UnverifiedError, UsageError
from plumb.inputs import frame_files, recording
from plumb.inputs.log_file import SUFFIX, Log, ParameterSet, read_log
from plumb.inputs.logged_parameters import UsedParameters, changes_of_run, heard_sets, parameters_of_run
from plumb.inputs.logged_runs import LoggedRun, RunFinder
from plumb.link.session import RAW_FRAMES
from plumb.link.used_tables import TableChange
from plumb.proof import runs
from plumb.proof.compare import Divergence
from plumb.proof.report import Statement
from plumb.proof.runs import Run, RunInputs
from plumb.proof.scenario_run import ScenarioRun
from plumb.spec import dbc, declarations
from plumb.spec.records import Words
from plumb.tuning.quantise import Changes

SUFFIXES = (SUFFIX, *frame_files.READ)
"""Files that carry what a board said, and can be reproduced."""


def open_log(path: Path) -> Log:
    """A log of plumb's own, or the frames of another tool's. Raises UsageError."""
    return read_log(path) if path.suffix.lower() == SUFFIX else frame_files.read_frames(path)


def raw_frames_of(system: str) -> tuple[str, ...]:
    """The RAW frames that carry the counts of a system."""
    return RAW_FRAMES[: 1 + (len(declarations.system(system).channels) > 3)]


@dataclass(frozen=True)
class RecordedRun:
    """One run of a log with its parameters. number: from 1; of: how many runs the log holds. changes: of the parameters
    in the middle of the run, as far as they are known. known: number of steps from the first on whose counts, setpoint
    and parameters are all known; unknown_table: the change whose parameters are not."""

    log: Log
    run: LoggedRun
    used: UsedParameters
    number: int
    of: int
    known: int
    changes: Changes = ()
    unknown_table: TableChange | None = None

    @property
    def system(self) -> str:
        return self.used.system

    @property
    def unknown(self) -> str:
        """Why the steps from `known` on cannot be reproduced; "" when all can be."""
        run = self.run
        if self.known == run.steps:
            return ""
        if run.first:
            return f"its beginning is missing: the recording begins at step {run.first}"
        if not run.raw_frames:
            return "the recording carries no raw counts"
        if self.unknown_table is not None and self.unknown_table.step == self.known:
            return self.unknown_table.why_unknown
        if not run.raw_known[self.known]:
            return f"the raw counts of step {self.known} did not arrive"
        return f"the setpoint of step {self.known} did not arrive"


def runs_of(log: Log, given: Mapping[str, int] | None = None) -> list[RecordedRun]:
    """Every run of a log. given: parameters by name, of a file, instead of the log's. Raises UsageError when the log
    has no run, or no parameters."""
    messages = log.protocol()
    finder = RunFinder(log.frames, messages)
    rough = finder.runs(RAW_FRAMES)
    if not rough:
        raise UsageError(f"{log.path.name} holds no step, because no run was in progress: --run live begins one")
    sets = [ParameterSet(0, dict(given))] if given else [*log.parameter_sets, *heard_sets(log.frames, messages)]
    found = []
    for number, run in enumerate(rough, 1):
        used = parameters_of_run(sets, run.at, log.path.name)
        needed = raw_frames_of(used.system)
        whole = (run if needed == RAW_FRAMES else finder.runs(needed)[number - 1]).without_open_end()
        blocks = [] if given else log.parameter_sets
        changes, unknown = changes_of_run(whole, used, blocks, messages)
        known = min(whole.known_until(), whole.steps if unknown is None else unknown.step)
        found.append(RecordedRun(log, whole, used, number, len(rough), known, changes, unknown))
    return found


def chosen(found: Sequence[RecordedRun], number: int | None) -> RecordedRun:
    """The run of that number, or the one of which most is known. Raises UsageError for a number that is not there."""
    if number is None:
        return max(found, key=lambda one: (one.known, one.run.steps))
    if not 1 <= number <= len(found):
        raise UsageError(f"there is no run {number}: {found[0].log.path.name} holds {len(found)}")
    return found[number - 1]


def unknown_truth(system: str, steps: int) -> dict[str, npt.NDArray[np.float64]]:
    """The truth behind a recording, by the names of the system: not known."""
    module = systems.load(system)
    names = module.scenario(
        module.DEFAULT_SCENARIO, 0, seconds=None, period_us=module.PERIOD_US, faults=module.faults([])
    ).truth()
    return {name: np.full(steps, np.nan) for name in names}


@dataclass(frozen=True)
class Reproduction(ScenarioRun):
    """A recorded run on a board. recorded: the run; differ: steps whose recorded digest is not the model's; divergence:
    the first of them."""

    recorded: RecordedRun
    differ: int
    divergence: Divergence | None

    @property
    def compared(self) -> int:
        """Recorded digests that were compared with the model."""
        return int(np.count_nonzero(self.recorded.run.digest_known[: self.recorded.known]))

    @property
    def unverified_from(self) -> int | None:
        """The first step that was not verified."""
        recorded = self.recorded
        missing = np.flatnonzero(~recorded.run.digest_known[: recorded.known])
        ends = [int(step) for step in missing[:1]] + ([recorded.known] if recorded.known < recorded.run.steps else [])
        if self.doubtful and self.divergence is not None:
            ends.append(self.divergence.step)
        if self.run.answer.unverified_from is not None:
            ends.append(self.run.answer.unverified_from)
        return min(ends, default=None)

    @property
    def doubtful(self) -> bool:
        """Whether a difference may come from a lost frame: a setpoint may have been among the lost ones."""
        return self.recorded.run.lost > 0

    @property
    def verdict(self) -> str:
        if self.run.mismatches or (self.divergence is not None and not self.doubtful):
            return "fail"
        return "pass" if self.unverified_from is None else "unverified"

    def statement(self) -> Statement:
        """What the recording says beside board and model."""
        recorded, from_step = self.recorded, self.unverified_from
        if self.divergence is not None and not self.doubtful:
            text = f"{self.differ} of {self.compared} recorded digests differ from the model; the first at "
            return Statement("recorded", f"{text}{self.divergence}", False)
        if from_step is None:
            across = f", across {len(self.run.changes)} changes of parameters" if self.run.changes else ""
            text = f"every one of the {self.compared} recorded digests is reproduced{across}"
            return Statement("recorded", text, True)
        why = recorded.unknown
        if self.divergence is not None and from_step == self.divergence.step:
            why = f"step {from_step} differs from the model, and frames were lost, perhaps a setpoint"
        elif from_step == self.run.answer.unverified_from:
            why = self.run.answer.why
        elif from_step < recorded.known:
            why = f"the digest of step {from_step} did not arrive"
        same = f"{self.compared - self.differ} recorded digests are reproduced; "
        return Statement("recorded", f"{same}unverified from step {from_step} on: {why}", None)

    def summary(self, **changed: Any) -> dict[str, Any]:  # Any: as ScenarioRun.summary, which it extends
        """What `replay --json` prints: that of a run, with the verdict over the recording, too."""
        said = super().summary(**changed)
        of_recording: dict[str, object] = {
            "run": self.recorded.number,
            "runs": self.recorded.of,
            "steps": self.recorded.run.steps,
            "first_step": self.recorded.run.first,
            "compared": self.compared,
            "mismatches": self.differ,
            "unverified_from_step": self.unverified_from,
        }
        if self.run.changes:
            of_recording["parameters_changed_at_steps"] = [change.step for change in self.run.changes]
        if self.divergence is not None:
            of_recording["first_divergence"] = self.divergence.as_dict()
        exact = {"pass": True, "fail": False}.get(self.verdict)
        return {**said, "verdict": self.verdict, "bit_exact": exact, "recorded": of_recording}


def reproduce(recorded: RecordedRun, board: Board, name: str, link: str | None, seconds: float | None) -> Reproduction:
    """Run the recorded counts on a board. name, link: of the board, for the summary; seconds: of the beginning only.

    Raises UsageError for a run of which no step is known.
    """
    params = recorded.used.params
    if seconds is not None:
        most = recording.steps_in(seconds, round(params.period_s * 1e6), recorded.run.steps)
        recorded = replace(recorded, run=recorded.run.first_steps(most), known=min(recorded.known, most))
    steps = recorded.known
    if not steps:
        raise UnverifiedError(f"run {recorded.number} cannot be reproduced: {recorded.unknown}")
    raw, setpoint = recorded.run.raw[:steps], recorded.run.setpoint[:steps]
    inputs = RunInputs(
        np.arange(steps, dtype=np.float64) * params.period_s,
        unknown_truth(params.system, steps),
        raw,
        setpoint,
        np.zeros(steps, np.bool_),
    )
    changes = tuple(change for change in recorded.changes if change.step < steps)
    result = runs.open_loop(board, inputs, params, changes)
    differ, divergence = _compare(recorded.run, result, steps)
    log = recorded.log
    heading = {
        "system": params.system,
        "scenario": log.path.name if recorded.of == 1 else f"{log.path.name} run {recorded.number}",
        "tuning": "recorded",
        "loop": "open",
        "board": name,
        "link": link,
        "seed": None,
        "warnings": log.warnings,
    }
    return Reproduction(result, heading, recorded, differ, divergence)


def _compare(recorded: LoggedRun, result: Run, steps: int) -> tuple[int, Divergence | None]:
    """Number of steps whose recorded digest differs from the model's, and the first of them."""
    expected = result.words.digests()
    differs = np.flatnonzero(recorded.digest_known[:steps] & (recorded.digest[:steps] != expected))
    if not len(differs):
        return 0, None
    step = int(differs[0])
    known = Divergence(step, 0, "digest", int(expected[step]), int(recorded.digest[step]))
    return len(differs), _first_signal(recorded, result.words, step) or known


def _first_signal(recorded: LoggedRun, words: Words, step: int) -> Divergence | None:
    """The first recorded signal of a step that is not what its word says; None when all agree, or none was recorded."""
    system = declarations.system(words.system)
    for frame in system.frames:
        for part, bits in ((frame.half, 16), (frame.word, 32)):
            if part is None:
                continue
            values, came = recorded.values.get((dbc.frame_name(system, frame), part.name), (None, None))
            if values is None or came is None or not came[step]:
                continue
            expected = int(words[part.word.name][step]) >> part.shift
            signed = part.word.type.startswith("int")
            if bits == 16:
                low, high = (-(1 << 15), (1 << 15) - 1) if signed else (0, (1 << 16) - 1)
                expected = min(max(expected, low), high)
            if expected & (1 << bits) - 1 != int(values[step]) & (1 << bits) - 1:
                return Divergence(step, 0, part.name, expected, int(values[step]))
    return None
