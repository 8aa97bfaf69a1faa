"""What a trial looks like to a person: the plots and tables of its page, and its steps as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plumb import metrics
from plumb.report import Line, Plot, Series, Table, page, write_whole
from plumb.trial import TURN_DEG, Trial

RATE_DPS = 360.0 / 2.0**28
"""Degrees per second in a unit of a rate word."""
COMMAND = 2.0**-22
TRUTH, SENSOR, ESTIMATE, SECOND = "#1d2430", "#c9a227", "#2a5ca8", "#b3261e"


def plots(trial: Trial, *, closed: bool) -> list[Plot]:
    """Tilt (and setpoint, in a closed loop), estimation error, bias, control and PWM, fixed point against float64."""
    time_s, words, truth = trial.flight.time_s, trial.words, trial.flight.tilt_deg
    error = metrics.wrap_deg(trial.estimate_deg - truth)
    apart = metrics.wrap_deg(words["tilt_turn_q32"] * TURN_DEG - trial.reference_tilt_deg)
    bias = [Line("estimated", words["bias_turnps_q28"] * RATE_DPS, ESTIMATE)]
    if np.isfinite(trial.flight.bias_dps).any():
        bias.insert(0, Line("true", trial.flight.bias_dps, TRUTH))
    tilt = [Line("accelerometer only", trial.accel_only_deg, SENSOR, 0.7)]
    if closed:
        tilt.append(Line("setpoint", trial.flight.setpoint_turn_q32 * TURN_DEG, SECOND))
    if np.isfinite(truth).any():
        tilt.append(Line("true", truth, TRUTH, 1.6))
    tilt.append(Line("estimate", trial.estimate_deg, ESTIMATE))
    found = [
        Plot("Tilt", "deg", time_s, tilt),
        Plot("Gyro bias", "deg/s", time_s, bias),
        Plot("Command of the PID", "1 = full", time_s, [Line("command", words["command_q22"] * COMMAND, ESTIMATE)]),
        Plot(
            "Pulses to the two speed controllers",
            "us",
            time_s,
            [
                Line("motor 0", words["pulse_halfus_0"] / 2.0, ESTIMATE),
                Line("motor 1", words["pulse_halfus_1"] / 2.0, SECOND),
            ],
        ),
        Plot(
            "Error budget: fixed point against float64, same counts",
            "deg",
            time_s,
            [Line("fixed - reference", apart, ESTIMATE)],
            "The board against fixed is the third part of the budget: it must be, bit for bit, nothing.",
        ),
    ]
    if np.isfinite(truth).any():
        lines = [Line("estimate - truth", error, SECOND)]
        found.insert(1, Plot("Error of the estimate", "deg", time_s, lines))
    return found


def budget(trial: Trial) -> Table:
    """The three-way error budget."""
    figures = trial.metrics()

    def degrees(name: str) -> str:
        value = figures[name]
        return "no reference" if value is None else f"{value:.4g} deg"

    rows = [
        ["sensors: accelerometer alone against truth, rms", degrees("accel_only_rmse_deg")],
        ["estimate against truth, rms", degrees("angle_rmse_deg")],
        ["estimate against truth, largest", degrees("angle_max_deg")],
        ["fixed against float64 reference, largest", degrees("fixed_vs_reference_max_deg")],
        ["board against fixed, steps that differ", f"{trial.mismatches} of {len(trial.flight.raw)}"],
    ]
    bad = frozenset({4}) if trial.mismatches else frozenset()
    return Table("Error budget", ["from what to what", "error"], rows, bad_rows=bad)


def steps_csv(trial: Trial) -> str:
    """One row a step: time, truth, then every word of the record, units in the column names."""
    sink = io.StringIO()
    table = csv.writer(sink, lineterminator="\n")
    words = trial.words if trial.answer.words is None else trial.answer.words
    table.writerow(["time_s", "true_tilt_deg", "true_bias_dps", *words.names, "digest_crc32"])
    columns: list[Sequence[Any]] = [words[name].tolist() for name in words.names]
    truth, bias = trial.flight.tilt_deg.tolist(), trial.flight.bias_dps.tolist()
    for row in zip(trial.flight.time_s.tolist(), truth, bias, *columns, trial.answer.digests.tolist(), strict=True):
        table.writerow([f"{row[0]:.6f}", f"{row[1]:.6f}", f"{row[2]:.6f}", *row[3:]])
    return sink.getvalue()


def write_run(folder: Path, trial: Trial, summary: dict[str, Any], more: Sequence[Table] = ()) -> None:
    """report.html, summary.json and steps.csv in `folder`, which is made when it is not there."""
    title = f"{summary['system']}, {summary['scenario']} on {summary['board']}"
    lead = (
        f"{summary['steps']} steps, {summary['loop']} loop, tuning {summary['tuning']}; every step's digest was "
        "compared with the integer model."
    )
    if trial.divergence is not None:
        lead = f"The board left the model at {trial.divergence}."
    html = page(
        title, summary["verdict"], lead, [budget(trial), *more, *plots(trial, closed=summary["loop"] == "closed")]
    )
    write_whole(
        folder,
        {"report.html": html, "summary.json": json.dumps(summary, indent=2) + "\n", "steps.csv": steps_csv(trial)},
    )


def rms_and_max(trial: Trial, tilt_deg: Series) -> tuple[float, float]:
    """Error of any estimate against the trial's truth over the samples that count, deg."""
    truth, scored = trial.flight.tilt_deg, trial.flight.scored
    return (
        float(metrics.angle_rmse_deg(np.asarray(tilt_deg, np.float64), truth, scored)),
        float(metrics.angle_max_deg(np.asarray(tilt_deg, np.float64), truth, scored)),
    )
