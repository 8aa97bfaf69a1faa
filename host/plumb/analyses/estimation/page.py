"""The angles of a recording for a reader: table, CSV, JSON and the parts of report.html."""

from __future__ import annotations

import io

import numpy as np

from plumb.analyses.estimation.estimated import Estimated
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, Table
from plumb.spec.arrays import FloatArray

OTHERS = {"reference": ("reference", TRUTH, 1.6), "vqf": ("VQF", SECOND, 0.9)}
"""Beginning of a column's name -> label, colour and width of its line."""
COLOURS = (ESTIMATE, SECOND, TRUTH, SENSOR)
AXES_NOTE = (
    "Axes of the body: x to the front, y to the left, z up. A positive roll lowers the right side, a positive pitch "
    "lowers the nose."
)
UNITS = {"_deg": "deg", "_dps": "deg/s"}
FIGURES_NOTE = "rms over the whole recording; apart: angle between the system's vertical and the other one."


def unit_of(column: str) -> str:
    """'roll_deg' -> 'deg'; "" for a number without a unit."""
    return next((unit for end, unit in UNITS.items() if column.endswith(end)), "")


def csv_text(made: Estimated) -> str:
    """time_s, the columns, and the flags of each step by name."""
    out = io.StringIO()
    out.write(",".join(["time_s", *made.columns, "flags"]) + "\n")
    rows = np.column_stack([made.time_s, *made.columns.values()])
    for row, flags in zip(rows.tolist(), made.flag_names(), strict=True):
        out.write(",".join("" if value != value else f"{value:.6f}" for value in row) + f",{flags}\n")
    return out.getvalue()


def _figures(values: FloatArray) -> tuple[float, float, float, float] | None:
    """Mean, rms, least and greatest of the values that are known; None without one."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    return float(known.mean()), float(np.sqrt(np.mean(known**2))), float(known.min()), float(known.max())


def tables(made: Estimated) -> list[Table]:
    """Figures of each column, and the share of the time in which each flag was set."""
    rows = []
    for name, values in made.columns.items():
        figures = _figures(values)
        cells = ["-"] * 4 if figures is None else [f"{value:.3f}" for value in figures]
        rows.append([name, unit_of(name), *cells])
    found = [Table("Columns", ["column", "unit", "mean", "rms", "least", "greatest"], rows, FIGURES_NOTE)]
    shares = [[name, f"{100.0 * float(at.mean()):.2f} %"] for name, at in made.flags.items() if at.any()]
    if shares:
        found.append(Table("Flags", ["flag", "share of the time"], shares, "Each is described with its system."))
    return found


def _unwrapped(values: FloatArray) -> FloatArray:
    """An angle in deg with a gap where it passes +-180, so that no line crosses the panel."""
    shown = values.copy()
    shown[1:][np.abs(np.diff(values)) > 180.0] = np.nan
    return shown


def plots(made: Estimated) -> list[Plot]:
    """A panel for each angle with VQF and the reference in it, then the angles to them with sigma, rates and biases."""
    own = {name: values for name, values in made.columns.items() if not name.startswith(tuple(OTHERS))}
    found, several = [], {"rate_dps": "Rate", "bias_dps": "Bias of the gyro"}
    for name, values in own.items():
        if not name.endswith("_deg") or name.endswith("sigma_deg"):
            continue
        lines = [
            Line(label, _unwrapped(made.columns[f"{beginning}_{name}"]), colour, width)
            for beginning, (label, colour, width) in OTHERS.items()
            if f"{beginning}_{name}" in made.columns
        ]
        title = name.removesuffix("_deg").replace("_", " ").capitalize()
        found.append(
            Plot(title, "deg", made.time_s, [*lines, Line(made.system, _unwrapped(values), ESTIMATE)], AXES_NOTE)
        )
    apart = [
        Line(f"to {label}", made.columns[f"{beginning}_apart_deg"], colour)
        for beginning, (label, colour, _) in OTHERS.items()
        if f"{beginning}_apart_deg" in made.columns
    ]
    if apart:
        sigma = made.sigma_deg()
        apart += [] if sigma is None else [Line("2 sigma as stated", 2.0 * sigma, SENSOR)]
        found.append(Plot("Angle to the other verticals", "deg", made.time_s, apart))
    elif (sigma := made.sigma_deg()) is not None:
        found.append(Plot("Standard deviation as stated", "deg", made.time_s, [Line("sigma", sigma, SENSOR)]))
    for end, title in several.items():
        names = [name for name in own if name.endswith(end)]
        if names:
            lines = [Line(name, own[name], COLOURS[at % len(COLOURS)]) for at, name in enumerate(names)]
            found.append(Plot(title, unit_of(names[0]), made.time_s, lines))
    return found


def to_json(made: Estimated) -> dict[str, object]:
    """For programs: what was run, and for each column its figures."""
    figures = {name: _figures(values) for name, values in made.columns.items()}
    return {
        "file": made.name,
        "system": made.system,
        "tuning": made.tuning,
        "period_us": made.period_us,
        "steps": len(made.time_s),
        "columns": {
            name: None if of is None else dict(zip(("mean", "rms", "min", "max"), of, strict=True))
            for name, of in figures.items()
        },
        "flags": {name: float(at.mean()) for name, at in made.flags.items()},
        "warnings": list(made.warnings),
    }
