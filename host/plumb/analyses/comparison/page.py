"""The comparison for a reader: tables, JSON, and the parts of report.html."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from plumb.analyses.comparison.contenders import Described
from plumb.analyses.comparison.table import Compared, Means, Row
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, Table

COLOURS = (TRUTH, SENSOR, SECOND, "#7a5195", ESTIMATE, "#2e7d4f", "#c2570c")
"""One an algorithm, in their order; begins again after the last."""
COSTS = (
    "Cycles of plumb's systems are the budget of a step, which plumb bench holds against the compiled image. No other "
    "algorithm here is compiled with the flags of the firmware: what is published is quoted."
)
MEASURE = (
    "Angle between estimated and true vertical, deg: root mean square over the samples marked as movement, mean of the "
    "recordings and seeds, and in brackets the worst of them and the largest error. A heading error does not count. -: "
    "the system cannot have this period."
)
SIGMA = (
    "Sigma: root of the sum of the tilt variances of both axes that the algorithm states, mean over the scored "
    "samples. The share of errors is of those above three times the sigma of their sample."
)


def tables(results: Sequence[Compared], algorithms: Sequence[Described]) -> list[Table]:
    """The means of every input, what the algorithms say of their own error, a table of each input by recording, and
    what was run."""
    names = [one.name for one in algorithms]
    means = [[one.input.name, one.input.title, *(_mean(one, name) for name in names)] for one in results]
    note = " ".join([MEASURE, *_outside(results, algorithms)])
    found = [Table("Mean tilt error (deg)", ["input", "", *names], means, note)]
    if any(one.flown for one in results):
        found.append(_ends(results, names))
    if stated := _sigmas(results, names):
        head = ["input", "algorithm", "sigma (deg)", "error (deg)", "sigma / error", "errors above 3 sigma"]
        found.append(Table("Sigma against error", head, stated, SIGMA))
    for one in results:
        rows = []
        for recording in dict.fromkeys(row.recording for row in one.rows):
            for seed in dict.fromkeys(row.seed for row in one.rows):
                cells = {r.algorithm: r for r in one.rows if (r.recording, r.seed) == (recording, seed)}
                label = f"{recording}, seed {seed}" if seed else recording
                rows.append([label, *(_cell(cells.get(name)) for name in names)])
        rows.append(["mean / mean / largest", *(_all(one.means(name)) for name in names)])
        found.append(Table(f"{one.input.title}: rms / 95 % / largest error (deg)", ["recording", *names], rows))
    ran = [[one.name, one.origin, one.settings, one.cost] for one in algorithms]
    found.append(Table("Algorithms", ["algorithm", "from", "settings", "cost of a sample"], ran, COSTS))
    return found


NONE = "-"
"""Shown for a system that cannot have the period of the input."""


def _outside(results: Sequence[Compared], algorithms: Sequence[Described]) -> list[str]:
    return [
        f"{one.input.name}: {'; '.join(why.values())}." for one in results if (why := one.input.outside(algorithms))
    ]


def _mean(result: Compared, name: str) -> str:
    found = result.means(name)
    return NONE if found is None else f"{found.rmse_deg:.3f} ({found.worst_rmse_deg:.2f}, {found.max_deg:.1f})"


def _sigmas(results: Sequence[Compared], names: Sequence[str]) -> list[list[str]]:
    rows = []
    for one in results:
        for name in names:
            found = one.means(name)
            if found is not None and found.sigma_deg is not None and found.beyond_3_sigma is not None:
                ratio, share = found.sigma_deg / max(found.rmse_deg, 1e-9), 100.0 * found.beyond_3_sigma
                cells = f"{found.sigma_deg:.3f}", f"{found.rmse_deg:.3f}", f"{ratio:.2f}", f"{share:.2f} %"
                rows.append([one.input.name, name, *cells])
    return rows


def _ends(results: Sequence[Compared], names: Sequence[str]) -> Table:
    rows = []
    for one in results:
        ends = {end.algorithm: f"{end.crashes} / {end.restarts} of {end.flights}" for end in one.flown}
        if ends:
            rows.append([one.input.name, *(ends.get(name, NONE) for name in names)])
    title = "Flights that crashed / in which the estimator began again"
    return Table(title, ["input", *names], rows, "A flight is scored until it crashes.")


def _cell(row: Row | None) -> str:
    return NONE if row is None else f"{row.rmse_deg:.3f} / {row.p95_deg:.2f} / {row.max_deg:.2f}"


def _all(found: Means | None) -> str:
    return NONE if found is None else f"{found.rmse_deg:.3f} / {found.p95_deg:.2f} / {found.max_deg:.2f}"


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


def to_json(results: Sequence[Compared], algorithms: Sequence[Described]) -> dict[str, object]:
    """For programs: {"algorithms": [...], "inputs": [{"input", "title", "decimate", "grade", "outside", "means_deg",
    "rows", of a flight "flown"}]}."""
    return {
        "algorithms": [
            {"name": one.name, "origin": one.origin, "settings": one.settings, "cost": one.cost} for one in algorithms
        ],
        "inputs": [
            {
                "input": one.input.name,
                "title": one.input.title,
                "decimate": one.input.decimate,
                "grade": one.input.grade,
                "outside": one.input.outside(algorithms),
                "means_deg": {
                    each.name: asdict(found) for each in algorithms if (found := one.means(each.name)) is not None
                },
                "rows": [asdict(row) for row in one.rows],
                **({"flown": [asdict(end) for end in one.flown]} if one.flown else {}),
            }
            for one in results
        ],
    }
