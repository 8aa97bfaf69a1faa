"""Write a recording in the formats of other tools; the suffix names the format.

.csv .parquet                the steps of one run: units in the names of the columns, time in s
.blf .asc .log .trc .mf4     every frame; .mf4 also has the signals of the run in units, and the DBC
.html                        the report: the signals over time, and what they were recorded with
.dbc .json                   the DBC of the frames; identity and parameters
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import can
import numpy as np

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.files import whole_files
from plumb.files.block_file import exists_sentence
from plumb.link import foreign_frames, frame_records
from plumb.readers.log_file import ERROR, EXTENDED, REMOTE, Log
from plumb.readers.log_replay import RecordedRun
from plumb.readers.step_table import table_of, tables_of
from plumb.readers.table_column import Column
from plumb.spec import dbc
from plumb.writers import blackbox_csv, record_report

if TYPE_CHECKING:
    from asammdf import Signal

FRAMES = (".blf", ".asc", ".log", ".trc")
STEPS = (".csv", ".parquet", ".html")
MF4_FRAME = np.dtype(
    [
        ("CAN_DataFrame.BusChannel", "<u1"),
        ("CAN_DataFrame.ID", "<u4"),
        ("CAN_DataFrame.IDE", "<u1"),
        ("CAN_DataFrame.DLC", "<u1"),
        ("CAN_DataFrame.DataLength", "<u1"),
        ("CAN_DataFrame.DataBytes", "(64,)u1"),
        ("CAN_DataFrame.Dir", "<u1"),
        ("CAN_DataFrame.EDL", "<u1"),
        ("CAN_DataFrame.BRS", "<u1"),
        ("CAN_DataFrame.ESI", "<u1"),
    ]
)
"""A frame as ASAM's bus logging has it."""
FORMATS = (*STEPS, *FRAMES, ".mf4", ".dbc", ".json")
BAR_ROWS = 1 << 18
"""With more rows, writing a table shows a progress bar."""


def require(paths: Sequence[Path], *, replace: bool, blackbox: bool = False) -> None:
    """Raises UsageError for a format that is not known or whose library is missing, and for a file that exists, unless
    `replace`; before anything is recorded or written. blackbox: a .csv has the columns of blackbox_decode."""
    for path in paths:
        suffix = path.suffix.lower()
        if blackbox and suffix != ".csv":
            raise UsageError(f"{path}: --format bbl-csv writes .csv files only")
        if suffix not in FORMATS:
            raise UsageError(f"{path}: the suffix names the format: {', '.join(FORMATS)}")
        if suffix == ".parquet":
            _require_parquet()
        elif suffix == ".mf4":
            foreign_frames.require_mf4()
        if path.exists() and not replace:
            raise UsageError(exists_sentence(path))
    if len(set(paths)) != len(paths):
        raise UsageError("two exports have the same name: give each a name of its own")


def _require_parquet() -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise UsageError(f"Parquet needs pyarrow; install it {install_hint('parquet')}") from None


def needs_run(path: Path) -> bool:
    """Whether the format holds the steps of a run."""
    return path.suffix.lower() in STEPS


def export(
    log: Log,
    recorded: RecordedRun | None,
    path: Path,
    *,
    blackbox: bool = False,
    compared: record_report.Compared | None = None,
) -> None:
    """Write one file, whole or not at all. recorded: the run whose steps are written; None: of a log without one.
    blackbox: a .csv has the columns of blackbox_decode. compared: for a page, what a shadow said while it ran.

    Raises UsageError for a format that needs a run, and for a file that cannot be written.
    """
    suffix = path.suffix.lower()
    if needs_run(path) and recorded is None:
        raise UsageError(f"{log.path.name} holds no run of known parameters: {suffix} needs the steps of one")
    if suffix == ".html":
        assert recorded is not None
        whole_files.write_whole({path: record_report.page_of(recorded, compared)}, "choose another file")
    elif suffix == ".dbc":
        whole_files.write_whole({path: log.dbc if log.dbc is not None else dbc.text()}, "choose another file")
    elif suffix == ".json":
        whole_files.write_whole({path: json.dumps(about(log), indent=1) + "\n"}, "choose another file")
    elif suffix in FRAMES:
        with _whole(path) as part:
            _write_frames(log, part)
    elif suffix == ".mf4":
        with _whole(path) as part:
            _write_mf4(log, recorded, part)
    else:
        assert recorded is not None
        with _whole(path) as part:
            if blackbox:
                blackbox_csv.write(recorded, part)
            else:
                write = _write_csv if suffix == ".csv" else _write_parquet
                write(recorded, part, about(log))


def about(log: Log) -> dict[str, object]:
    """Identity and parameters of a log."""
    sets = [{"at_frame": one.at, "values": one.values} for one in log.parameter_sets]
    return {**log.head, "parameters": sets, "ended": log.done, "warnings": log.warnings}


@contextlib.contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A file in the folder of `path` to be written, which then takes its place. Raises UsageError when that fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise UsageError(f"cannot write {path}: it is a folder; choose another file")
        with tempfile.TemporaryDirectory(prefix=".plumb-", dir=path.parent) as folder:
            part = Path(folder) / f"part{path.suffix.lower()}"
            yield part
            part.replace(path)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror or error}; choose another file") from None


def _tables(recorded: RecordedRun, what: str) -> Iterator[list[Column]]:
    """The steps of a run as tables of a bounded number of rows, with a progress bar for many."""
    from tqdm import tqdm

    rows = recorded.run.steps
    with tqdm(total=rows, desc=what, unit="step", leave=False, disable=None if rows > BAR_ROWS else True) as bar:
        for columns in tables_of(recorded):
            yield columns
            bar.update(len(columns[0].values))


def _write_csv(recorded: RecordedRun, path: Path, _about: dict[str, object]) -> None:
    """One row a step; a value that is not known is an empty cell."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        for number, columns in enumerate(_tables(recorded, "csv")):
            if not number:
                table.writerow([column.name for column in columns])
            table.writerows(zip(*(_cells(column) for column in columns), strict=True))


def _cells(column: Column) -> list[str]:
    format_of = _format_of(column)
    values = column.values.tolist()
    if column.known is None:
        return [format_of(value) for value in values]
    known = column.known.tolist()
    return [format_of(value) if there else "" for value, there in zip(values, known, strict=True)]


def _format_of(column: Column) -> Callable[[float], str]:
    if column.texts:
        return lambda value: column.texts.get(int(value), str(value))
    if column.name == "digest":
        return lambda value: f"{int(value):08x}"
    if column.name == "time_s":
        return lambda value: f"{value:.6f}"
    return str if column.values.dtype.kind in "iu" else lambda value: f"{value:.9g}"


def _write_parquet(recorded: RecordedRun, path: Path, said: dict[str, object]) -> None:
    """One row a step, null where a value is not known; units in the metadata of the columns, identity and
    parameters in that of the file, as JSON under `plumb`."""
    import pyarrow as arrow
    from pyarrow import parquet

    with contextlib.ExitStack() as stack:
        writer = None
        for columns in _tables(recorded, "parquet"):
            arrays = [
                arrow.array(_cells(one) if one.texts else one.values, mask=None if one.known is None else ~one.known)
                for one in columns
            ]
            if writer is None:
                described = [
                    arrow.field(one.name, array.type, metadata={"unit": one.unit})
                    for one, array in zip(columns, arrays, strict=True)
                ]
                schema = arrow.schema(described, metadata={"plumb": json.dumps(said)})
                writer = stack.enter_context(parquet.ParquetWriter(path, schema))
            writer.write_table(arrow.table(arrays, schema=schema))


def _write_frames(log: Log, path: Path) -> None:
    from tqdm import tqdm

    try:
        with can.Logger(path) as logger:
            every = (message for block in log.blocks() for message in frame_records.messages_of(block))
            for message in tqdm(every, total=log.count, desc=path.suffix, leave=False, disable=None):
                logger(message)
    except ValueError as error:
        raise UsageError(f"these frames cannot be written as {path.suffix}: {error}") from None


def _write_mf4(log: Log, recorded: RecordedRun | None, path: Path) -> None:
    """Bus logging as ASAM defines it, with the DBC attached, and a group of signals in units for each frame."""
    from asammdf import MDF, Signal, Source

    every = log.frames
    frames = every[(every["can_id"] & (REMOTE | ERROR)) == 0]
    start_us = int(every["time_us"][0]) if len(every) else 0
    samples = np.zeros(len(frames), MF4_FRAME)
    samples["CAN_DataFrame.BusChannel"] = 1
    samples["CAN_DataFrame.ID"] = frames["can_id"] & 0x1FFFFFFF
    samples["CAN_DataFrame.IDE"] = (frames["can_id"] & EXTENDED) != 0
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = frames["length"]
    samples["CAN_DataFrame.DataBytes"][:, :8] = frames["data"]
    samples["CAN_DataFrame.Dir"] = frames["sent"]
    text = log.dbc if log.dbc is not None else dbc.text()
    source = Source("plumb", "plumb", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    file = MDF(version="4.10")
    file.header.start_time = datetime.fromtimestamp(start_us * 1e-6, UTC)
    file.header.comment = json.dumps(about(log))
    times_s = (frames["time_us"] - start_us) * 1e-6
    attached = (text.encode("utf-8"), Path("plumb.dbc"), hashlib.md5(text.encode("utf-8")).digest())
    file.append(Signal(samples, times_s, name="CAN_DataFrame", source=source, attachment=attached))
    if recorded is not None:
        for name, group in _signal_groups(recorded, start_us):
            file.append(group, comment=name)
    file.save(path, compression=2, overwrite=True)
    file.close()


def _signal_groups(recorded: RecordedRun, start_us: int) -> Iterator[tuple[str, list[Signal]]]:
    """The columns of the run, those of one frame together, on the time of the log: a step's time counts from when the
    first STEP was received."""
    from asammdf import Signal

    columns, run = table_of(recorded), recorded.run
    received_us, step = run.begin_us
    begin_s = (received_us - start_us) * 1e-6 - step * recorded.used.params.period_s
    for frame in dict.fromkeys(column.frame for column in columns[1:]):
        group = [column for column in columns[1:] if column.frame == frame]
        known = np.logical_and.reduce([run.digest_known, *(one.known for one in group if one.known is not None)])
        times_s = columns[0].values[known] + begin_s
        signals = [
            Signal(one.values[known], times_s, name=one.name, unit=one.unit, conversion=_conversion(one))
            for one in group
        ]
        yield frame or "step", signals


def _conversion(column: Column) -> dict[str, object] | None:
    """From values to words, as asammdf takes it."""
    if not column.texts:
        return None
    pairs = list(enumerate(column.texts.items()))
    values = {f"val_{index}": value for index, (value, _) in pairs}
    return {**values, **{f"text_{index}": text for index, (_, text) in pairs}, "default": ""}
