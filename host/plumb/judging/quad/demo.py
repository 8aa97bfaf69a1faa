"""The run of `plumb demo` with `quad`: a closed loop held level, and the error of every estimate on the same counts."""

from __future__ import annotations

from dataclasses import replace

from plumb.contract import run_fixed
from plumb.contract.parameters import quantise
from plumb.judging.quad import plots
from plumb.proof.runs import Run
from plumb.systems.quad import scenarios as quad

SCENARIO, TUNING = "hold", "hold"


def errors(run: Run) -> dict[str, tuple[float, float]]:
    """Estimate -> (rms, largest) error of the tilt in deg."""
    paper_params = quantise(replace(quad.PAPER, period_us=quad.HOLD_PERIOD_US))
    paper = run_fixed.run_control(paper_params, run.inputs.raw, run.inputs.setpoint)
    estimates = {
        "accelerometer only": plots.accel_only_deg(run),
        "the paper's constants, fixed": paper["tilt_turn_q32"] * plots.TURN_DEG,
        f"{TUNING}, float64 reference": run.reference["tilt_deg"],
        f"{TUNING}, fixed": run.words["tilt_turn_q32"] * plots.TURN_DEG,
        f"{TUNING}, the board": plots.estimate_deg(run),
    }
    return {name: plots.rms_and_max(run, tilt_deg) for name, tilt_deg in estimates.items()}
