"""Rows of the table of figures for closed loops: margins computed from the models, and identified on the flash image.

loops.py of a system gives the models' margins. margins.toml in its folder has those of the flash image:
tools/gen_margins.py writes it, from a sweep where the system has one (sweep.py), otherwise from the test of
`plumb tune pid --board virtual --live`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from plumb.boards.contract import StepBoard
from plumb.proof.figures import Figure, Sense
from plumb.spec import declarations
from plumb.spec.system_parts import Part
from plumb.tuning.loop_model import Margins

FILE = "margins.toml"


class SweptLoops(Protocol):
    """sweep.py of a system: the margins of its loops on any board."""

    @property
    def HOW(self) -> str:
        """How they are swept, one sentence."""

    def margins_on(self, board: StepBoard, /) -> Mapping[str, Margins]:
        """Loop -> its margins."""


SWEEP = Part[SweptLoops](
    "sweep", SweptLoops, without="its loop is identified by the test of `plumb tune pid`", place="judging"
)


@dataclass(frozen=True)
class LeastMargins:
    """Required margins of a loop: phase in deg, gain in dB upwards and downwards, further delay in s."""

    phase_deg: float
    gain_db: float
    delay_s: float


def gain_margin_db(found: Margins) -> float:
    """The lesser of both directions."""
    return min(found.gain_db, found.lower_gain_db)


def rows(
    loop: str, found: Margins, scenario: str, tuning: str, least: LeastMargins | None, how: str
) -> Iterator[Figure]:
    """Three rows of a loop. least: None for a loop that is only shown."""
    sense: Sense = "at least" if least else "shown"
    asked = least or LeastMargins(0.0, 0.0, 0.0)
    reached = (
        ("phase margin", "deg", asked.phase_deg, found.phase_deg),
        ("gain margin", "dB", asked.gain_db, gain_margin_db(found)),
        ("delay margin", "s", asked.delay_s, found.delay_s),
    )
    for claim, unit, reach, value in reached:
        good = found.stable and math.isfinite(value)
        yield Figure(f"{loop}: {claim}, {how}", scenario, tuning, unit, sense, reach, value if good else 0.0)


def identified(system: str) -> Mapping[str, Margins]:
    """Loop -> its margins on the flash image, as margins.toml has them; {} for a system without the file."""
    path = declarations.system(system).judging / FILE
    if not path.is_file():
        return {}
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return {loop: Margins(**margins) for loop, margins in tables.items()}
