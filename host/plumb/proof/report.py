"""report.html: one self-contained page with the plots and tables of a run.

The page works from one file and without a network. Its plots stand as SVG in the page; report.js, which the page
contains, lets the reader zoom, pan and read values, and redraws from samples that the page contains too.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.files import whole_files
from plumb.proof import xy_plot
from plumb.proof.svg_plot import (
    ESTIMATE,
    HEIGHT,
    SECOND,
    SENSOR,
    STYLE,
    TRUTH,
    WIDTH,
    Line,
    Plot,
    Series,
    described,
    escaped,
    kept,
    panel,
    plot_svg,
    stroke,
)  # fmt: skip
from plumb.proof.xy_plot import XyPlot

__all__ = [
    "ESTIMATE", "SAMPLES_MAX", "SECOND", "SENSOR", "TRUTH", "TWO_SIGMA", "Line", "Plot", "Series", "Statement", "Table",
    "error_and_band", "error_budget", "of_band", "page", "plot_svg", "write_whole",
]  # fmt: skip

SAMPLES_MAX = 30_000
"""Most samples of a line in the page, for zooming: all of them up to 60 s at 500 Hz. For longer runs the page has the
least and the greatest value of each equal stretch, so that no spike is lost, and says so."""


def error_budget(time_s: Series, apart_deg: Series) -> Plot:
    """Panel of the arithmetic error, the last panel of every report; apart_deg: integers minus float64 on the same
    counts."""
    return Plot(
        "Error budget: integers against float64",
        "deg",
        time_s,
        [Line("integers against float64", apart_deg, ESTIMATE)],
        "What rounding costs: the integers against the published equations in float64, on the same raw counts.",
    )


MANY_COLUMNS = 3
"""Tables with more columns do not break words, and scroll on a narrow screen; other tables break long words."""

TWO_SIGMA = (
    "The band is two standard deviations of the filter's own variance to either side: where its model of noise and "
    "motion holds, 95 % of the errors are inside."
)


def of_band(offset_g: float) -> str:
    """Note that explains the band of a tilt. offset_g: the standard deviation of the accelerometer's offset that it
    includes, in g."""
    offset_deg = float(np.degrees(offset_g))
    return (
        f"{TWO_SIGMA} It includes the offset that is declared for the accelerometer, {1e3 * offset_g:.3g} mg or "
        f"{offset_deg:.2f} deg (standard deviation over devices): a constant error of one device, which no filter sees."
    )


def error_and_band(time_s: Series, error_deg: Series, band_deg: Series, offset_g: float) -> Plot:
    """Panel of an estimate's error, and around 0 the band that is expected: of the filter itself and of the
    accelerometer's offset, in g; both deg, (steps,)."""
    lines = [
        Line("expected: 0 ± 2 sigma", np.zeros(len(error_deg)), ESTIMATE, 0.8, band_deg),
        Line("estimate - truth", error_deg, SECOND),
    ]
    return Plot("Error of the estimate", "deg", time_s, lines, of_band(offset_g))


@dataclass(frozen=True)
class Table:
    """bad_rows: indices of rows that stand out. folded: shown when the reader opens it, and never printed."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    bad_rows: frozenset[int] = field(default_factory=frozenset)
    folded: bool = False


@dataclass(frozen=True)
class Statement:
    """One statement of the page about the run: its subject, the text, and whether it is good (None: unknown)."""

    of: str
    text: str
    good: bool | None

    def __str__(self) -> str:
        return f"{self.of}: {self.text}"


def table_html(table: Table) -> str:
    def row(cells: Sequence[str], tag: str, bad: bool = False) -> str:
        mark = ' class="bad"' if bad else ""
        return f"<tr{mark}>" + "".join(f"<{tag}>{escaped(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "\n".join(row(cells, "td", index in table.bad_rows) for index, cells in enumerate(table.rows))
    head = row(table.head, "th") if any(table.head) else ""
    note = f'\n<p class="note">{escaped(table.note)}</p>' if table.note else ""
    kind = "wide many" if len(table.head) > MANY_COLUMNS else "wide"
    whole = f'<div class="{kind}"><table>\n{head}\n{body}\n</table></div>{note}'
    title = escaped(table.title)
    return f"<details><summary>{title}</summary>\n{whole}</details>" if table.folded else f"<h2>{title}</h2>\n{whole}"


def packed(values: npt.NDArray[np.float64]) -> str:
    """Little-endian float32 in base64, the format that report.js reads."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


def samples(plot: Plot) -> dict[str, object]:
    """The plot's samples for report.js. time: [start, period] in s where the samples are evenly spaced, else packed."""
    lines = []
    for line in plot.lines:
        at = kept(line.values, SAMPLES_MAX)
        time_s = np.asarray(plot.time_s, np.float64)[at]
        period_s = (time_s[-1] - time_s[0]) / (len(at) - 1) if len(at) > 1 else 1.0
        even = len(at) > 0 and bool(np.allclose(time_s, time_s[0] + period_s * np.arange(len(at)), rtol=0.0, atol=1e-6))
        time = [float(time_s[0]), float(f"{period_s:.12g}")] if even else packed(time_s)
        band = None if line.band is None else packed(np.asarray(line.band, np.float64)[at])
        lines.append({"time": time, "values": packed(np.asarray(line.values, np.float64)[at]), "band": band})
    return {"lines": lines}


def plot_html(plot: Plot, index: int) -> str:
    """Heading, legend, panel and note of one plot."""
    keys = "".join(
        f'<button type="button" class="key" aria-pressed="true"><i style="border-color:{stroke(line.colour)}"></i>'
        f'{escaped(line.label)}<output aria-live="off"></output></button>'
        for line in plot.lines
    )
    notes = [plot.note] if plot.note else []
    if len(plot.time_s) > SAMPLES_MAX:
        stretch = -(-2 * len(plot.time_s) // SAMPLES_MAX)
        notes.append(f"Drawn of {len(plot.time_s)} samples: the least and the greatest of each {stretch} in a row.")
    note = f'<p class="note">{escaped(" ".join(notes))}</p>\n' if notes else ""
    words = escaped(described(plot))
    title = escaped(plot.title)
    body = (
        f'<div class="keys">{keys}</div>\n'
        f'<div class="frame"><svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{words}">'
        f"{panel(plot, str(index))}</svg></div>\n{note}"
    )
    body = f"<details><summary>{title}</summary>\n{body}</details>" if plot.folded else f"<h2>{title}</h2>\n{body}"
    return f'<section class="plot" id="plot{index}">{body}</section>'


TOOLS = (
    '<div class="tools" role="toolbar" aria-label="Time axis of all plots">'
    + "".join(
        f'<button type="button" data-act="{act}" title="{words}" aria-label="{words}">{sign}</button>'
        for act, sign, words in (
            ("in", "+", "zoom in"),
            ("out", "−", "zoom out"),
            ("left", "←", "earlier"),
            ("right", "→", "later"),
            ("all", "whole run", "whole run"),
        )
    )
    + '<output aria-live="off"></output><p class="note">Drag across: zoom time in all plots; drag down: zoom values. '
    "Shift and drag, or a finger: pan. Ctrl and wheel: zoom. Double click: whole run. Keys: + − ← → 0. Click on a "
    "name: hide the line.</p></div>"
)


@cache
def _asset(name: str) -> str:
    """A file in the folder of this one, which the wheel ships."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def page(
    title: str, verdict: str, lead: str, parts: Sequence[Plot | XyPlot | Table], statements: Sequence[Statement] = ()
) -> str:
    """The whole page. verdict: pass, fail or unverified, "": the page judges nothing; lead: one plain sentence under
    the title; statements: what the verdict means, below it. The drawings stand before the tables, each kind in the
    given order."""
    parts = sorted(parts, key=lambda part: isinstance(part, Table))
    plots = [part for part in parts if isinstance(part, Plot)]
    body, drawn, noted = [], 0, {""}
    for index, part in enumerate(parts):
        if isinstance(part, Table):
            body.append(table_html(part))
        elif isinstance(part, XyPlot):
            body.append(xy_plot.plot_html(part, index))
        else:
            shown = replace(part, note="") if part.note in noted else part  # a note of several plots stands once
            body += ([TOOLS] if not drawn else []) + [plot_html(shown, drawn)]
            noted.add(part.note)
            drawn += 1
    data = json.dumps([samples(plot) for plot in plots], separators=(",", ":")).replace("<", "\\u003c")
    script = _asset("report.js")
    # The one script that the browser may run is the one whose hash stands here; nothing is fetched.
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{allowed}'"
    badge = f'<span class="verdict {escaped(verdict)}">{escaped(verdict)}</span> ' if verdict else ""
    stated = "".join(
        f'<li class="{"unverified" if one.good is None else "pass" if one.good else "fail"}">'
        f"<b>{escaped(one.of)}:</b> <span>{escaped(one.text)}</span></li>"
        for one in statements
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escaped(title)}</title>\n<style>{_asset('report.css')}{STYLE}</style></head><body>\n"
        f"<h1>{escaped(title)}</h1>\n"
        f"<p>{badge}{escaped(lead)}</p>\n"
        + (f'<ul class="stated">{stated}</ul>\n' if stated else "")
        + "\n".join(body)
        + f'\n<script type="application/json" id="plot-data">{data}</script>\n<script>{script}</script>\n'
        + "</body></html>\n"
    )


def write_whole(folder: Path, texts: Mapping[str, str]) -> None:
    """Write all files, or keep the old ones: each is written under a temporary name in the same folder before the first
    one replaces its old file."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write {folder}: {error.strerror}; choose another folder with --out") from None
    whole_files.write_whole({folder / name: text for name, text in texts.items()}, "choose another folder with --out")
