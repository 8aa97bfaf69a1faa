"""Write the steps of a recorded run in the columns of blackbox_decode, for the viewers of flight controllers' logs.

What the link did not carry is calculated from the raw counts by the integer model, and the digests of the recording say
that it is what the board had.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from plumb import systems
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.readers.log_replay import RecordedRun
from plumb.readers.recorded_digests import BAR_STEPS, pieces_between
from plumb.readers.run_parts import Steps
from plumb.spec import declarations
from plumb.spec.records import Words
from plumb.systems.blackbox import BLACKBOX, COLUMNS, Cells
from plumb.tuning.channels import NO_SAMPLE, values_of

ACC_COUNTS_PER_G = 2048.0
SENSORS = {"gyr": ("gyroUnfilt", 1.0), "acc": ("accSmooth", ACC_COUNTS_PER_G)}
"""Sensor of a channel's axis -> its column, and the scale from deg/s or g."""
DIGITS = 3


def require(recorded: RecordedRun) -> None:
    """Raises UsageError for a run that cannot be written so."""
    systems.load(recorded.system, BLACKBOX)
    if recorded.unknown:
        raise UsageError(f"a blackbox CSV needs every step of the run from its beginning: {recorded.unknown}")


def write(recorded: RecordedRun, path: Path) -> None:
    """One row a step. Raises UsageError for a run that cannot be written so, or whose digests are not the model's."""
    from tqdm import tqdm

    require(recorded)
    steps = recorded.run.steps
    hidden = None if steps > BAR_STEPS else True
    with (
        path.open("w", newline="", encoding="utf-8") as file,
        tqdm(total=steps, desc="blackbox", unit="step", leave=False, disable=hidden) as bar,
    ):
        table, header = csv.writer(file, lineterminator="\n"), False
        for columns in _tables(recorded):
            if not header:
                table.writerow(columns)
                header = True
            table.writerows(zip(*map(_text, columns.values()), strict=True))
            bar.update(len(columns["loopIteration"]))


def _tables(recorded: RecordedRun) -> Iterator[dict[str, Cells]]:
    """The columns of the run, piece by piece."""
    run, params, left = recorded.run, recorded.used.params, list(recorded.changes)
    period_us = params.period_s * 1e6
    model, sensors = run_fixed.Controller(params), _Sensors(params)
    before: Words | None = None
    for part in run.parts():
        counts, setpoints = run_fixed.check_inputs(params.system, part.raw, part.setpoint)
        for piece in pieces_between(part, left):
            if isinstance(piece, ControlParams):
                model.retune(piece)
                params = piece
                continue
            words = model.run(counts[piece], setpoints[piece])
            if not len(words.record):
                continue
            _compare(part, piece, words)
            earlier = np.zeros_like(words.record[:1]) if before is None else before.record[-1:]
            steps = part.first + np.arange(len(part), dtype=np.int64)[piece]
            columns: dict[str, Cells] = {
                "loopIteration": steps,
                "time (us)": np.rint(steps * period_us).astype(np.int64),
                **sensors.columns(words, params),
                **systems.load(recorded.system, BLACKBOX).columns(
                    words, Words(np.concatenate([earlier, words.record[:-1]])), params
                ),
            }
            before = words
            yield {name: columns[name] for name in COLUMNS if name in columns}


def _compare(part: Steps, piece: slice, words: Words) -> None:
    differs = part.digest_known[piece] & (words.digests() != part.digest[piece])
    if differs.any():
        step = part.first + (piece.start or 0) + int(np.argmax(differs))
        raise UsageError(
            f"step {step} of the recording is not what the integer model makes of its counts: "
            "`plumb replay` says where they part"
        )


class _Sensors:
    """The calibrated counts as columns. A step without a sample has the values of the last one, 0 when there was
    none."""

    def __init__(self, params: ControlParams) -> None:
        self._declared = declarations.system(params.system)
        self._held: dict[str, float] = {}

    def columns(self, words: Words, params: ControlParams) -> dict[str, Cells]:
        found: dict[str, Cells] = {}
        for index, channel in enumerate(self._declared.channels):
            axis = channel.axis.removeprefix("-")
            values = values_of(params, channel, counts := words[f"raw_{index}"])
            if axis[:3] not in SENSORS or values is None:
                continue
            column, scale = SENSORS[axis[:3]]
            name, sign = f"{column}[{'xyz'.index(axis[-1])}]", -1.0 if channel.axis.startswith("-") else 1.0
            lacks = (counts == NO_SAMPLE) & (self._declared.missing_samples == "marked")
            last = np.maximum.accumulate(np.where(lacks, -1, np.arange(len(counts))))
            held = np.where(last < 0, self._held.get(name, 0.0), sign * scale * values[last])
            self._held[name] = float(held[-1])
            found[name] = held
        return found


def _text(values: Cells) -> list[str]:
    if values.dtype.kind == "f":
        return [f"{value:.{DIGITS}f}" for value in values.tolist()]
    return [str(value) for value in values.tolist()]
