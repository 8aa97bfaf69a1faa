"""How a run of `notch` is measured and drawn."""

from __future__ import annotations

import numpy as np

from plumb.proof.measures import Measure
from plumb.proof.report import ESTIMATE, TRUTH, Line, Plot
from plumb.proof.runs import Run

MAIN, APART = "left_rmse_counts", "apart_max_counts"
MEASURES = (
    Measure(MAIN, "count", "filtered count against the wave alone, rms"),
    Measure(APART, "count", "integers against float64 on the same counts, largest"),
)


def metrics(run: Run) -> dict[str, float | None]:
    filtered, scored = run.board_words["filtered_counts_q12"] / 2**12, run.inputs.scored
    error = (filtered - run.inputs.truth["wave_counts"])[scored]
    apart = run.words["filtered_counts_q12"] / 2**12 - run.reference["filtered_counts"]
    return {
        MAIN: float(np.sqrt(np.mean(error**2))) if error.size else None,
        APART: float(np.max(np.abs(apart))),
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    wave = Line("true", run.inputs.truth["wave_counts"], TRUTH)
    filtered = Line("filtered", run.board_words["filtered_counts_q12"] / 2**12, ESTIMATE)
    return [Plot("Signal", "count", run.inputs.time_s, [wave, filtered])]
