"""`plumb tune pid` for a reader: the plant, margins and gains before and after, plots, JSON."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np

from plumb.analyses.identification import chosen_settings
from plumb.analyses.identification.pid_design import Wanted
from plumb.analyses.identification.pid_tuning import PidTuning, hold_rms, step_response
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, Table
from plumb.proof.xy_plot import Axis, Curve, XyPlot
from plumb.spec.arrays import FloatArray
from plumb.tuning.loop_model import Margins, Response

PLANT_ROWS = (
    ("gain_dps2", "gain, deg/s^2 of a command of 1", 1.0),
    ("lag_s", "lag, ms", 1e3),
    ("delay_s", "delay, ms", 1e3),
    ("damping_per_s", "damping, 1/s", 1.0),
)
DUST = 1e-6
"""Share of the interval's end below which a fitted figure is the bound at 0, and what is left is rounding."""
MOST_MISMATCH, MOST_APART = 3.0, 0.05
"""In standard deviations, and as a share of the response: 5 % are 3 deg of phase, or half a decibel."""
HOLD_S = 3.0
STEP_S = 1.5
PLANT_NOTE = (
    "rate / command = gain exp(-s delay) / ((s + damping) (1 + s lag)), fitted to the response that the test measured; "
    "intervals of 95 %."
)
MARGIN_NOTE = (
    "Of the loop broken at the command, with the filter and the PID as they are sampled. Further delay: what the phase "
    "margin allows on top."
)


def _number(value: float, scale: float = 1.0, digits: int = 1) -> str:
    return f"{scale * value:.{digits}f}" if math.isfinite(value) else "none" if math.isinf(value) else "-"


def _margins(found: Margins) -> list[str]:
    return [
        "yes" if found.stable else "no",
        _number(found.crossover_hz, digits=2),
        _number(found.phase_deg),
        _number(found.gain_db),
        _number(found.lower_gain_db),
        _number(found.delay_s, 1e3),
        _number(found.peak, digits=2),
    ]


def tables(tuning: PidTuning, again: PidTuning | None) -> list[Table]:
    """again: the test with the new gains, where it was made."""
    figures, held = tuning.plant.figures, tuning.tested.held
    plant = [
        [
            label,
            f"{0.0 if figures[name].value < DUST * figures[name].high else scale * figures[name].value:.4g}",
            f"{scale * figures[name].low:.4g} to {scale * figures[name].high:.4g}",
        ]
        for name, label, scale in PLANT_ROWS
    ]
    fit = f"{len(tuning.plant.response.hz)} lines; distance of model and response {tuning.plant.mismatch:.2f} sigma."
    found = [Table("Plant", ["", "fitted", "95 %"], plant, f"{PLANT_NOTE} {fit}")]
    after = tuning.settings()
    gains = [[name, f"{value:.5g}", f"{after[name]:.5g}"] for name, value in tuning.settings_before().items()]
    found.append(Table("Gains", ["setting", "before", "after"], gains))
    labels = [
        "stable", "crossover, Hz", "phase margin, deg", "gain margin, dB", "gain margin downwards, dB",
        "further delay, ms", "peak of the sensitivity",
    ]  # fmt: skip
    wanted = ["yes", "", f">= {tuning.wanted.phase_deg:g}", *[f">= {tuning.wanted.gain_db:g}"] * 2]
    wanted += [f">= {1e3 * tuning.wanted.delay_s:g}", ""]
    head = ["", "before", "after", *(["after, measured"] if again else []), "wanted"]
    columns = [_margins(tuning.before), _margins(tuning.design.margins)]
    columns += [_margins(again.before)] if again else []
    rows = [list(row) for row in zip(labels, *columns, wanted, strict=True)]
    holds = [hold_rms(one.run, HOLD_S) for one in (tuning, *([again] if again else []))]
    if again and holds[0] is not None and holds[1] is not None:
        label = f"{held.quantity} at setpoint 0, rms over {HOLD_S:g} s, {held.unit}"
        rows.append([label, f"{holds[0]:.2f}", "", f"{holds[1]:.2f}", ""])
    rows.append(["response to a torque, dB", "0", f"{tuning.design.rejection_db:+z.1f}", *([""] if again else []), ""])
    found.append(Table("Margins", head, rows, MARGIN_NOTE, bad_rows=_bad(tuning.design.margins, tuning.wanted)))
    for old, new in tuning.parts:
        rows = [list(row) for row in zip(labels, _margins(old), _margins(new), wanted, strict=True)]
        head = ["", "before", "after", "wanted"]
        found.append(Table("Margins of the rate loop alone", head, rows, bad_rows=_bad(new, tuning.wanted)))
    if tuning.faster:
        found.append(_faster(tuning))
    if not tuning.refusal():
        lines = [[line] for line in chosen_settings.apply_lines(tuning.settings())]
        found.append(Table("To use them", [""], lines, chosen_settings.BOARDS))
    return found


def _bad(found: Margins, wanted: Wanted) -> frozenset[int]:
    """Rows whose margin is missed."""
    short = 0.99
    missed = (
        (0, not found.stable),
        (2, not found.phase_deg >= short * wanted.phase_deg),
        (3, not found.gain_db >= short * wanted.gain_db),
        (4, not found.lower_gain_db >= short * wanted.gain_db),
        (5, not found.delay_s >= short * wanted.delay_s),
    )
    return frozenset(row for row, bad in missed if bad)


def _faster(tuning: PidTuning) -> Table:
    """The gain of shorter steps: the response to a torque, against the present gains."""
    rows = [[f"{1e-3 * tuning.tuning.period_us:g} ms", *_reached(tuning, 0.0, tuning.tuning.period_us)]]
    for period_us in tuning.faster:
        rows.append([f"{1e-3 * period_us:g} ms", *_reached(tuning, tuning.design.rejection_db, period_us)])
    note = (
        "The same plant and margins; gains worked out for each period. Less is better: a torque moves the machine less."
    )
    return Table("Shorter steps", ["period", "margins met", "response to a torque, dB"], rows, note)


def _reached(tuning: PidTuning, added_db: float, period_us: int) -> list[str]:
    one = tuning.faster.get(period_us, tuning.design)
    return ["yes" if one.met else "no", f"{one.rejection_db + added_db:+z.1f}"]


def warnings(tuning: PidTuning) -> list[str]:
    found = []
    if refusal := tuning.refusal():
        found.append(refusal)
    if tuning.plant.mismatch > MOST_MISMATCH and tuning.plant.apart > MOST_APART:
        found.append(
            f"model and measured response are {tuning.plant.mismatch:.1f} standard deviations apart: the machine is no "
            "body behind a lag and a delay, or the test saturated; look at the plot before the gains are used"
        )
    return found


def plots(tuning: PidTuning, again: PidTuning | None) -> list[XyPlot | Plot]:
    response, period_s = tuning.plant.response, tuning.tuning.period_s
    hz = np.geomspace(0.8 * response.hz[0], 1.2 * response.hz[-1], 200)
    model = tuning.plant.plant.sampled(hz, period_s)[0]
    size, frequency = Axis("rate / command (deg/s)", log=True), Axis("frequency (Hz)", log=True)
    bars = 2.0 * response.deviation
    measured = np.abs(response.value)
    low = np.maximum(measured - bars, 0.1 * measured)
    drawn: list[XyPlot | Plot] = [
        XyPlot(
            "Plant: size of the response",
            frequency,
            size,
            [
                Curve("measured", response.hz, measured, SECOND, low=low, high=measured + bars, points=True),
                Curve("fitted", hz, np.abs(model), ESTIMATE),
            ],
        ),
        XyPlot(
            "Plant: phase of the response",
            frequency,
            Axis("deg"),
            [
                Curve("measured", response.hz, _degrees(response.value), SECOND, points=True),
                Curve("fitted", hz, _degrees(model), ESTIMATE),
            ],
        ),
    ]
    pairs = (("before", tuning.tested.gains, SENSOR), ("after", tuning.design.gains, ESTIMATE))
    gains = [(name, tuning.loop.gain(one), colour) for name, one, colour in pairs]
    loop_hz = tuning.loop.hz
    one = Curve("1", loop_hz, np.ones(len(loop_hz)), TRUTH, 1.0, dashed=True)
    turned = Curve("-180 deg", loop_hz, np.full(len(loop_hz), -180.0), TRUTH, 1.0, dashed=True)
    drawn += [
        XyPlot(
            "Loop gain: size",
            frequency,
            Axis("loop gain", log=True),
            [one, *(Curve(name, loop_hz, np.abs(gain), colour) for name, gain, colour in gains)],
        ),
        XyPlot(
            "Loop gain: phase",
            frequency,
            Axis("deg", low=-360.0, high=0.0),
            [turned, *(Curve(name, loop_hz, _degrees(gain), colour) for name, gain, colour in gains)],
        ),
    ]
    steps, held = [], tuning.tested.held
    for name, one, colour in pairs:
        time_s, tilt = step_response(tuning.loop, one, STEP_S, period_s)
        steps.append(Curve(name, time_s, tilt, colour))
    title, answer = f"Step of the setpoint by 1 {held.unit}, by the model", f"{held.quantity} ({held.unit})"
    drawn.append(XyPlot(title, Axis("time (s)"), Axis(answer), steps))
    drawn += [_over_time(name, one) for name, one in (("before", tuning), ("after", again)) if one is not None]
    return drawn


def _degrees(response: Response) -> FloatArray:
    """Phase without jumps, from between -360 and 0 deg at the first frequency."""
    phase = np.unwrap(np.angle(response))
    return np.asarray(np.degrees(phase - 2.0 * math.pi * math.ceil((phase[0] - 1e-3) / (2.0 * math.pi))), np.float64)


def _over_time(name: str, one: PidTuning) -> Plot:
    run, period_s = one.run, one.tuning.period_s
    time_s = period_s * np.arange(len(run.raw))
    held = one.tested.held
    lines = [
        Line("setpoint", one.tested.asked_deg(run.raw, run.setpoint), TRUTH),
        Line(f"{held.quantity}, estimated", one.tested.estimated_deg(run.signals()), ESTIMATE),
    ]
    return Plot(f"Test {name}", held.unit, time_s, lines)


def to_json(tuning: PidTuning, again: PidTuning | None) -> dict[str, object]:
    def plain(found: Margins) -> dict[str, object]:
        return {name: value if math.isfinite(value) else None for name, value in asdict(found).items()}

    runs = (tuning, *([again] if again else []))
    return {
        "system": tuning.tuning.system,
        "period_us": tuning.tuning.period_us,
        "plant": {name: asdict(figure) for name, figure in tuning.plant.figures.items()},
        "mismatch": tuning.plant.mismatch,
        "gains_before": tuning.settings_before(),
        "settings": tuning.settings(),
        "margins_before": plain(tuning.before),
        "margins": plain(tuning.design.margins),
        "margins_measured": plain(again.before) if again else None,
        "margins_rate_alone": [plain(new) for _, new in tuning.parts],
        f"hold_rms_{tuning.tested.held.suffix}": [hold_rms(one.run, HOLD_S) for one in runs],
        "met": tuning.design.met,
        "refusal": tuning.refusal(),
        "warnings": warnings(tuning),
        "apply": [] if tuning.refusal() else chosen_settings.apply_lines(tuning.settings()),
    }
