"""Writes report.html of a recording: every recorded signal over time, and what it was recorded with."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.boards import Board
from plumb.inputs.recorder import RAW_COLUMNS
from plumb.proof import run_identity
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, Statement, page, write_whole
from plumb.spec import declarations, parameters
from plumb.spec.signals import UNITS
from plumb.tuning.quantise import ControlParams

FloatArray = npt.NDArray[np.float64]

ROWS_MAX = 500_000
"""Rows that the page shows, the first ones: 17 minutes at 500 Hz. steps.csv has all."""
COLOURS = (ESTIMATE, SECOND, SENSOR, "#1a8f7a", "#8a63d2", "#c2578f")
"""Of the lines of one panel, in their order. Each can be told from the ground in light and in dark mode."""


def columns(path: Path) -> dict[str, FloatArray]:
    """The columns of a steps.csv as numbers, (rows,) each; NaN where a cell is empty. The digest is left out."""
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.reader(file)
        names = next(table)
        kept = [index for index, name in enumerate(names) if name != "digest"]
        rows = [[row[index] or "nan" for index in kept] for row in itertools.islice(table, ROWS_MAX)]
    values = np.array(rows, np.float64).reshape(len(rows), len(kept))
    return {names[index]: values[:, column] for column, index in enumerate(kept)}


def panels(system: str, recorded: Mapping[str, FloatArray], period_s: float) -> list[Plot]:
    """A panel for the raw counts, one for each unit, and one for each signal without a unit. Signals that no frame
    carried are left out."""
    time_s = recorded["step"] * period_s
    channels = declarations.system(system).channels
    groups: dict[tuple[str, str], list[tuple[str, FloatArray]]] = {}
    for name, values in recorded.items():
        if name == "step" or not np.isfinite(values).any():
            continue
        if name in RAW_COLUMNS:
            index = RAW_COLUMNS.index(name)
            if index < len(channels):
                groups.setdefault(("Raw counts", "count"), []).append((channels[index].name, values))
            continue
        unit = next((unit for unit, end in UNITS.items() if name.endswith(end)), "")
        title = f"Signals in {unit}" if unit else name
        groups.setdefault((title, unit), []).append((name.removesuffix(UNITS.get(unit, "")), values))
    found = []
    for (title, unit), of in groups.items():
        lines = [Line(label, values, COLOURS[i % len(COLOURS)]) for i, (label, values) in enumerate(of)]
        found.append(Plot(title, unit, time_s, lines))
    return found


def write_report(
    folder: Path, board: Board, words: Sequence[int], lost: int, heading: Mapping[str, object], command: str
) -> Path | None:
    """Write folder/report.html from folder/steps.csv; gives its path, None for a board whose parameters this version
    does not know: then no page is written.

    words: every parameter of the board, as Session.read_parameters gives them. lost: steps without counts or digest.
    heading: further rows of the identity. Raises UsageError when the page cannot be written.
    """
    if len(words) != len(parameters.table()):
        return None
    params = ControlParams.from_words(parameters.control_part(words))
    recorded = columns(folder / "steps.csv")
    rows = len(recorded["step"])
    most = f" The page shows the first {ROWS_MAX} steps." if rows == ROWS_MAX else ""
    lead = f"{rows} steps of {1e3 * params.period_s:g} ms. No step was compared with the integer model.{most}"
    whole = "no step lacks its counts or its digest" if not lost else f"{lost} steps lack their counts or their digest"
    entry = run_identity.identity(run_identity.part_of(board), params, command)
    html = page(
        f"{params.system}, recorded from {board.name}",
        "",
        lead,
        [*panels(params.system, recorded, params.period_s), *run_identity.tables(entry, heading)],
        [Statement("link", whole, not lost)] if rows else [],
    )
    write_whole(folder, {"report.html": html})
    return folder / "report.html"


def identity_of(board: Board, command: str) -> dict[str, object]:
    """The entry `identity` of board.json, which has the parameters beside it."""
    return run_identity.identity(run_identity.part_of(board), None, command)
