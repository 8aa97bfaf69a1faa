"""What the systems were asked to reach, and what the integers reach: one table, from the scenarios as they stand.

Every figure is over seeds 1000-1039; tunings were fitted on seeds 0-19. The float64 column is `plumb.reference` on the
same tuning and the same counts. A system's part `figures` offers

    SECTIONS    name -> function of seeds that gives figures
    ASSUMED     sentences: what was assumed, and how it was measured
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from plumb import systems

Sense = Literal["at most", "at least", "near"]

SEEDS = range(1000, 1040)
NEAR = 0.05
RED, PLAIN = "\x1b[31m", "\x1b[0m"


@dataclass(frozen=True)
class Figure:
    """One line of the table. reached: over all seeds, the mean (convergence: the median); worst: of any seed.

    reference: the same in float64; accel_only, gyro_only: the same without a filter; None where it means nothing.
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

    @property
    def met(self) -> bool:
        match self.sense:
            case "at most":
                return self.reached <= self.reach
            case "at least":
                return self.reached >= self.reach
            case _:
                return abs(self.reached - self.reach) <= NEAR * self.reach

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "met": self.met}


def compute(
    names: Iterable[str] = tuple(systems.SYSTEMS), seeds: Iterable[int] = SEEDS
) -> Iterator[tuple[str, Figure]]:
    """Every row of these systems, with the system's name, as it is ready."""
    seeds = list(seeds)
    for name in names:
        for rows in systems.load(name, "figures").SECTIONS.values():
            for row in rows(seeds):
                yield name, row


def assumed(name: str) -> tuple[str, ...]:
    """What the figures of a system rest on."""
    sentences: tuple[str, ...] = systems.load(name, "figures").ASSUMED
    return sentences


def render(figures: Iterable[tuple[str, Figure]], *, colour: bool = False) -> str:
    """The table as text, a block for each system with what was assumed; a missed figure says so, in red on request."""
    blocks: dict[str, list[Figure]] = {}
    for name, row in figures:
        blocks.setdefault(name, []).append(row)
    return "\n\n".join("\n".join(_block(name, rows, colour)) for name, rows in blocks.items())


def _block(name: str, rows: Sequence[Figure], colour: bool) -> Iterator[str]:
    header = ("claim", "scenario", "tuning", "unit", "to reach", "reached", "worst", "float64", "accel", "gyro", "")
    lines: list[tuple[str, ...]] = [(name + ": " + header[0], *header[1:])]
    for row in rows:
        sense = {"at most": "<=", "at least": ">=", "near": "~"}[row.sense]
        numbers = (row.worst, row.reference, row.accel_only, row.gyro_only)
        cells = ("" if value is None else f"{value:.3f}" for value in numbers)
        reach, reached = f"{sense} {row.reach:g}", f"{row.reached:.3f}"
        lines.append(
            (row.claim, row.scenario, row.tuning, row.unit, reach, reached, *cells, "met" if row.met else "MISSED")
        )
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    for line in lines:
        text = "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        yield f"{RED}{text}{PLAIN}" if colour and line[-1] == "MISSED" else text
    yield ""
    yield from assumed(name)
