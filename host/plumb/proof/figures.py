"""The table of figures: targets of the systems, and the values that the integers reach on their scenarios.

Every figure is over seeds 1000-1039; tunings were fitted on seeds 0-19. The float64 column is
`plumb.contract.run_reference` with the same tuning and counts. FigureSections is the contract of a system's figures.py,
which is optional.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing import Pool
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from plumb import systems
from plumb.proof import intervals, xy_plot
from plumb.proof.limits import Limit, Limits, measured
from plumb.proof.report import Plot, plot_svg, write_whole
from plumb.proof.xy_plot import XyPlot
from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part

Sense = Literal["at most", "at least", "near", "about", "compared", "shown"]
"""Kind of a target. near: within 5 %, for properties of a scenario; about: within 13 % of the source's rounded number,
which is two standard deviations of a share of a drift whose mean over 40 seeds has a standard deviation of 6.3 %.
compared, shown: no target. A row `compared` helps to judge the rows above it and is also in the short table; a row
`shown` is additional information."""
UNASKED = ("compared", "shown")

SEEDS = range(1000, 1040)
FLOAT_SEEDS = 40
"""Most seeds of closed loops in float64, because they take long; `paired` compares them with the integers'."""
NEAR, ABOUT = 0.05, 0.13
RED, PLAIN = "\x1b[31m", "\x1b[0m"


@dataclass(frozen=True)
class Figure:
    """One row of the table. reached: mean over all seeds (convergence: the median); worst: the worst seed. low, high:
    the 95 % interval of reached over all seeds; None for a row that is no mean of runs.

    reference: the value with float64; accel_only, gyro_only: the value without a filter; None if it does not apply.
    reach: the target, 0 without one. source: the source's own claim, "" if it gives no number.
    """

    claim: str
    scenario: str
    tuning: str
    unit: str
    sense: Sense
    reach: float
    reached: float
    worst: float | None = None
    reference: float | None = None
    accel_only: float | None = None
    gyro_only: float | None = None
    source: str = ""
    low: float | None = None
    high: float | None = None

    def over(self, values: FloatArray) -> Figure:
        """The same row with the interval of the mean of these runs, (runs,)."""
        return self if len(values) < 2 else self.between(intervals.of_mean(np.asarray(values, np.float64)))

    def between(self, interval: tuple[float, float]) -> Figure:
        """The same row with an interval."""
        low, high = interval
        return replace(self, low=low, high=high)

    @property
    def met(self) -> bool:
        match self.sense:
            case "at most":
                return bool(self.reached <= self.reach)
            case "at least":
                return bool(self.reached >= self.reach)
            case "compared" | "shown":
                return True
            case _:
                return bool(abs(self.reached - self.reach) <= (ABOUT if self.sense == "about" else NEAR) * self.reach)

    @property
    def of_scenario(self) -> bool:
        """True for a property of the scenario itself, which was stated for SEEDS: other seeds give another value."""
        return self.sense == "near"

    def to_json(self) -> dict[str, object]:
        return {**asdict(self), "met": self.met}


def paired(ours: Sequence[float], ideal: Sequence[float]) -> float:
    """Estimate of the float64 mean over all runs of `ours`, from the difference on the first runs, which both have."""
    apart = np.asarray(ideal, np.float64) - np.asarray(ours[: len(ideal)], np.float64)
    return float(np.mean(ours) + np.mean(apart))


class FigureSections(Protocol):
    """figures.py of a system: its targets and the reached figures."""

    @property
    def SECTIONS(self) -> Mapping[str, Callable[[Iterable[int]], Iterable[Figure]]]:
        """Name -> function of seeds that gives figures."""

    @property
    def ASSUMED(self) -> tuple[str, ...]:
        """The assumptions, and how each figure was measured, one sentence each."""

    @property
    def HEADLINE(self) -> tuple[str, str, str]:
        """Claim, scenario and tuning of the one row that stands for the system where there is room for one."""

    @property
    def LIMITS(self) -> Limits:
        """Limits of runs that the sections require of the mean of their seeds; {}: only the measured limits of
        limits.toml."""

    @property
    def PLOTS(self) -> Mapping[str, Callable[[], Sequence[Plot] | XyPlot]]:
        """Name -> function that draws a figure of the system's page: panels over time, as the source's are, or one over
        another quantity; {}: there is none."""


FIGURES = Part[FigureSections](
    "figures", FigureSections, without="there is nothing that it was asked to reach", place="judging"
)


def _part(name: str) -> FigureSections | None:
    """An attribute of the system's module `figures`; `nothing` for a system without it."""
    return systems.load(name, FIGURES) if name in systems.with_part(FIGURES.name) else None


def limits_of(system: str, scenario: str, tuning: str, loop: str, *, shorter: bool = False) -> Sequence[Limit]:
    """Limits of a run: those that the system declares, and the measured ones of the metrics that none of these is of.
    loop: open or closed. shorter: for a run of less than the scenario's length, for which the sources require
    nothing."""
    part = _part(system)
    asked = part.LIMITS.get((scenario, tuning, loop), ()) if part is not None and not shorter else ()
    declared = {limit.metric for limit in asked}
    found = measured(system, scenario, tuning, loop, shorter=shorter)
    return (*asked, *(limit for limit in found if limit.metric not in declared))


def without_figures(names: Iterable[str]) -> list[str]:
    """The systems without required figures."""
    parts = {name: _part(name) for name in names}
    return [name for name, part in parts.items() if part is None or not part.SECTIONS]


def compute(
    names: Iterable[str] = tuple(systems.SYSTEMS), seeds: Iterable[int] = SEEDS
) -> Iterator[tuple[str, Figure]]:
    """Every row of these systems with the system's name, in order, as soon as it is ready; sections run on all
    processor cores."""
    chosen = tuple(seeds)
    parts = [(name, part) for name in names if (part := _part(name)) is not None]
    tasks = [(name, section, chosen) for name, part in parts for section in part.SECTIONS]
    with Pool(initializer=_reset_signals) as pool:
        for (name, _, _), rows in zip(tasks, pool.imap(_section, tasks), strict=True):
            yield from ((name, row) for row in rows)


def _reset_signals() -> None:
    """In a worker: ignore Ctrl-C, which the parent handles, and end at once on the SIGTERM of Pool.terminate()."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _section(task: tuple[str, str, tuple[int, ...]]) -> list[Figure]:
    name, section, seeds = task
    return list(systems.load(name, FIGURES).SECTIONS[section](seeds))


def write_plots(name: str, folder: Path) -> list[Path]:
    """Write the reproduced figures of the source as folder/SYSTEM_NAME.svg; the same bytes every time."""
    written = []
    part = _part(name)
    for plot, panels in part.PLOTS.items() if part is not None else ():
        drawn = panels()
        svg = xy_plot.plot_svg(drawn) if isinstance(drawn, XyPlot) else plot_svg(*drawn)
        written.append(folder / f"{name}_{plot}.svg")
        write_whole(folder, {written[-1].name: svg + "\n"})
    return written


def assumed(name: str) -> tuple[str, ...]:
    """The assumptions behind the figures of a system."""
    part = _part(name)
    return part.ASSUMED if part is not None else ()


def headlines(figures: Iterable[tuple[str, Figure]]) -> str:
    """One row for each system, as a table in Markdown."""
    head = ["system", "figure", "scenario, tuning", "sensor alone", "to reach", "reached", "worst seed"]
    lines = [head, ["---"] * len(head)]
    for name, row in figures:
        part = _part(name)
        if part is not None and (row.claim, row.scenario, row.tuning) == part.HEADLINE:
            cells = [_cell(row.accel_only), _asked(row), _cell(row.reached), _cell(row.worst)]
            page = f"[`{name}`](docs/systems/{name}.md)"
            lines.append([page, f"{row.claim} ({row.unit})", f"{row.scenario}, {row.tuning}", *cells])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def render(figures: Iterable[tuple[str, Figure]], *, short: bool = False, colour: bool = False) -> str:
    """The table as text, one block per system with its assumptions. A missed target is marked, with `colour` in red.
    short: without rows of the kind `shown`."""
    blocks: dict[str, list[Figure]] = {}
    for name, row in figures:
        if not (short and row.sense == "shown"):
            blocks.setdefault(name, []).append(row)
    return "\n\n".join("\n".join(_block(name, rows, colour)) for name, rows in blocks.items())


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _asked(row: Figure) -> str:
    sense = {"at most": "<= ", "at least": ">= ", "near": "~ ", "about": "about "}
    return "" if row.sense in UNASKED else f"{sense[row.sense]}{row.reach:g}"


def _block(name: str, rows: Sequence[Figure], colour: bool) -> Iterator[str]:
    header = (
        "figure", "scenario", "tuning", "unit", "source", "to reach", "reached", "95 % interval", "worst", "float64",
        "accel", "gyro", "",
    )  # fmt: skip
    lines: list[tuple[str, ...]] = [(name + ": " + header[0], *header[1:])]
    for row in rows:
        between = "" if row.low is None else f"{_cell(row.low)} to {_cell(row.high)}"
        others = (_cell(value) for value in (row.worst, row.reference, row.accel_only, row.gyro_only))
        cells = (_cell(row.reached), between, *others)
        verdict = "" if row.sense in UNASKED else "met" if row.met else "MISSED"
        lines.append((row.claim, row.scenario, row.tuning, row.unit, row.source, _asked(row), *cells, verdict))
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    for line in lines:
        text = "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        yield f"{RED}{text}{PLAIN}" if colour and line[-1] == "MISSED" else text
    yield ""
    yield from assumed(name)
