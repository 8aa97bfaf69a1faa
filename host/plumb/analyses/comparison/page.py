"""The comparison for a reader: tables, JSON, and the parts of report.html."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from plumb.analyses.comparison.contenders import Contender
from plumb.analyses.comparison.table import Compared, Row
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, Table

COLOURS = (TRUTH, SENSOR, SECOND, "#7a5195", ESTIMATE, "#2e7d4f", "#c2570c")
"""One an algorithm, in their order; begins again after the last."""
COSTS = (
    "Cycles of plumb's systems are the budget of a step, which plumb bench holds against the compiled image. No other "
    "algorithm here is compiled with the flags of the firmware: what is published is quoted."
)
MEASURE = (
    "Angle between estimated and true vertical, deg: root mean square over the samples marked as movement, mean of the "
    "recordings (and of the seeds). A heading error does not count. -: the system cannot have this period."
)


def tables(results: Sequence[Compared], algorithms: Sequence[Contender]) -> list[Table]:
    """The means of every input, a table of each input by recording, and what was run."""
    names = [one.name for one in algorithms]
    means = [[one.input.title, *(_mean(one, name) for name in names)] for one in results]
    found = [Table("Mean tilt error (deg)", ["input", *names], means, MEASURE)]
    for one in results:
        rows = []
        for recording in dict.fromkeys(row.recording for row in one.rows):
            for seed in dict.fromkeys(row.seed for row in one.rows):
                cells = {r.algorithm: r for r in one.rows if (r.recording, r.seed) == (recording, seed)}
                label = f"{recording}, seed {seed}" if seed else recording
                rows.append([label, *(_cell(cells.get(name)) for name in names)])
        rows.append(["mean / mean / largest", *(_all(one, name) for name in names)])
        found.append(Table(f"{one.input.title}: rms / 95 % / largest error (deg)", ["recording", *names], rows))
    ran = [[one.name, one.origin, one.settings, one.cost] for one in algorithms]
    found.append(Table("Algorithms", ["algorithm", "from", "settings", "cost of a sample"], ran, COSTS))
    return found


NONE = "-"
"""Of a system that cannot have the period of the input."""


def _mean(result: Compared, name: str) -> str:
    found = result.mean_deg(name)
    return NONE if found is None else f"{found[0]:.3f}"


def _cell(row: Row | None) -> str:
    return NONE if row is None else f"{row.rmse_deg:.3f} / {row.p95_deg:.2f} / {row.max_deg:.2f}"


def _all(result: Compared, name: str) -> str:
    found = result.mean_deg(name)
    return NONE if found is None else f"{found[0]:.3f} / {found[1]:.2f} / {found[2]:.2f}"


def plots(result: Compared) -> list[Plot]:
    """The error over time, a panel for each recording."""
    return [
        Plot(
            f"Tilt error: {trace.recording}",
            "deg",
            trace.time_s,
            [
                Line(name, error, COLOURS[at % len(COLOURS)], 0.9)
                for at, (name, error) in enumerate(trace.errors_deg.items())
            ],
            f"{result.input.title}. Only samples that are scored are drawn.",
        )
        for trace in result.traces
    ]


def to_json(results: Sequence[Compared], algorithms: Sequence[Contender]) -> dict[str, object]:
    """For programs: {"algorithms": [...], "inputs": [{"decimate", "grade", "means_deg", "rows"}]}."""
    return {
        "algorithms": [
            {"name": one.name, "origin": one.origin, "settings": one.settings, "cost": one.cost} for one in algorithms
        ],
        "inputs": [
            {
                "decimate": one.input.decimate,
                "grade": one.input.grade,
                "means_deg": {
                    each.name: dict(zip(("rmse_deg", "p95_deg", "max_deg"), found, strict=True))
                    for each in algorithms
                    if (found := one.mean_deg(each.name)) is not None
                },
                "rows": [asdict(row) for row in one.rows],
            }
            for one in results
        ],
    }
