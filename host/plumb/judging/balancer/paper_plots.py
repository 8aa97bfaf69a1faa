"""The pictures of the page of `balancer`: the paper's figures 5 and 6, the axle's acceleration, a closed loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.judging.balancer.plots import DUTY, RATE_DPS, TURN_DEG
from plumb.judging.balancer.rides import Batch
from plumb.proof import metrics
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot
from plumb.proof.runs import closed_loop
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer import vehicle
from plumb.systems.balancer.drawn_run import VELOCITY_UNIT

PLOTTED_SEED, ROCKED_SEED = 1000, 1010
"""Seed 1010 begins with a bias of 2.5 deg/s, so that the correction is visible."""


def figures_5_and_6(tuning: str = "paper_rule") -> list[Plot]:
    """The paper's figures: tilt before and after the filter, raw and corrected rate, the vehicle rocked by hand."""
    run = balancer.scenario("rocked", ROCKED_SEED)
    words = native_core.run_control(quantise(balancer.TUNINGS[tuning]), run.counts(), run.setpoint())
    truth, time_s = run.truth(), run.time_s
    measured, fused = words["tilt_measured_turn_q32"] * TURN_DEG, words["tilt_turn_q32"] * TURN_DEG
    raw, corrected = words["rate_turnps_q28"] * RATE_DPS, words["rate_corrected_turnps_q28"] * RATE_DPS
    return [
        Plot(
            f"Figure 5: tilt before and after the filter ({balancer.TUNING_NOTES[tuning]})",
            "deg",
            time_s,
            [
                Line("accelerometer", measured, SENSOR, 0.7),
                Line("true", truth["tilt_deg"], TRUTH, 1.6),
                Line("fused", fused, ESTIMATE),
            ],
        ),
        Plot(
            "Figure 5: their errors",
            "deg",
            time_s,
            [
                Line("accelerometer", measured - truth["tilt_deg"], SENSOR, 0.7),
                Line("fused", fused - truth["tilt_deg"], ESTIMATE),
            ],
        ),
        Plot(
            "Figure 6: rate before and after the correction",
            "deg/s",
            time_s,
            [
                Line("gyro", raw, SENSOR, 0.7),
                Line("corrected", corrected, ESTIMATE, 0.7),
                Line("true", truth["rate_dps"], TRUTH, 1.6),
            ],
        ),
        Plot(
            "Figure 6: their errors",
            "deg/s",
            time_s,
            [
                Line("gyro", raw - truth["rate_dps"], SENSOR, 0.7),
                Line("corrected", corrected - truth["rate_dps"], ESTIMATE, 0.7),
            ],
        ),
    ]


def taken_off() -> list[Plot]:
    """Errors with and without subtracting the axle's acceleration from the forward axis. Hall edges are coarse, so the
    subtraction makes the arctangent noisier but its mean more accurate: the mean over 1 s is drawn."""
    batch = Batch.of("smooth", [PLOTTED_SEED])
    second = np.full(1_000_000 // balancer.PERIOD_US, balancer.PERIOD_US * 1e-6)
    shown = slice(2000, 6000)
    time_s = np.arange(len(batch.tilt_deg))[shown] * (balancer.PERIOD_US * 1e-6)
    measured: list[Line] = []
    fused: list[Line] = []
    for tuning, label, colour in (
        ("arctan", "nothing taken off", SECOND),
        ("tuned", "the axle's acceleration taken off", ESTIMATE),
    ):
        words = native_core.run_control(quantise(balancer.TUNINGS[tuning]), batch.raw, batch.setpoint)
        before, after = (
            metrics.wrap_deg(words[word] * TURN_DEG - batch.tilt_deg)[:, 0]
            for word in ("tilt_measured_turn_q32", "tilt_turn_q32")
        )
        measured.append(Line(label, np.convolve(before, second, mode="same")[shown], colour))
        fused.append(Line(label, np.asarray(after[shown], np.float64), colour))
    return [
        Plot("Error of the arctangent, smooth, mean over 1 s", "deg", time_s, measured),
        Plot("Error of the fused tilt, smooth", "deg", time_s, fused),
    ]


def closed_plots() -> list[Plot]:
    """Closed loop on the estimate, 10 s to 50 s of `rough`: tilt, velocity, duty and pushes."""
    from plumb.boards.native.board import NativeBoard

    run = balancer.scenario("rough", PLOTTED_SEED)
    trial = closed_loop(NativeBoard(), run, quantise(balancer.TUNED))
    shown = (run.time_s >= 10.0) & (run.time_s < 50.0)
    time_s, words, truth = run.time_s[shown], trial.words, trial.inputs.truth
    at = np.rint(time_s / vehicle.GRID_S).astype(np.int64)
    return [
        Plot(
            "Tilt, the loop closed on the estimate",
            "deg",
            time_s,
            [
                Line("lean asked for", words["lean_turn_q32"][shown] * TURN_DEG, SECOND),
                Line("true", truth["tilt_deg"][shown], TRUTH, 1.6),
                Line("estimate", words["tilt_turn_q32"][shown] * TURN_DEG, ESTIMATE),
            ],
        ),
        Plot(
            "Velocity",
            "m/s",
            time_s,
            [
                Line("asked for", run.setpoint()[shown] / VELOCITY_UNIT, SECOND),
                Line("true", truth["velocity_mps"][shown], TRUTH, 1.6),
            ],
        ),
        Plot("Pushes, as an acceleration of the axle", "m/s^2", time_s, [Line("push", run.push_mps2[at], SECOND)]),
        Plot("Duty of the bridge", "1 = full", time_s, [Line("duty", words["duty_q15"][shown] * DUTY, ESTIMATE)]),
    ]


PLOTS: dict[str, Callable[[], list[Plot]]] = {
    "figures_5_and_6": figures_5_and_6,
    "taken_off": taken_off,
    "closed_loop": closed_plots,
}
