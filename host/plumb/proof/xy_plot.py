"""Draw curves over any quantity, on linear or logarithmic axes, as SVG: Allan plots, Bode plots, correlations.

svg_plot draws plots over time, which the reader can zoom; the plots of this module are static. Margins, colours and
text are the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumb.proof.svg_plot import (
    BOTTOM,
    COLUMNS,
    LEFT,
    RIGHT,
    STYLE,
    TITLE,
    TOP,
    VALUE_TICKS,
    WIDTH,
    escaped,
    path,
    stroke,
    tick_text,
    ticks,
)  # fmt: skip
from plumb.spec.arrays import FloatArray

HEIGHT = 330
DOT = 2.5
"""Radius of a point, pixels."""
LETTER, LINE = 6.6, 13.0
"""Width of a letter and height of a line in the names of points, pixels."""
MINOR_DECADES = 3
"""Logarithmic axes of at most this many decades have ticks at 2 and 5, too."""


@dataclass(frozen=True)
class Curve:
    """Values y over x, (points,); NaN is a gap. low, high: ends of the bars of uncertainty; points: dots, no line;
    dashed: a line of dashes. names: of the points, written next to them; () for none. hints: of the points, shown where
    the reader points at one; () for none."""

    label: str
    x: FloatArray
    y: FloatArray
    colour: str
    width: float = 1.5
    low: FloatArray | None = None
    high: FloatArray | None = None
    points: bool = False
    dashed: bool = False
    names: Sequence[str] = ()
    hints: Sequence[str] = ()


@dataclass(frozen=True)
class Axis:
    """label: quantity and unit. low, high: ends; None: those of the curves."""

    label: str
    log: bool = False
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class XyPlot:
    """One panel."""

    title: str
    x: Axis
    y: Axis
    curves: Sequence[Curve]
    note: str = ""


@dataclass(frozen=True)
class _Scale:
    """An axis on the page: value to pixels, and its ticks with their texts."""

    low: float
    high: float
    log: bool
    start_px: float
    length_px: float

    def __call__(self, values: FloatArray) -> FloatArray:
        shown = np.full(np.shape(values), np.nan)
        usable = np.isfinite(values) & ((np.asarray(values) > 0.0) if self.log else True)
        shown[usable] = self._place(np.asarray(values, np.float64)[usable])
        return shown

    def _place(self, values: FloatArray) -> FloatArray:
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        share = ((np.log(values) if self.log else values) - low) / (high - low)
        return self.start_px + np.clip(share, -10.0, 10.0) * self.length_px

    def marks(self, most: int) -> list[tuple[float, str]]:
        if not self.log:
            found = ticks(self.low, self.high, most)
            step = found[1] - found[0] if len(found) > 1 else 1.0
            return [(value, tick_text(value, step)) for value in found]
        first, last = math.floor(math.log10(self.low) + 1e-9), math.ceil(math.log10(self.high) - 1e-9)
        parts = (1.0, 2.0, 5.0) if last - first <= MINOR_DECADES else (1.0,)
        every = max(1, -(-(last - first) // most))
        values = [part * 10.0**decade for decade in range(first, last + 1, every) for part in parts]
        inside = [v for v in values if self.low * (1 - 1e-9) <= v <= self.high * (1 + 1e-9)]
        return [(value, f"{value:g}") for value in inside]


def _range(axis: Axis, given: Sequence[FloatArray]) -> tuple[float, float]:
    """Ends of an axis: those that it names, else those of the values with a margin."""
    parts = [np.asarray(values, np.float64)[np.isfinite(values)] for values in given]
    every = np.concatenate(parts) if parts else np.empty(0)
    every = every[every > 0.0] if axis.log else every
    low, high = (float(every.min()), float(every.max())) if every.size else (1.0, 10.0) if axis.log else (0.0, 1.0)
    if axis.log:
        low, high = (low / 1.15, high * 1.15) if high > 1.001 * low else (low / 3.0, high * 3.0)
    elif high - low <= 1e-12 * max(abs(low), abs(high)):
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    else:
        low, high = low - 0.04 * (high - low), high + 0.04 * (high - low)
    return low if axis.low is None else axis.low, high if axis.high is None else axis.high


def _ends(curve: Curve) -> list[FloatArray]:
    return [curve.y, *(bar for bar in (curve.low, curve.high) if bar is not None)]


def panel(plot: XyPlot, index: str) -> str:
    """The inside of the drawing. index: makes its clipping path's name unique in the document."""
    floor = HEIGHT - BOTTOM
    x = _Scale(*_range(plot.x, [curve.x for curve in plot.curves]), plot.x.log, LEFT, COLUMNS)
    y = _Scale(*_range(plot.y, [v for curve in plot.curves for v in _ends(curve)]), plot.y.log, floor, TOP - floor)
    marks = []
    for value, text in x.marks(10):
        at = float(x(np.array([value]))[0])
        anchor = f't e" x="{WIDTH - 1}' if at > WIDTH - RIGHT - 6 else f't" x="{at:.1f}'
        marks.append(
            f'<path class="grid" d="M{at:.1f},{TOP}V{floor}"/><text class="{anchor}" y="{floor + 16}">{text}</text>'
        )
    for value, text in y.marks(VALUE_TICKS):
        at = float(y(np.array([value]))[0])
        marks.append(
            f'<path class="grid" d="M{LEFT},{at:.1f}H{WIDTH - RIGHT}"/>'
            f'<text class="v" x="{LEFT - 7}" y="{at + 4:.1f}">{text}</text>'
        )
    drawn = "".join(_curve(curve, x, y) + _names(curve, x, y) for curve in plot.curves)
    return (
        f'<clipPath id="xy{index}"><rect x="{LEFT}" y="{TOP}" width="{COLUMNS}" height="{floor - TOP}"/></clipPath>'
        f'<g class="ticks">{"".join(marks)}</g><path class="axis" d="M{LEFT},{TOP}V{floor}H{WIDTH - RIGHT}"/>'
        f'<g class="lines" clip-path="url(#xy{index})">{drawn}</g>'
        f'<text class="t" x="{LEFT + COLUMNS / 2:g}" y="{HEIGHT - 6}">{escaped(plot.x.label)}</text>'
        f'<text class="u" transform="translate(16,{(TOP + floor) / 2:g}) rotate(-90)">'
        f"{escaped(plot.y.label)}</text>"
    )


def _curve(curve: Curve, x: _Scale, y: _Scale) -> str:
    css, across, down = stroke(curve.colour), x(curve.x), y(curve.y)
    drawn = ""
    if curve.low is not None and curve.high is not None:
        bars = zip(across.tolist(), y(curve.low).tolist(), y(curve.high).tolist(), strict=True)
        d = "".join(f"M{at:.1f},{low:.1f}V{high:.1f}" for at, low, high in bars if math.isfinite(at + low + high))
        drawn += f'<path style="stroke:{css};stroke-width:1;opacity:.6" d="{d}"/>'
    if curve.points:
        dots = zip(across.tolist(), down.tolist(), curve.hints or [""] * len(down), strict=True)
        drawn += "".join(
            f'<circle style="fill:{css};stroke:none" cx="{at:.1f}" cy="{value:.1f}" r="{DOT}"'
            + (f"><title>{escaped(hint)}</title></circle>" if hint else "/>")
            for at, value, hint in dots
            if math.isfinite(at + value)
        )
        return drawn
    dash = ";stroke-dasharray:5 4" if curve.dashed else ""
    return f'{drawn}<path style="stroke:{css};stroke-width:{curve.width:g}{dash}" d="{path(across, down)}"/>'


def _names(curve: Curve, x: _Scale, y: _Scale) -> str:
    """The names of the points, to the right of them, or to the left near the right edge; moved down where names would
    overlap."""
    said: list[str] = []
    taken: list[tuple[float, float, float]] = []
    for across, down, name in sorted(zip(x(curve.x), y(curve.y), curve.names, strict=False), key=lambda one: one[1]):
        end, width = across > LEFT + 0.75 * COLUMNS, LETTER * len(name)
        left = across - 8.0 - width if end else across + 8.0
        while any(abs(down - at) < LINE and left < right and begin < left + width for begin, right, at in taken):
            down += 1.0
        taken.append((left, left + width, down))
        place = f'style="text-anchor:end" x="{left + width:.1f}"' if end else f'x="{left:.1f}"'
        said.append(f'<text {place} y="{down + 4:.1f}">{escaped(name)}</text>')
    return "".join(said)


def plot_svg(plot: XyPlot) -> str:
    """The panel with its title, as an SVG that stands alone on a white ground."""
    words, drawn = escaped(described(plot)), panel(plot, "0")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT + TITLE}" role="img" '
        f'aria-label="{words}" style="background:#fff"><style>{STYLE}</style>'
        f'<text class="h" x="{LEFT}" y="20">{escaped(plot.title)}</text>{_legend(plot)}'
        f'<g transform="translate(0,{TITLE})">{drawn}</g></svg>'
    )


def _legend(plot: XyPlot) -> str:
    """The labels of the curves in their colours, right of the title; "" for one curve, and where points have names."""
    if len(plot.curves) < 2 or any(curve.names for curve in plot.curves):
        return ""
    said = "".join(
        f'<tspan dx="14" style="fill:{curve.colour}">{escaped(curve.label)}</tspan>' for curve in plot.curves
    )
    return f'<text x="{LEFT + COLUMNS - 20}" y="20" style="text-anchor:end">{said}</text>'


def described(plot: XyPlot) -> str:
    """The plot in words, for readers who do not see it."""
    said = []
    for curve in plot.curves:
        finite = curve.y[np.isfinite(curve.y)]
        said.append(f"{curve.label}, from {finite.min():.4g} to {finite.max():.4g}" if finite.size else curve.label)
    return f"{plot.title}: {plot.y.label} over {plot.x.label}. " + "; ".join(said) + "."


def plot_html(plot: XyPlot, index: int) -> str:
    """Heading, legend, drawing and note."""
    keys = "".join(
        f'<span class="key"><i style="border-color:{stroke(curve.colour)};'
        f'border-top-style:{"dashed" if curve.dashed else "dotted" if curve.points else "solid"}"></i>'
        f"{escaped(curve.label)}</span>"
        for curve in plot.curves
    )
    note = f'<p class="note">{escaped(plot.note)}</p>\n' if plot.note else ""
    words = escaped(described(plot))
    return (
        f'<section class="still"><h2>{escaped(plot.title)}</h2>\n<div class="keys">{keys}</div>\n'
        f'<div class="frame"><svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{words}">'
        f"{panel(plot, str(index))}</svg></div>\n{note}</section>"
    )
