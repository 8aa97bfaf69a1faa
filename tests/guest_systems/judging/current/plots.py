"""How a run of `current` is measured and drawn."""

from __future__ import annotations

import numpy as np

from plumb.proof.measures import Measure
from plumb.proof.report import ESTIMATE, TRUTH, Line, Plot
from plumb.proof.runs import Run

MAIN, APART = "current_rmse_a", "duty_apart_max"
MEASURES = (
    Measure(MAIN, "A", "current against the setpoint, rms"),
    Measure(APART, "1", "duty of the integers against float64 on the same counts, largest"),
)


def metrics(run: Run) -> dict[str, float | None]:
    words, scored = run.board_words, run.inputs.scored
    error = (words["current_a_q20"] - run.inputs.setpoint)[scored] / 2**20
    apart = run.words["duty_q15"] / 2**15 - run.reference["duty"]
    return {
        "current_rmse_a": float(np.sqrt(np.mean(error**2))) if error.size else None,
        "duty_apart_max": float(np.max(np.abs(apart))),
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    asked = Line("asked for", run.inputs.setpoint / 2**20, TRUTH)
    measured = Line("measured", run.board_words["current_a_q20"] / 2**20, ESTIMATE)
    return [Plot("Current", "A", run.inputs.time_s, [asked, measured])]
