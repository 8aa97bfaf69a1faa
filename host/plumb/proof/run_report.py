"""Writes report.html, summary.json and steps.csv of a run."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plumb import systems
from plumb.proof.report import Table, page, write_whole
from plumb.proof.runs import PLOTS, Run


def budget(run: Run) -> Table:
    """The three-way error budget."""
    figures = run.metrics()

    def degrees(name: str) -> str:
        value = figures[name]
        return "no reference" if value is None else f"{value:.4g} deg"

    rows = [
        ["sensors: accelerometer alone against truth, rms", degrees("accel_only_rmse_deg")],
        ["estimate against truth, rms", degrees("angle_rmse_deg")],
        ["estimate against truth, largest", degrees("angle_max_deg")],
        ["fixed against float64 reference, largest", degrees("fixed_vs_reference_max_deg")],
        ["board against fixed, steps that differ", f"{run.mismatches} of {len(run.inputs.raw)}"],
    ]
    bad = frozenset({4}) if run.mismatches else frozenset()
    return Table("Error budget", ["from what to what", "error"], rows, bad_rows=bad)


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


def write_run(folder: Path, run: Run, summary: dict[str, Any], more: Sequence[Table] = ()) -> None:
    """Write report.html, summary.json and steps.csv into `folder`, which is created if needed."""
    view = systems.load(run.system, PLOTS)
    title = f"{summary['system']}, {summary['scenario']} on {summary['board']}"
    lead = (
        f"{summary['steps']} steps, {summary['loop']} loop, tuning {summary['tuning']}; every step's digest was "
        "compared with the integer model."
    )
    if run.divergence is not None:
        lead = f"The board left the model at {run.divergence}."
    html = page(
        title, summary["verdict"], lead, [budget(run), *more, *view.plots(run, closed=summary["loop"] == "closed")]
    )
    write_whole(
        folder,
        {"report.html": html, "summary.json": json.dumps(summary, indent=2) + "\n", "steps.csv": steps_csv(run)},
    )
