"""`plumb.load` of a log: a recorded run of a board as arrays in units, and its replay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from plumb.api.recordings import Recording
from plumb.api.signals import ReceivedArrays
from plumb.boards.contract import StepBoard
from plumb.errors import UsageError
from plumb.proof.scenario_run import ScenarioRun
from plumb.readers import log_replay, recording
from plumb.readers.log_replay import RecordedRun
from plumb.readers.step_table import table_of
from plumb.readers.table_column import Column
from plumb.spec.arrays import FloatArray
from plumb.tuning import quantities
from plumb.tuning.quantities import Value

_NO_SIGNALS = ("time_s", "step", "digest", "armed")


@dataclass(frozen=True)
class LoggedRun(Recording):
    """One run of a board, N steps, from a log. Of the sensors' axes, those that the system does not measure are NaN;
    `movement` is true everywhere, `truth` None.

    Attributes:
        system: The system that ran.
        step: Numbers of the steps, (N,); `time_s` counts their periods from the beginning of the run.
        digest: CRC-32 of the words of each step, (N,), 0 where it did not arrive.
        armed: Steps during which the board was armed, (N,) bool.
        signals: Every signal by name with unit, (N,) float64: raw counts, sensors in units, the signals of the system,
            motors and sticks in per cent. Those that the link had no room for are calculated from the raw counts; NaN
            where a value did not arrive and cannot be calculated. A mapping; the names in SI work, too, every name is
            an attribute as well, and an attitude has roll, pitch and yaw (plumb.api.signals).
        units: The unit of each signal; "" for a number without one.
        parameters: The parameters at the beginning of the run, in units, as `board.params` names them.
        changes: For each step from which on the run had other parameters, what changed, in units.
        known: Number of steps from the first on that a replay can reproduce.
        run: Number of the run in the log, from 1.
        runs: How many runs the log holds.
        warnings: What is wrong with the file, a sentence each.
    """

    system: str
    step: npt.NDArray[np.int64]
    digest: npt.NDArray[np.uint32]
    armed: npt.NDArray[np.bool_]
    signals: ReceivedArrays
    units: dict[str, str]
    parameters: dict[str, Value]
    changes: dict[int, dict[str, Value]]
    known: int
    run: int
    runs: int
    warnings: list[str]
    _recorded: RecordedRun = field(repr=False, compare=False)

    def _prepared(
        self, system: str | None, axis: Literal["x", "y", "z"], period_s: float | None, seconds: float | None
    ) -> Callable[[StepBoard, str, str | None], ScenarioRun]:
        if system not in (None, self.system):
            raise UsageError(f"{self.path.name} is of {self.system}, not of {system}")
        if period_s is not None or axis != "x":
            raise UsageError("axis and period_s are for recordings in units: a log is replayed as it was recorded")
        return lambda opened, board, link: log_replay.reproduce(self._recorded, opened, board, link, seconds)


def load_run(path: Path, number: int | None, params: Path | None) -> LoggedRun:
    """A run of a log, or of a file of frames that carries raw counts. number: of the run; None: the one of which most
    is known. params: file of `plumb params dump`, where the frames do not carry the parameters."""
    from plumb.spec import parameter_file

    given = None if params is None else parameter_file.read(params).values
    log = log_replay.open_log(path)
    recorded = log_replay.chosen(log_replay.runs_of(log, given), number)
    columns = {column.name: column for column in table_of(recorded) if not column.texts}
    run, steps = recorded.run, recorded.run.steps
    signals = {name: _floats(column) for name, column in columns.items() if name not in _NO_SIGNALS}
    return LoggedRun(
        path=path,
        time_s=np.asarray(columns["time_s"].values, np.float64),
        gyr_radps=np.radians(_axes(signals, "gyr", "dps", steps)),
        acc_mps2=_axes(signals, "acc", "g", steps) * recording.G_MPS2,
        truth=None,
        movement=np.ones(steps, np.bool_),
        system=recorded.system,
        step=np.asarray(columns["step"].values, np.int64),
        digest=run.digest,
        armed=run.armed,
        signals=ReceivedArrays(recorded.system, signals),
        units={name: columns[name].unit for name in signals},
        parameters=_values(recorded.used.table),
        changes=_changes(recorded),
        known=recorded.known,
        run=recorded.number,
        runs=recorded.of,
        warnings=log.warnings,
        _recorded=recorded,
    )


def _floats(column: Column) -> FloatArray:
    values = np.asarray(column.values, np.float64)
    return values if column.known is None else np.where(column.known, values, np.nan)


def _axes(signals: dict[str, FloatArray], sensor: str, unit: str, steps: int) -> FloatArray:
    missing = np.full(steps, np.nan)
    return np.stack([signals.get(f"{sensor}_{axis}_{unit}", missing) for axis in "xyz"], 1)


def _values(table: dict[str, int]) -> dict[str, Value]:
    """The table in units; {} for one of another version, or that stands for no tuning."""
    try:
        return dict(quantities.values_of(table))
    except (UsageError, KeyError):
        return {}


def _changes(recorded: RecordedRun) -> dict[int, dict[str, Value]]:
    before, found = _values(recorded.used.table), dict[int, dict[str, Value]]()
    for change in recorded.changes:
        now = _values({**recorded.used.table, **change.params.values})
        found.setdefault(change.step, {}).update({n: value for n, value in now.items() if before.get(n) != value})
        before = now
    return found
