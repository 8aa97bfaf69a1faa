"""report.html of a campaign: figures with intervals, distributions, worst seeds, what moves a figure, failed runs,
invariants and their violations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from plumb import systems
from plumb.campaign import violated
from plumb.campaign.against import Difference
from plumb.campaign.results import CONFIRMED, Results
from plumb.campaign.statistics import Effect, Figure, Point, worst
from plumb.campaign.study import Study
from plumb.errors import counted
from plumb.proof.invariants import INVARIANTS
from plumb.proof.report import ESTIMATE, Plot, Statement, Table, page
from plumb.proof.run_identity import rows
from plumb.proof.xy_plot import Axis, Curve, XyPlot
from plumb.spec.arrays import FloatArray

BARS = 40
NAMED = 20
EFFECTS_SHOWN = 12
POINT_FIGURES = 3


def text(
    study: Study,
    results: Results,
    figures: Mapping[str, Figure],
    effects: Sequence[Effect],
    points: Sequence[Point],
    differences: Sequence[Difference],
    said: Sequence[Statement],
    identity: Mapping[str, object],
) -> str:
    """The page. said: statements in addition to the number of runs."""
    done = len(results) - len(results.failed)
    statements = [Statement("runs", f"{done} of {len(results)} were run to their end", done == len(results))]
    statements += said
    parts: list[Plot | XyPlot | Table] = invariant_tables(study, results) if study.invariants else []
    parts += [figure_table(figures)]
    parts += [difference_table(differences)] if differences else []
    parts += [point_table(points, list(study.limits) or list(figures)[:POINT_FIGURES])] if points else []
    parts += [distribution(name, results.metrics[name]) for name in figures if _spread(results.metrics[name])]
    parts += [effect_table(effects)] if effects else []
    parts += [worst_table(study, results, name) for name in list(figures)[:2]]
    parts += [failed_table(study, results)] if results.failed else []
    parts += [differing_table(study, results)] if results.differing else []
    parts.append(Table("Identity", ["", ""], [(name, value) for name, value in rows(identity)]))
    lead = (
        f"{counted(len(results), 'run')} from seed {study.first_seed} on: {study.described()}. An interval is "
        "the 95 % interval of the mean over all seeds (bootstrap); single runs spread wider, as the quantiles show."
    )
    return page(f"Campaign of {study.system}", "", lead, parts, statements)


def declared(study: Study) -> Mapping[str, str]:
    """The invariants by which the runs of a study are judged: name -> one sentence."""
    return systems.load(study.system, INVARIANTS).INVARIANTS


def invariants(study: Study, results: Results) -> Statement:
    """Whether every invariant holds in every run that came to its end."""
    found, done = results.violations, len(results) - len(results.failed)
    text = (
        f"{counted(len(found), 'violation')} in {counted(done, 'run')}, judged by "
        f"{counted(len(declared(study)), 'invariant')}"
    )
    return Statement("invariants", text, not found)


def invariant_tables(study: Study, results: Results) -> list[Plot | XyPlot | Table]:
    """The limits, and the runs that do not keep them."""
    found, says = results.violations, declared(study)
    counts = violated.counts(says, found)
    rows_of = [[name, says.get(name, ""), str(count)] for name, count in counts.items()]
    bad = frozenset(row for row, count in enumerate(counts.values()) if count)
    head = ["invariant", "what holds", "runs that violate it"]
    tables: list[Plot | XyPlot | Table] = [Table("Invariants", head, rows_of, bad_rows=bad)]
    if found:
        lines = [
            [one.invariant, str(one.seed), f"{one.time_s:.6g}", f"{one.value:.4g}", f"{one.limit:.4g}", one.command]
            for one in found[:NAMED]
        ]
        note = (
            "Time and value are those of the run that the command repeats: the smallest one found with the violation."
        )
        note += f" {len(found)} in all." if len(found) > NAMED else ""
        tables.append(
            Table("Violations", ["invariant", "seed", "time (s)", "value", "limit", "repeats it"], lines, note)
        )
    return tables


def figure_table(figures: Mapping[str, Figure]) -> Table:
    head = ["figure", "mean", "95 % interval", "sd", "5 %", "median", "95 %", "largest", "runs"]
    lines = [
        [
            name, f"{one.mean:.4g}", f"{one.low:.4g} to {one.high:.4g}", f"{one.sd:.3g}", f"{one.p05:.4g}",
            f"{one.median:.4g}", f"{one.p95:.4g}", f"{one.max:.4g}", str(one.runs),
        ]
        for name, one in figures.items()
    ]  # fmt: skip
    return Table("Figures", head, lines)


def difference_table(differences: Sequence[Difference]) -> Table:
    """This campaign and the other one."""
    head = ["figure", "this campaign", "the other", "difference", "95 % interval", "pairs", "real"]
    lines = [
        [
            one.metric, f"{one.here:.4g}", f"{one.other:.4g}", f"{one.difference:+.4g}",
            f"{one.low:+.4g} to {one.high:+.4g}", str(one.pairs), "yes" if one.real else "not shown",
        ]
        for one in differences
    ]  # fmt: skip
    note = "Runs of one seed are a pair. A difference is real when 0 lies outside its interval; else it is not shown."
    return Table("Compared with the other campaign", head, lines, note)


def point_table(points: Sequence[Point], shown: Sequence[str]) -> Table:
    """Every combination of a grid with the means of some figures."""
    lines = [
        [
            *one.values.values(),
            *(str(one.figures.get(name, "")) for name in shown),
        ]
        for one in points
    ]
    note = "Mean of the runs of each combination, and its 95 % interval. All combinations have the same seeds."
    return Table("Each combination", [*points[0].values, *shown], lines, note)


def _spread(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and float(known.min()) < float(known.max())


def distribution(name: str, values: FloatArray) -> XyPlot:
    """Share of the runs over the value, as a staircase."""
    known = values[np.isfinite(values)]
    counts, edges = np.histogram(known, BARS)
    x = np.repeat(edges, 2)
    y = np.concatenate([[0.0], np.repeat(100.0 * counts / len(known), 2), [0.0]])
    unit = name.rsplit("_", 1)[-1]
    return XyPlot(
        f"Distribution of {name}", Axis(f"{name} ({unit})"), Axis("runs (%)"), [Curve("runs", x, y, ESTIMATE)]
    )


def effect_table(effects: Sequence[Effect]) -> Table:
    lines = [
        [
            one.factor, one.metric, f"{100.0 * one.share:.0f} %",
            "; ".join(f"{name}: {mean:.4g}" for name, mean, _ in one.levels),
        ]
        for one in effects[:EFFECTS_SHOWN]
    ]  # fmt: skip
    note = "Share of the variance between the runs that the levels of the factor explain, less what chance explains."
    return Table("What moves a figure", ["factor", "figure", "share", "mean at each level"], lines, note)


def worst_table(study: Study, results: Results, metric: str) -> Table:
    lines = [[f"{value:.4g}", str(seed), study.command(index)] for index, seed, value in worst(results, metric)]
    return Table(f"Largest {metric}", [metric, "seed", "repeats it"], lines)


def failed_table(study: Study, results: Results) -> Table:
    lines = [
        [str(results.seed[place]), str(results.error[place]), study.command(int(results.index[place]))]
        for place in results.failed[:NAMED]
    ]
    note = f"{len(results.failed)} in all." if len(results.failed) > NAMED else ""
    return Table("Runs that failed", ["seed", "reason", "repeats it"], lines, note)


def confirmed(study: Study, results: Results) -> Statement:
    """Whether the board that confirms gives every step of every run."""
    asked, differing = len(results) - len(results.failed), len(results.differing)
    text = f"{asked - differing:,} of {counted(asked, 'run')} are the same on {study.confirm} in every step"
    return Statement("confirmed", text, not differing)


def differing_table(study: Study, results: Results) -> Table:
    lines = [
        [
            str(results.seed[place]),
            f"{results.metrics[CONFIRMED][place]:.0f} of {results.steps[place]}",
            study.confirming_command(int(results.index[place])),
        ]
        for place in results.differing[:NAMED]
    ]
    note = f"{len(results.differing)} in all." if len(results.differing) > NAMED else ""
    return Table(f"Runs that {study.confirm} gives otherwise", ["seed", "steps", "repeats it there"], lines, note)
