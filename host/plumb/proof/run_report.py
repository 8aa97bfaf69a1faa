"""Writes report.html, summary.json and steps.csv of a run."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plumb import systems
from plumb.files import whole_files
from plumb.proof import run_identity
from plumb.proof.measures import Measure
from plumb.proof.report import Statement, Table, page, write_whole
from plumb.proof.runs import PLOTS, Run
from plumb.spec.arrays import FloatArray
from plumb.spec.quaternion_angles import ANGLES
from plumb.spec.records import Words
from plumb.spec.signal_units import word_signals

FILES = ("report.html", "summary.json", "steps.csv")


def budget(run: Run) -> Table:
    """The three-way error budget: the system's figures, then the bits."""
    figures = run.metrics()

    def shown(measure: Measure) -> str:
        value = figures[measure.metric]
        return "nothing to compare with" if value is None else f"{value:.4g} {measure.unit}"

    rows = [[measure.text, shown(measure)] for measure in systems.load(run.system, PLOTS).MEASURES]
    rows += [["board against the integer model, steps that differ", f"{run.mismatches} of {len(run.inputs.raw)}"]]
    bad = frozenset({len(rows) - 1}) if run.mismatches else frozenset()
    return Table("Error budget", ["compared", "error"], rows, bad_rows=bad)


def _engineering(words: Words) -> dict[str, FloatArray]:
    """The words that are physical quantities, in the project's units, and roll, pitch and yaw of an attitude."""
    found: dict[str, FloatArray] = {
        name: np.asarray(words[signal.word] * signal.scale, np.float64)
        for name, signal in word_signals(words.system).items()
        if name not in words.names and (signal.unit or signal.scale != 1.0) and signal.unit != "step"
    }
    parts = [found.get(f"attitude_{part}") for part in "wxyz"]
    known = [part for part in parts if part is not None]
    if len(known) == len(parts):
        w, x, y, z = known
        angles = {
            f"{name}_deg": np.asarray(np.degrees(angle(w, x, y, z)), np.float64) for name, angle in ANGLES.items()
        }
        found = {**angles, **found}
    return found


def steps_csv(run: Run) -> str:
    """One row a step: time, truth, signals in engineering units with the unit in the name, then every word of the
    record as the integer that it is, and the digest."""
    sink = io.StringIO()
    table = csv.writer(sink, lineterminator="\n")
    words, truth = run.board_words, run.inputs.truth
    signals = _engineering(words)
    table.writerow(["time_s", *(f"true_{name}" for name in truth), *signals, *words.names, "digest_crc32"])
    exact = zip(run.inputs.time_s.tolist(), *(values.tolist() for values in truth.values()), strict=True)
    shown = (
        zip(*(values.tolist() for values in signals.values()), strict=True) if signals else ((),) * len(run.inputs.raw)
    )
    columns: list[Sequence[Any]] = [words[name].tolist() for name in words.names]
    for floats, units, *integers in zip(exact, shown, *columns, run.answer.digests.tolist(), strict=True):
        table.writerow([*(f"{value:.6f}" for value in floats), *(f"{value:.9g}" for value in units), *integers])
    return sink.getvalue()


HEADING = ("system", "scenario", "tuning", "loop", "link", "seed", "faults", "conditions")
"""Entries of a summary that describe the run, in addition to its identity."""


def write_run(
    folder: Path,
    run: Run,
    summary: dict[str, Any],
    more: Sequence[Table] = (),
    *,
    command: str = "",
    statements: Sequence[Statement] = (),
) -> list[Path]:
    """Write report.html, summary.json and steps.csv into `folder`, which is created if needed; their paths.

    command: the command line. statements: in addition to those of the run. Page and summary.json get the identity of
    the run and the entries of `summary`."""
    view = systems.load(run.system, PLOTS)
    title = f"{summary['system']}, {summary['scenario']} on {summary['board']}"
    lead = (
        f"{summary['steps']} steps, {summary['loop']} loop, tuning {summary['tuning']}. The verdict is about bits: "
        "every step's digest was compared with the integer model. Accuracy does not change it."
    )
    entry = run_identity.identity(run.part, run.params, command)
    heading = {name: _in_words(summary[name]) for name in HEADING if name in summary}
    plots = view.plots(run, closed=summary["loop"] == "closed")
    tables = [*more, *run_identity.tables(entry, heading)]
    html = page(
        title, summary["verdict"], lead, [budget(run), *plots, *tables], [*run.statements(summary), *statements]
    )
    texts = (html, json.dumps({**summary, "identity": entry}, indent=2) + "\n", steps_csv(run))
    write_whole(folder, dict(zip(FILES, texts, strict=True)))
    return [folder / name for name in FILES]


def require_writable(folder: Path) -> None:
    """Raises UsageError unless `write_run` can write into the folder; call it before a long run."""
    for name in FILES:
        whole_files.require_writable(folder / name, "choose another folder with --out")


def _in_words(value: object) -> str | None:
    """An entry of a heading as a cell of a table; None stays None."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {one}" for name, one in value.items()) or None
    if isinstance(value, list):
        return ", ".join(str(one) for one in value) or None
    return None if value is None else str(value)
