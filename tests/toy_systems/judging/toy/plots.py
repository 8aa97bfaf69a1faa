"""How a run of `toy` is measured and drawn."""

from __future__ import annotations

import numpy as np

from plumb.proof.measures import Measure
from plumb.proof.report import ESTIMATE, TRUTH, Line, Plot
from plumb.proof.runs import Run

MAIN, APART = "level_rmse_counts", "apart_max_counts"
MEASURES = (
    Measure(MAIN, "count", "filtered level against the true one, rms"),
    Measure(APART, "count", "integers against float64 on the same counts, largest"),
)


def metrics(run: Run) -> dict[str, float | None]:
    filtered = run.board_words["filtered_counts_q16"] / 2**16
    apart = run.words["filtered_counts_q16"] / 2**16 - run.reference["filtered_counts"]
    error = (filtered - run.inputs.truth["level_counts"])[run.inputs.scored]
    return {
        "level_rmse_counts": float(np.sqrt(np.mean(error**2))) if error.size else None,
        "apart_max_counts": float(np.max(np.abs(apart))),
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    filtered = run.board_words["filtered_counts_q16"] / 2**16
    lines = [Line("true", run.inputs.truth["level_counts"], TRUTH), Line("filtered", filtered, ESTIMATE)]
    return [Plot("Level", "count", run.inputs.time_s, lines)]
