"""Results of a campaign as columns, one entry a run: joined from batches, kept as JSON, Parquet or CSV."""

from __future__ import annotations

import csv
import dataclasses
import importlib
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from plumb.campaign.batch import Batch
from plumb.campaign.violated import Violated
from plumb.errors import UsageError
from plumb.extras import required
from plumb.spec.arrays import FloatArray

COLUMNS = ("index", "seed", "steps", "digest", "error")
"""Columns of every campaign, before its factors and its metrics."""
CONFIRMED = "confirmed_mismatches"
"""Metric: steps of a run that another board gives otherwise."""


class Results:
    """Runs of a campaign in the order of their indices. metrics: (runs,) each, NaN where a run has no such figure.
    values: of the factors, a list entry a run. violations: of the invariants, in the order of the runs."""

    def __init__(self, batches: Iterable[Batch]) -> None:
        ordered = sorted(batches, key=lambda batch: batch.index[0] if batch.index else 0)
        self.index = np.array([one for batch in ordered for one in batch.index], np.int64)
        self.seed = np.array([one for batch in ordered for one in batch.seed], np.int64)
        self.steps = np.array([one for batch in ordered for one in batch.steps], np.int64)
        self.digest = [one for batch in ordered for one in batch.digest]
        self.error = [one for batch in ordered for one in batch.error]
        self.violations = [one for batch in ordered for one in batch.violations]
        self.values: dict[str, list[Any]] = _joined(  # Any: by column
            ordered, [batch.values for batch in ordered]
        )
        figures = _joined(ordered, [batch.metrics for batch in ordered])
        self.metrics: dict[str, FloatArray] = {
            name: np.array([np.nan if one is None else one for one in column], np.float64)
            for name, column in figures.items()
        }

    def __len__(self) -> int:
        return len(self.index)

    @property
    def failed(self) -> list[int]:
        """Places of the runs that failed."""
        return [place for place, error in enumerate(self.error) if error is not None]

    @property
    def differing(self) -> list[int]:
        """Places of the runs of which another board gives a step otherwise."""
        return [int(place) for place in np.flatnonzero(self.metrics.get(CONFIRMED, np.zeros(0)) > 0.0)]

    def columns(self) -> dict[str, Any]:  # Any: columns of several types
        """Every column by name."""
        given: dict[str, Any] = {name: getattr(self, name) for name in COLUMNS}  # Any: columns of several types
        return {**given, **{name: _texts(column) for name, column in self.values.items()}, **self.metrics}

    def rows(self) -> Iterator[dict[str, Any]]:  # Any: columns of several types
        """The runs, one after the other, as plain values; None where there is no figure."""
        columns = {
            name: column.tolist() if isinstance(column, np.ndarray) else column
            for name, column in self.columns().items()
        }
        for row in zip(*columns.values(), strict=True):
            yield {
                name: None if isinstance(one, float) and one != one else one
                for name, one in zip(columns, row, strict=True)
            }

    def to_pandas(self) -> Any:  # Any: pandas has no types of its own
        """A DataFrame; raises UsageError where pandas is not installed."""
        try:
            pandas = importlib.import_module("pandas")
        except ImportError:
            raise UsageError("a DataFrame needs the package pandas; the arrays of the table need none") from None
        return pandas.DataFrame(self.columns())


def _joined(
    batches: list[Batch],
    columns: list[Mapping[str, list[Any]]],  # Any: by column
) -> dict[str, list[Any]]:  # Any: columns of several types
    names = dict.fromkeys(name for one in columns for name in one)
    return {
        name: [
            value
            for batch, one in zip(batches, columns, strict=True)
            for value in one.get(name, [None] * len(batch.index))
        ]
        for name in names
    }


def _texts(column: list[Any]) -> list[Any]:  # Any: columns of several types
    """Lists of faults as one text each."""
    return [", ".join(one) if isinstance(one, list) else one for one in column]


def batch_bytes(batch: Batch) -> bytes:
    return json.dumps(dataclasses.asdict(batch), separators=(",", ":")).encode()


def read_batch(path: Path) -> Batch | None:
    """A batch from its file; None for a file that is not whole."""
    try:
        kept = json.loads(path.read_bytes())
        batch = Batch(**{**kept, "violations": [Violated(**one) for one in kept["violations"]]})
        return batch if _is_whole(batch) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _is_whole(batch: Batch) -> bool:
    """Whether a batch that a file gave has one entry of the right kind for each run. Raises AttributeError or TypeError
    for one that has no columns at all."""
    own: list[tuple[list[Any], type]] = [  # Any: whatever the file has
        (batch.index, int), (batch.seed, int), (batch.steps, int),
        ([one for one in batch.digest if one is not None], int), ([one for one in batch.error if one is not None], str),
    ]  # fmt: skip
    metrics = [(one is None or isinstance(one, int | float)) for column in batch.metrics.values() for one in column]
    columns = (batch.seed, batch.steps, batch.digest, batch.error, *batch.values.values(), *batch.metrics.values())
    return (
        isinstance(batch.identity, dict)
        and all(isinstance(one, kind) for column, kind in own for one in column)
        and all(metrics)
        and all(one.is_whole() and one.index in batch.index for one in batch.violations)
        and all(isinstance(column, list) and len(column) == len(batch.index) for column in columns)
    )


def csv_text(results: Results) -> str:
    sink = io.StringIO()
    table = csv.writer(sink, lineterminator="\n")
    table.writerow(list(results.columns()))
    for row in results.rows():
        table.writerow(["" if one is None else one for one in row.values()])
    return sink.getvalue()


def parquet_bytes(results: Results, about: Mapping[str, object]) -> bytes:
    """The runs as a Parquet file. about: identity and study, kept as JSON in the file's metadata under `plumb`. Raises
    UsageError where pyarrow is not installed."""
    arrow = required("pyarrow", "pyarrow", "Parquet", "campaign")
    parquet = required("pyarrow.parquet", "pyarrow", "Parquet", "campaign")
    columns = {
        name: arrow.array(column, from_pandas=True) if isinstance(column, np.ndarray) else arrow.array(column)
        for name, column in results.columns().items()
    }
    table = arrow.table(columns).replace_schema_metadata({"plumb": json.dumps(about)})
    sink = arrow.BufferOutputStream()
    parquet.write_table(table, sink)
    return bytes(sink.getvalue().to_pybytes())
