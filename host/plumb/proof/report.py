"""report.html: one self-contained page with the plots and tables of a run."""

from __future__ import annotations

import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.files import whole_files

POINTS_MAX = 2000
"""A plotted line keeps at most this many points: the extremes of each stretch, so that no spike is lost."""

TRUTH, SENSOR, ESTIMATE, SECOND = "#1d2430", "#c9a227", "#2a5ca8", "#b3261e"
"""Colours of the lines; each has the same meaning on every page."""

Series = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Line:
    label: str
    values: Series
    colour: str
    width: float = 1.2


@dataclass(frozen=True)
class Plot:
    """One panel: lines over a common time axis in seconds."""

    title: str
    unit: str
    time_s: Series
    lines: Sequence[Line]
    note: str = ""


def error_budget(time_s: Series, apart_deg: Series) -> Plot:
    """Panel of the arithmetic error, the last one of every report; apart_deg: integers minus float64 on the same
    counts."""
    return Plot(
        "Error budget: fixed point against float64, same counts",
        "deg",
        time_s,
        [Line("fixed - reference", apart_deg, ESTIMATE)],
        "The board against fixed is the third part of the budget: it must be, bit for bit, nothing.",
    )


@dataclass(frozen=True)
class Table:
    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    bad_rows: frozenset[int] = field(default_factory=frozenset)


def thin(time_s: Series, values: Series) -> tuple[Series, Series]:
    """At most POINTS_MAX points: the least and the greatest value of each equal stretch, in order of time."""
    if len(values) <= POINTS_MAX:
        return time_s, values
    stretch = -(-2 * len(values) // POINTS_MAX)
    keep = []
    for start in range(0, len(values), stretch):
        part = values[start : start + stretch]
        if np.all(np.isnan(part)):
            keep.append(start)
            continue
        keep.extend(sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))}))
    return time_s[keep], values[keep]


def drawing() -> ModuleType:
    """The matplotlib module; raises UsageError when it is missing. Call it before a run that cannot be repeated."""
    try:
        import matplotlib
    except ImportError:
        raise UsageError(f"the report page needs matplotlib; install it {install_hint('report')}") from None
    matplotlib.use("svg")
    return matplotlib


def plot_svg(*plots: Plot, titles: bool = False) -> str:
    """The panels, one above the other, as an SVG element; text stays text, so that it can be searched and scaled."""
    matplotlib = drawing()
    from matplotlib.figure import Figure

    # A fixed salt makes the ids in the file, and so the whole page, the same from run to run.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "plumb", "font.family": "sans-serif"}):
        figure = Figure(figsize=(10.5, 3.1 * len(plots)), layout="constrained")
        for plot, axes in zip(plots, figure.subplots(len(plots), squeeze=False)[:, 0], strict=True):
            for line in plot.lines:
                axes.plot(*thin(plot.time_s, line.values), label=line.label, color=line.colour, linewidth=line.width)
            if titles:
                axes.set_title(plot.title, loc="left", fontsize="medium")
            axes.set_xlabel("time (s)")
            axes.set_ylabel(plot.unit)
            axes.margins(x=0)
            axes.grid(alpha=0.3)
            if len(plot.lines) > 1:
                axes.legend(loc="upper right", fontsize="small", ncols=min(4, len(plot.lines)), framealpha=0.85)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
        sink = io.StringIO()
        figure.savefig(sink, format="svg", metadata={"Date": None, "Creator": None})
    text = sink.getvalue()
    return text[text.index("<svg") :]


def table_html(table: Table) -> str:
    def row(cells: Sequence[str], tag: str, bad: bool = False) -> str:
        mark = ' class="bad"' if bad else ""
        return f"<tr{mark}>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "\n".join(row(cells, "td", index in table.bad_rows) for index, cells in enumerate(table.rows))
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return f"<h2>{html.escape(table.title)}</h2>\n<table>\n{row(table.head, 'th')}\n{body}\n</table>\n{note}"


STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2430; background: #fff; max-width: 66rem; margin: 2rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0.2rem; } h2 { font-size: 1.1rem; margin: 2rem 0 0.4rem; }
.verdict { display: inline-block; padding: 0.2rem 0.7rem; border-radius: 0.3rem; color: #fff; font-weight: 600; }
.pass { background: #1a7f47; } .fail { background: #b3261e; } .unverified { background: #9a6700; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.9rem 0.25rem 0; text-align: left; border-bottom: 1px solid #d9dee6; }
tr.bad td { color: #b3261e; font-weight: 600; } .note { color: #58626f; font-size: 0.9rem; max-width: 50rem; }
svg { width: 100%; height: auto; }
/* On a narrow screen a plot keeps the size at which its labels can be read, and scrolls. */
.plot { overflow-x: auto; } .plot svg { min-width: 46rem; }
"""


def page(title: str, verdict: str, lead: str, parts: Sequence[Plot | Table]) -> str:
    """The whole page. verdict: pass, fail or unverified; lead: one plain sentence under the title."""
    body = []
    for part in parts:
        if isinstance(part, Table):
            body.append(table_html(part))
        else:
            note = f'<p class="note">{html.escape(part.note)}</p>' if part.note else ""
            body.append(f'<h2>{html.escape(part.title)}</h2>\n<div class="plot">{plot_svg(part)}</div>\n{note}')
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>\n"
        f"<h1>{html.escape(title)}</h1>\n"
        f'<p><span class="verdict {verdict}">{verdict}</span> {html.escape(lead)}</p>\n'
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def write_whole(folder: Path, texts: Mapping[str, str]) -> None:
    """Write the files, or leave what was there: all are written beside their places before the first one moves in."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write {folder}: {error.strerror}; choose another folder with --out") from None
    whole_files.write_whole({folder / name: text for name, text in texts.items()}, "choose another folder with --out")
