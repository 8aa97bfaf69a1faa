"""`plumb check` for a reader of a page: what is wrong, and the plots that show it."""

from __future__ import annotations

import numpy as np

from plumb.audit.audit import Audit
from plumb.audit.findings import Finding
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, Table
from plumb.proof.xy_plot import Axis, Curve, XyPlot

COLOURS = (ESTIMATE, SECOND, SENSOR)
LAGS = "Where the gyro is late, the least error is at that lag; a flat curve tells nothing."
TURNED = (
    "Each dot: what the direction of the acceleration turned within a window, over what the gyro says of it with the "
    "axes, factor and lag that were found. Dots on the line are explained; accelerations of the body scatter them."
)


def tables(found: Audit) -> list[Table]:
    """Faults, then properties."""
    head = ["", "certainty", "finding", "mend"]
    faults = [_row(one) for one in found.faults]
    notes = [[one.kind, one.certainty, one.sentence] for one in found.findings if not one.wrong]
    sure = frozenset(at for at, one in enumerate(found.faults) if one.sure_fault)
    wrong = Table("What is wrong", head, faults, "What `--mend` takes, or --as-found for all that is sure.", sure)
    return ([wrong] if faults else []) + [Table("What is known", ["", "certainty", "finding"], notes)]


def _row(one: Finding) -> list[str]:
    return [one.kind, one.certainty, one.sentence, " or ".join(word for word in (one.mend, one.other) if word)]


def plots(found: Audit) -> list[Plot | XyPlot]:
    """The explanation of the turning, the lag, and the samples as mended; those for which there is enough."""
    drawn: list[Plot | XyPlot] = []
    one = found.alignment
    if one is not None and one.turning is not None and one.told:
        drawn.append(_turned(one.turning.turned, one.turning.predicted, one.turning.explained))
    if one is not None and one.lags_s is not None and one.lag_errors is not None:
        curve = Curve("mean error of the carried acceleration", 1e3 * one.lags_s, one.lag_errors, ESTIMATE)
        drawn.append(XyPlot("Lag of the gyro", Axis("lag (ms)"), Axis("error (g)"), [curve], LAGS))
    if found.grid is not None:
        grid = found.grid
        for title, unit, values in (("Gyro", "deg/s", grid.gyr_dps), ("Accelerometer", "g", grid.acc_g)):
            lines = [
                Line(axis, column, COLOURS[at]) for at, (axis, column) in enumerate(zip("xyz", values.T, strict=True))
            ]
            note = "After the mends of clock, limits and accelerometer units that are sure."
            drawn.append(Plot(title, unit, grid.time_s, lines, note))
        length = np.linalg.norm(grid.acc_g, axis=1)
        lines = [Line("length", length, SENSOR), Line("1 g", np.ones(len(length)), SECOND)]
        drawn.append(Plot("Length of the acceleration", "g", grid.time_s, lines))
    return drawn


def _turned(turned: np.ndarray, predicted: np.ndarray, share: float) -> XyPlot:
    every = max(1, len(turned) // 600)
    curves = [
        Curve(axis, np.degrees(predicted[::every, at]), np.degrees(turned[::every, at]), COLOURS[at], points=True)
        for at, axis in enumerate("xyz")
    ]
    most = float(np.max(np.abs(np.degrees(predicted)), initial=1e-6))
    curves.append(Curve("explained", np.array([-most, most]), np.array([-most, most]), "#888888", dashed=True))
    x, y = Axis("by the gyro (deg/s)"), Axis("by the accelerometer (deg/s)")
    return XyPlot(f"Turning of the vertical: {100.0 * share:.0f} % explained", x, y, curves, TURNED)
