"""Draw time series as SVG: one panel or several, whose time axes begin and end at the same place.

No library draws: a panel is a path for each line, its ticks, and text that stays text. A path has at most two points
for each pixel column, the least and the greatest value of the column, so no spike is lost. report.js draws the same
panels again when the reader zooms, by the same rules.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Series = npt.NDArray[np.float64] | npt.NDArray[np.float32]

TRUTH, SENSOR, ESTIMATE, SECOND = "#1d2430", "#b08600", "#2a5ca8", "#b3261e"
"""Colours of the lines, each with one meaning on every page. A page in dark mode has lighter colours of the same
names."""
_NAMES = {TRUTH: "truth", SENSOR: "sensor", ESTIMATE: "estimate", SECOND: "second"}

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1056, 250, 76, 12, 10, 42
"""Size of a panel and its margins, pixels. report.js has the same numbers."""
COLUMNS = WIDTH - LEFT - RIGHT
TITLE = 24
"""Height of a panel's title and legend where they are part of the drawing, pixels."""
TIME_TICKS, VALUE_TICKS = 10, 7
"""Most intervals between ticks, about."""
BAND_SHARE = 0.5
"""A band widens the axis of values by at most this share of the lines' span on either side."""


@dataclass(frozen=True)
class Line:
    """values: at the times of the plot, in its unit; NaN is a gap. colour: #rrggbb. width: pixels. band: half the width
    of a band around the line, in the same unit, None: no band."""

    label: str
    values: Series
    colour: str
    width: float = 1.2
    band: Series | None = None


@dataclass(frozen=True)
class Plot:
    """One panel: lines over a common time axis in seconds. folded: a page shows it when the reader opens it."""

    title: str
    unit: str
    time_s: Series
    lines: Sequence[Line]
    note: str = ""
    folded: bool = False


def escaped(text: str) -> str:
    """Text for an element or an attribute; control characters and invalid bytes become backslash escapes, line ends
    stay."""
    shown = (c if c.isprintable() or c == "\n" else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
    return html.escape("".join(shown))


def kept(values: Series, most: int) -> npt.NDArray[np.intp]:
    """Indices of at most `most` samples: the least and the greatest of each equal stretch, in order of time."""
    if len(values) <= most:
        return np.arange(len(values))
    stretch = -(-2 * len(values) // most)
    found: list[int] = []
    for start in range(0, len(values), stretch):
        part = values[start : start + stretch]
        if np.all(np.isnan(part)):
            found.append(start)
            continue
        found.extend(sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))}))
    return np.array(found, np.intp)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers from low to high, spaced by 1, 2 or 5 times a power of ten, in at most about `most` intervals."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def tick_text(value: float, step: float) -> str:
    """A tick's number with the decimals that its step needs; with an exponent where these are many."""
    if abs(value) < 1e-9 * step:
        return "0"
    if step < 1e-4 or abs(value) >= 1e6:
        return re.sub(r"e([+-])0*", r"e\1", f"{value:.3g}").replace("e+", "e")
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}"


def value_range(lines: Sequence[Line]) -> tuple[float, float]:
    """Ends of the axis of values: all lines, their bands up to BAND_SHARE, and a margin of 4 %."""
    finite = [line.values[np.isfinite(line.values)] for line in lines]
    if not any(values.size for values in finite):
        return -1.0, 1.0
    low = min(float(values.min()) for values in finite if values.size)
    high = max(float(values.max()) for values in finite if values.size)
    room = BAND_SHARE * (high - low)
    edges = [line.values + sign * line.band for line in lines if line.band is not None for sign in (-1.0, 1.0)]
    banded = np.concatenate([edge[np.isfinite(edge)] for edge in edges]) if edges else np.empty(0)
    if banded.size:
        low = min(low, max(low - room, float(banded.min())))
        high = max(high, min(high + room, float(banded.max())))
    if high - low <= 1e-12 * max(abs(high), abs(low)):
        apart = 0.5 * abs(high) or 1.0
        return low - apart, high + apart
    margin = 0.04 * (high - low)
    return low - margin, high + margin


def time_range(time_s: Series) -> tuple[float, float]:
    """Ends of the time axis, s; a plot of one sample or none still has an axis."""
    if not len(time_s):
        return 0.0, 1.0
    low, high = float(time_s[0]), float(time_s[-1])
    return (low, high) if high > low else (low, low + 1.0)


def stroke(colour: str) -> str:
    """A colour as CSS: the page's name for it, which follows dark mode, and itself where no page stands around."""
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
        raise ValueError(f"a colour is #rrggbb, not {colour!r}")
    return f"var(--{_NAMES[colour]},{colour})" if colour in _NAMES else colour


def path(x: Series, y: Series) -> str:
    """The path through the points; a point that is no number is a gap."""
    pieces, pen = [], "M"
    for left, down in zip(x.tolist(), y.tolist(), strict=True):
        if math.isfinite(down):
            pieces.append(f"{pen}{left:.1f},{down:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(pieces)


def _anchored(x: float) -> str:
    """Class and x of a label below the time axis: centred, and at the right end within the drawing."""
    return f't e" x="{WIDTH - 1}' if x > WIDTH - RIGHT - 6 else f't" x="{x:.1f}'


def panel(plot: Plot, index: str, top: float = 0.0) -> str:
    """The inside of a panel, `top` pixels down. index: makes its clipping path's name unique in the document."""
    (start, end), (low, high) = time_range(plot.time_s), value_range(plot.lines)
    floor = HEIGHT - BOTTOM

    def x_of(time_s: Series) -> Series:
        return LEFT + (time_s - start) / (end - start) * COLUMNS

    def y_of(value: Series) -> Series:
        return floor - (value - low) / (high - low) * (floor - TOP)

    times, values = np.array(ticks(start, end, TIME_TICKS)), np.array(ticks(low, high, VALUE_TICKS))
    time_step, value_step = (float(at[1] - at[0]) if len(at) > 1 else 1.0 for at in (times, values))
    marks = [
        f'<path class="grid" d="M{x_of(t):.1f},{TOP}V{floor}"/>'
        f'<text class="{_anchored(float(x_of(t)))}" y="{floor + 16}">{tick_text(t, time_step)}</text>'
        for t in times
    ]
    marks += [
        f'<path class="grid" d="M{LEFT},{y_of(v):.1f}H{WIDTH - RIGHT}"/>'
        f'<text class="v" x="{LEFT - 7}" y="{y_of(v) + 4:.1f}">'
        f"{tick_text(v, value_step)}</text>"
        for v in values
    ]
    drawn = []
    for line in plot.lines:
        at = kept(line.values, 2 * COLUMNS)
        x, y, css = x_of(plot.time_s[at]), line.values[at], stroke(line.colour)
        if line.band is not None:
            there = np.isfinite(line.values) & np.isfinite(line.band)
            at_band = np.flatnonzero(there)[:: max(1, int(there.sum()) // COLUMNS)]
            around, half = line.values[at_band], line.band[at_band]
            x_band = x_of(plot.time_s[at_band])
            outline = path(np.r_[x_band, x_band[::-1]], np.r_[y_of(around + half), y_of(around - half)[::-1]])
            drawn.append(f'<path class="band" style="fill:{css}" d="{outline}"/>')
        drawn.append(f'<path style="stroke:{css};stroke-width:{line.width:g}" d="{path(x, y_of(y))}"/>')
    shift = f' transform="translate(0,{top:g})"' if top else ""
    return (
        f'<g{shift}><clipPath id="clip{index}"><rect x="{LEFT}" y="{TOP}" width="{COLUMNS}" height="{floor - TOP}"/>'
        f'</clipPath><g class="ticks">{"".join(marks)}</g>'
        f'<path class="axis" d="M{LEFT},{TOP}V{floor}H{WIDTH - RIGHT}"/>'
        f'<g class="lines" clip-path="url(#clip{index})">{"".join(drawn)}</g>'
        f'<text class="t" x="{LEFT + COLUMNS / 2:g}" y="{HEIGHT - 6}">time (s)</text>'
        f'<text class="u" transform="translate(16,{(TOP + floor) / 2:g}) rotate(-90)">{escaped(plot.unit)}</text>'
        "</g>"
    )


def described(plot: Plot) -> str:
    """The plot in words, for readers who do not see it: its lines, their ranges, and the time."""
    start, end = time_range(plot.time_s)
    lines = []
    for line in plot.lines:
        finite = line.values[np.isfinite(line.values)]
        span = f"from {finite.min():.4g} to {finite.max():.4g} {plot.unit}" if finite.size else "no values"
        lines.append(f"{line.label}, {span}" + (", with a band" if line.band is not None else ""))
    return f"{plot.title}, {start:g} s to {end:g} s. " + "; ".join(lines) + "."


STYLE = (
    "text{font:12px system-ui,sans-serif;fill:var(--text,#1d2430)}.t,.u{text-anchor:middle}.v,.t.e{text-anchor:end}"
    ".h{font-size:14px}.grid{stroke:var(--rule,#d9dee6)}.axis{stroke:var(--soft,#58626f)}.lines path,.axis{fill:none}"
    ".lines path{vector-effect:non-scaling-stroke;stroke-linejoin:round}"
    ".lines .band{stroke:none;fill-opacity:.18}"
)
"""Style of a panel, in a page and alone."""


def plot_svg(*plots: Plot) -> str:
    """The panels with titles and legends, one above the other, as an SVG that stands alone on a white ground."""
    each = HEIGHT + TITLE
    parts = []
    for index, plot in enumerate(plots):
        legend = [f'<text class="h" x="{LEFT}" y="{index * each + 20}">{escaped(plot.title)}</text>']
        if len(plot.lines) > 1:
            x = WIDTH - RIGHT - sum(34.0 + 6.6 * len(line.label) for line in plot.lines)
            for line in plot.lines:
                legend.append(
                    f'<path style="stroke:{stroke(line.colour)};stroke-width:2" d="M{x:.1f},{index * each + 16}h18"/>'
                    f'<text x="{x + 23:.1f}" y="{index * each + 20}">{escaped(line.label)}</text>'
                )
                x += 34.0 + 6.6 * len(line.label)
        parts += [*legend, panel(plot, str(index), index * each + TITLE)]
    words = escaped(" ".join(described(plot) for plot in plots))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {each * len(plots)}" role="img" '
        f'aria-label="{words}" style="background:#fff"><style>{STYLE}</style>{"".join(parts)}</svg>'
    )
