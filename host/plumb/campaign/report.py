"""The output of a finished campaign: the JSON of `plumb campaign`, and the files of its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from plumb.campaign import against, page, results, statistics, violated
from plumb.campaign.against import Difference
from plumb.campaign.factors import GRID
from plumb.campaign.results import CONFIRMED, Results
from plumb.campaign.statistics import Effect, Figure, Point, Share
from plumb.campaign.study import Study
from plumb.errors import UsageError, counted
from plumb.proof import run_identity
from plumb.proof.report import Statement

SHOWN = 5
"""Runs that are named, of those that failed and of those that differ."""


@dataclass(frozen=True)
class Report:
    """part: what ran the batches, by name."""

    study: Study
    results: Results
    figures: Mapping[str, Figure]
    effects: Sequence[Effect]
    differences: Sequence[Difference]
    shares: Sequence[Share]
    points: Sequence[Point]
    """The combinations of a grid; (): nothing is varied, or not on a grid."""
    identity: dict[str, Any]  # Any: JSON
    checked: Mapping[str, object]
    """What an audit found in each recording, by its name; {}: the runs are of scenarios."""

    def to_json(self) -> dict[str, Any]:  # Any: JSON
        """The output of `plumb campaign --json`."""
        failed = [
            {
                "seed": int(self.results.seed[place]),
                "reason": self.results.error[place],
                "command": self.study.command(int(self.results.index[place])),
            }
            for place in self.results.failed
        ]
        differing = [
            {
                "seed": int(self.results.seed[place]),
                "steps": int(self.results.metrics[CONFIRMED][place]),
                "command": self.study.confirming_command(int(self.results.index[place])),
            }
            for place in self.results.differing
        ]
        return {
            "system": self.study.system,
            "runs": len(self.results),
            "metrics": statistics.to_json(self.figures),
            "worst": {name: self.study.command(one.worst_index) for name, one in self.figures.items()},
            "failed": failed,
            **self._violations_json(),
            **({"differing": differing} if CONFIRMED in self.results.metrics else {}),
            "effects": [
                {"factor": one.factor, "metric": one.metric, "share": one.share, "levels": one.levels}
                for one in self.effects
            ],
            **({"points": [one.to_json() for one in self.points]} if self.points else {}),
            **({"limits": [one.to_json() for one in self.shares]} if self.shares else {}),
            **({"check": dict(self.checked)} if self.checked else {}),
            **({"against": [one.to_json() for one in self.differences]} if self.differences else {}),
        }

    def _violations_json(self) -> dict[str, Any]:  # Any: JSON
        """How many, of which invariants, and each one; {} for a study whose runs are not judged."""
        if not self.study.invariants:
            return {}
        found = self.results.violations
        return {
            "violations": len(found),
            "invariants": violated.counts(page.declared(self.study), found),
            "violated": [one.to_json() for one in found],
        }

    def text(self) -> str:
        """The same for a person."""
        lines = [f"{counted(len(self.results), 'run')} of {self.study.system} from seed {self.study.first_seed} on"]
        width = max((len(name) for name in self.figures), default=0)
        for name, one in self.figures.items():
            lines.append(f"  {name:<{width}}  {one}  5 % {one.p05:.4g}, 95 % {one.p95:.4g}, largest {one.max:.4g}")
        lines += self._point_lines()
        first = next(((name, one) for name, one in self.figures.items() if name != CONFIRMED), None)
        if first is not None:
            lines.append(f"largest {first[0]}: {self.study.command(first[1].worst_index)}")
        for most in self.effects[:5]:
            lines.append(f"{most.factor} explains {100.0 * most.share:.0f} % of the variance of {most.metric}")
        lines += [str(one) for one in self.shares]
        lines += [f"against: {one}" for one in self.differences]
        for place in self.results.failed[:SHOWN]:
            command = self.study.command(int(self.results.index[place]))
            lines.append(f"failed: {self.results.error[place]} ({command})")
        if len(self.results.failed) > SHOWN:
            lines.append(f"failed: {len(self.results.failed)} in all")
        return "\n".join([*lines, *self._violation_lines(), *self._confirmed_lines()])

    def _violation_lines(self) -> list[str]:
        """Whether the invariants hold, and for each that does not one run; []: the runs are not judged."""
        if not self.study.invariants:
            return []
        found = self.results.violations
        counts = violated.counts(page.declared(self.study), found)
        lines = [str(page.invariants(self.study, self.results))]
        for one in violated.shown(found):
            lines.append(
                f"violated by {counts[one.invariant]} of {counted(len(self.results), 'run')}: {one} ({one.command})"
            )
        return lines

    def _confirmed_lines(self) -> list[str]:
        """Results of the board that confirms; []: no board was named."""
        if CONFIRMED not in self.results.metrics:
            return []
        differing = self.results.differing
        lines = [str(page.confirmed(self.study, self.results))]
        for place in differing[:SHOWN]:
            command = self.study.confirming_command(int(self.results.index[place]))
            steps = int(self.results.metrics[CONFIRMED][place])
            lines.append(f"differs: {steps:,} of {counted(int(self.results.steps[place]), 'step')} ({command})")
        return lines

    def _point_lines(self) -> list[str]:
        """The combinations, one a line, with the figures that the study limits, else the first one."""
        shown = list(self.study.limits) or [name for name in self.figures if name != CONFIRMED][:1]
        rows = [
            [
                *one.values.values(),
                *(str(one.figures.get(name, "")) for name in shown),
            ]
            for one in self.points
        ]
        if not rows:
            return []
        table = [[*self.points[0].values, *shown], *rows]
        widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
        return ["  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in table]

    def files(self) -> dict[str, str | bytes]:
        """Name -> content of the files of a folder."""
        about = {"identity": self.identity, "study": self.study.to_json(), "study_sha256": self.study.sha256()}
        summary = {**self.to_json(), **about}
        said = [page.confirmed(self.study, self.results)] if CONFIRMED in self.results.metrics else []
        said += [page.invariants(self.study, self.results)] if self.study.invariants else []
        said += [Statement("limit", str(one), None) for one in self.shares]
        html = page.text(
            self.study, self.results, self.figures, self.effects, self.points, self.differences, said, self.identity
        )
        try:
            table: dict[str, str | bytes] = {"runs.parquet": results.parquet_bytes(self.results, about)}
        except UsageError:
            table = {"runs.csv": results.csv_text(self.results)}
        return {**table, "summary.json": json.dumps(summary, indent=2) + "\n", "report.html": html}


def of(
    study: Study,
    found: Results,
    part: Mapping[str, object],
    command: str,
    other: Results | None = None,
    checked: Mapping[str, object] = MappingProxyType({}),
) -> Report:
    """The report of a campaign. part: what ran it. other: the campaign that it is compared with. checked: what an
    audit found in the recordings, by name."""
    figures = statistics.figures(found)
    return Report(
        study,
        found,
        figures,
        statistics.effects(found, list(figures)),
        against.compare(found, other) if other is not None else [],
        statistics.shares(found, study.limits),
        statistics.points(found) if study.vary and study.draw == GRID else [],
        {**run_identity.identity({"board": "native", **part}, None, command), "study_sha256": study.sha256()},
        checked,
    )
