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
from plumb.boards.contract import StepBoard
from plumb.contract.parameters import Changes
from plumb.errors import UnverifiedError, UsageError, counted
from plumb.link.frame_formats import table
from plumb.link.selection import raw_frames_of
from plumb.link.used_tables import TableChange
from plumb.proof import runs
from plumb.proof.compare import Divergence
from plumb.proof.report import Statement
from plumb.proof.runs import Run, RunInputs
from plumb.proof.scenario_run import ScenarioRun
from plumb.readers import frame_files, recording
from plumb.readers.log_file import MAGIC, SUFFIX, Log, ParameterSet, read_log
from plumb.readers.logged_parameters import (
    ParametersInUse,
    UsedParameters,
    changes_of_run,
    of_another_version,
    received_sets,
)
from plumb.readers.logged_runs import LoggedRun, Steps, runs_in
from plumb.readers.recorded_digests import Compared, LongReplay, replay_long
from plumb.spec.protocol import FRAME_DLC, Protocol, check


def is_log(path: Path) -> bool:
    """Whether a file carries what a board said, and can be reproduced: by its content, and by its suffix when the
    content says nothing."""
    return _is_own(path) or table.may_be(path)


def _is_own(path: Path) -> bool:
    return table.head_of(path).startswith(f"{MAGIC}\n".encode()) or path.suffix.lower() == SUFFIX


def open_log(path: Path) -> Log:
    """A log of plumb's own, or the frames of another tool's. Raises UsageError."""
    own = _is_own(path) and table.format_of(path) is None
    return read_log(path) if own else frame_files.read_frames(path)


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
        if self.unknown_table is not None and max(self.unknown_table.step, 0) == self.known:
            return self.unknown_table.why_unknown
        if run.raw_missing == self.known:
            return f"the raw counts of step {self.known} did not arrive"
        return f"the setpoint of step {self.known} did not arrive"


def runs_of(log: Log, given: Mapping[str, int] | None = None) -> list[RecordedRun]:
    """Every run of a log. given: parameters by name, of a file, instead of the log's. Raises UsageError when the log
    has no run, or no parameters."""
    messages = log.protocol()
    sets = [ParameterSet(0, dict(given))] if given else [*log.parameter_sets, *received_sets(log.blocks(), messages)]
    listed = [] if given else log.parameter_sets
    other = "" if sets else of_another_version(log.blocks(), messages)
    if other:
        raise UsageError(f"{log.path.name} cannot be reproduced: {other}")

    used_at = ParametersInUse(sets, log.path.name).at

    def needed_at(at: int) -> tuple[str, ...]:
        return raw_frames_of(used_at(at).system)

    runs = runs_in(log.blocks, messages, needed_at, [one.at for one in listed])
    if not runs:
        raise UsageError(_why_no_run(log, messages))
    found = []
    for number, run in enumerate(runs, 1):
        used = used_at(run.at)
        changes, unknown = changes_of_run(run, used, listed, messages)
        known = min(run.known_until(), run.steps if unknown is None else max(unknown.step, 0))
        found.append(RecordedRun(log, run, used, number, len(runs), known, changes, unknown))
    return found


CHANCE = 16
"""One in 256 foreign frames has the CRC of plumb's by chance: frames are plumb's when it fits more than one in 16 of
those with its identifiers."""


def _why_no_run(log: Log, messages: Protocol) -> str:
    """Why no step is in the frames: they are not plumb's, or no run was in progress."""
    known = list(messages.by_identifier)
    alike = ours = 0
    for block in log.blocks():
        for _, can_id, length, _, data in block[np.isin(block["can_id"], known)].tolist():
            alike += 1
            ours += length == FRAME_DLC and check(can_id, bytes(data))
        if ours * CHANCE > alike:
            return f"{log.path.name} holds no step, because no run was in progress: --run live begins one"
    of, no = log.path.name, f"none of the {counted(log.count, 'frame')} of {log.path.name} is"
    no = f"the one frame of {of} is not" if log.count == 1 else no
    return f"{no} plumb's: record the bus of a plumb board, at its bit rate"


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


DETAIL_STEPS = 1 << 15
"""Steps, from the first on, that metrics and report of a longer run cover: a minute at 500 Hz. The digests
of all steps are compared."""


@dataclass(frozen=True)
class Reproduction(ScenarioRun):
    """A recorded run on a board. recorded: the run; digests: those of the recording compared with those of the model;
    changes: of the parameters; long: for a run of more than DETAIL_STEPS, the board compared with the model."""

    recorded: RecordedRun
    digests: Compared
    changes: Changes = ()
    long: LongReplay | None = None

    @property
    def differ(self) -> int:
        """Steps whose recorded digest is not the model's."""
        return self.digests.differ

    @property
    def divergence(self) -> Divergence | None:
        """The first of them."""
        return self.digests.divergence

    @property
    def compared(self) -> int:
        """Recorded digests that were compared with the model."""
        return self.digests.compared

    @property
    def board_differs(self) -> int:
        """Steps whose digest on the board is not the model's."""
        return self.run.mismatches if self.long is None else self.long.board.differ

    @property
    def board_until(self) -> int | None:
        """The first step that the board did not run, or whose answer was lost."""
        return self.run.answer.unverified_from if self.long is None else self.long.board_until

    @property
    def unverified_from(self) -> int | None:
        """The first step that was not verified."""
        recorded = self.recorded
        ends = [recorded.known] if recorded.known < recorded.run.steps else []
        if recorded.run.digest_missing is not None and recorded.run.digest_missing < recorded.known:
            ends.append(recorded.run.digest_missing)
        if self.doubtful and self.divergence is not None:
            ends.append(self.divergence.step)
        if self.board_until is not None:
            ends.append(self.board_until)
        return min(ends, default=None)

    @property
    def doubtful(self) -> bool:
        """Whether a difference may come from a lost frame: a setpoint may have been among the lost ones."""
        return self.recorded.run.lost > 0

    @property
    def verdict(self) -> str:
        if self.board_differs or (self.divergence is not None and not self.doubtful):
            return "fail"
        return "pass" if self.unverified_from is None else "unverified"

    def statement(self) -> Statement:
        """How the recording compares with board and model."""
        recorded, from_step = self.recorded, self.unverified_from
        if self.divergence is not None and not self.doubtful:
            text = f"{self.differ} of {self.compared} recorded digests differ from the model; the first at "
            return Statement("recorded", f"{text}{self.divergence}", False)
        if from_step is None:
            across = f", across {len(self.changes)} changes of parameters" if self.changes else ""
            across += self._of_board()
            text = f"every one of the {self.compared} recorded digests is reproduced{across}"
            return Statement("recorded", text, True)
        why = recorded.unknown
        if self.divergence is not None and from_step == self.divergence.step:
            why = f"step {from_step} differs from the model, and frames were lost, perhaps a setpoint"
        elif from_step == self.board_until:
            why = self.run.answer.why if self.long is None else self.long.why
        elif from_step < recorded.known:
            why = f"the digest of step {from_step} did not arrive"
        same = f"{self.compared - self.differ} recorded digests are reproduced; "
        return Statement("recorded", f"{same}unverified from step {from_step} on: {why}{self._of_board()}", None)

    def _of_board(self) -> str:
        """Results of the board in a long run after the steps of the report."""
        if self.long is None:
            return ""
        board = self.long.board
        if board.divergence is not None:
            return f"; {board.differ} of {board.compared} steps of the board differ, the first at {board.divergence}"
        return f"; the board equals the model in {board.compared} steps; metrics and report are of {DETAIL_STEPS} steps"

    def summary(self, **changed: Any) -> dict[str, Any]:  # Any: as ScenarioRun.summary, which it extends
        """The output of `replay --json`: that of a run, with the verdict over the recording, too."""
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
        if self.changes:
            of_recording["parameters_changed_at_steps"] = [change.step for change in self.changes]
        if self.divergence is not None:
            of_recording["first_divergence"] = self.divergence.as_dict()
        exact = {"pass": True, "fail": False}.get(self.verdict)
        if self.long is not None:
            of_recording["board_steps"], of_recording["board_mismatches"] = self.long.board.compared, self.board_differs
            said |= {"steps": self.recorded.known, "metrics_of_steps": DETAIL_STEPS}
        return {**said, "verdict": self.verdict, "bit_exact": exact, "recorded": of_recording}


def reproduce(
    recorded: RecordedRun, board: StepBoard, name: str, link: str | None, seconds: float | None
) -> Reproduction:
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
    changes = tuple(change for change in recorded.changes if change.step < steps)
    result, begin = _begin_of(recorded, min(steps, DETAIL_STEPS), board)
    if steps > DETAIL_STEPS:
        long = replay_long(recorded.run, steps, params, changes, board)
        compared = long.recorded
    else:
        long, compared = None, Compared()
        compared.recorded(begin, result.words)
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
    return Reproduction(result, heading, recorded, compared, changes, long)


def _begin_of(recorded: RecordedRun, steps: int, board: StepBoard) -> tuple[Run, Steps]:
    """The first steps of a recorded run on a board, with the words of all of them."""
    params, begin = recorded.used.params, recorded.run.first_steps(steps).together
    inputs = RunInputs(
        np.arange(steps, dtype=np.float64) * params.period_s,
        unknown_truth(params.system, steps),
        begin.raw,
        begin.setpoint,
        np.zeros(steps, np.bool_),
    )
    changes = tuple(change for change in recorded.changes if change.step < steps)
    return runs.open_loop(board, inputs, params, changes), begin
