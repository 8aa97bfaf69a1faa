"""How a run of `gantry` is measured and drawn."""

from __future__ import annotations

import numpy as np

from plumb.proof.measures import Measure
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot
from plumb.proof.runs import Run

COLOURS = (ESTIMATE, SECOND, SENSOR)
MAIN, APART = "", "apart_max_counts"
MEASURES = (
    Measure(APART, "count", "integers against float64 on the same setpoints, largest"),
    Measure("arrived_percent", "%", "steps in which all three slides are where they should be"),
)


def metrics(run: Run) -> dict[str, float | None]:
    apart = [np.max(np.abs(run.words[f"path_{name}_counts"] - run.reference[f"path_{name}"])) for name in "xyz"]
    return {APART: float(max(apart)), "arrived_percent": 100.0 * float(np.mean(run.board_words["flags"] & 1))}


def plots(run: Run, *, closed: bool) -> list[Plot]:
    lines = [
        Line(name, run.board_words[f"path_{name}_counts"].astype(float), colour)
        for name, colour in zip("xyz", COLOURS, strict=True)
    ]
    return [Plot("Slides", "count", run.inputs.time_s, lines)]
