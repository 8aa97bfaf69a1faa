"""Writes report.html, summary.json and steps.csv of a run."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plumb import systems
from plumb.files import whole_files
from plumb.proof import run_identity
from plumb.proof.measures import Measure
from plumb.proof.report import Statement, Table, page, write_whole
from plumb.proof.runs import PLOTS, Run

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


def steps_csv(run: Run) -> str:
    """One row a step: time, truth, then every word of the record, units in the column names."""
    sink = io.StringIO()
    table = csv.writer(sink, lineterminator="\n")
    words, truth = run.board_words, run.inputs.truth
    table.writerow(["time_s", *(f"true_{name}" for name in truth), *words.names, "digest_crc32"])
    exact = zip(run.inputs.time_s.tolist(), *(values.tolist() for values in truth.values()), strict=True)
    columns: list[Sequence[Any]] = [words[name].tolist() for name in words.names]
    for floats, *integers in zip(exact, *columns, run.answer.digests.tolist(), strict=True):
        table.writerow([*(f"{value:.6f}" for value in floats), *integers])
    return sink.getvalue()


HEADING = ("system", "scenario", "tuning", "loop", "link", "seed", "faults", "conditions")
"""Entries of a summary that describe the run, besides its identity."""


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

    command: the command line. statements: besides those of the run. Page and summary.json get the identity of the run
    beside the entries of `summary`."""
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
