"""The page of a check of golden vectors: every vector on every board, and a plot around each first divergence.

One HTML file without scripts, fonts or images from elsewhere; light or dark as the reader's system is.
"""

from __future__ import annotations

import html
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from plumb.proof.golden_result import Result, VectorResult
from plumb.proof.golden_window import AROUND_STEPS, Window
from plumb.version import installed

WIDTH, LEFT, RIGHT = 960, 170, 12
"""Of a plot, in its own units; LEFT and RIGHT are the margins beside the axes, the same in every panel."""
PANEL, GAP, BOTTOM = 150, 34, 40
NEAR_STEPS = 5
"""Rows of the table before and after the step that differs first."""

STYLE = """
:root { color-scheme: light dark; --text: #1d2430; --soft: #58626f; --line: #d9dee6; --page: #fff; --expected: #2a5ca8;
        --got: #b3261e; --pass: #1a7f47; --fail: #b3261e; --unverified: #9a6700; }
@media (prefers-color-scheme: dark) {
  :root { --text: #e6e9ee; --soft: #a3adba; --line: #39424f; --page: #14181e; --expected: #7fb0ff; --got: #ff8a80;
          --pass: #2e9d5f; --fail: #d0453c; --unverified: #b98512; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: var(--page); max-width: 66rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0.2rem; }
h2 { font-size: 1.2rem; margin: 2rem 0 0.4rem; overflow-wrap: anywhere; }
.verdict { display: inline-block; padding: 0.1rem 0.6rem; border-radius: 0.3rem; color: #fff; font-weight: 600; }
.verdict.pass { background: var(--pass); } .verdict.fail { background: var(--fail); }
.verdict.unverified { background: var(--unverified); }
.soft { color: var(--soft); font-size: 0.9rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2rem 1rem 0.2rem 0; text-align: left; border-bottom: 1px solid var(--line); white-space: nowrap;
         vertical-align: top; }
.text td { white-space: normal; overflow-wrap: anywhere; } .text td:first-child { min-width: 9rem; }
.wide + .wide { margin-top: 1rem; }
td.fail, tr.first td { color: var(--fail); font-weight: 600; } td.unverified { color: var(--unverified); }
svg { width: 100%; min-width: 46rem; height: auto; display: block; }
svg text { fill: var(--text); font-size: 13px; } svg text.soft { fill: var(--soft); font-size: 13px; }
svg .axis { stroke: var(--line); fill: none; } svg .first { stroke: var(--fail); stroke-dasharray: 4 3; }
svg .expected { stroke: var(--expected); fill: none; stroke-width: 1.6; }
svg .got, svg text.got { fill: var(--got); } svg text.key { fill: var(--expected); }
"""


def page(
    results: Mapping[str, Result],
    errors: Mapping[str, str],
    windows: Sequence[Window],
    verdict: str,
    parts: Mapping[str, Mapping[str, object]] | None = None,
    identity: Sequence[tuple[str, str]] = (),
) -> str:
    """The whole page. errors: board -> why its check ended early. parts: board -> what ran its steps, as
    `run_identity.part_of` has it. identity: name and value of everything else that the check was made with."""
    meaning = {
        "pass": "bit-exact: every step of every vector equals the integer model.",
        "fail": "not bit-exact: at least one step differs from the integer model.",
        "unverified": "answers were lost, or a board did not finish: neither right nor wrong.",
    }[verdict]
    body = [f'<p><span class="verdict {verdict}">{verdict}</span> {meaning}</p>']
    commit = f", commit {installed().commit}" if installed().commit else ""
    body.append(f'<p class="soft">plumb {_text(installed().version + commit)}, {_date()}</p>')
    body += [
        f'<p><span class="verdict unverified">ended early</span> {_text(board)}: {_text(why)}</p>'
        for board, why in errors.items()
    ]
    body.append(_boards_table(results))
    body.append(_images_table(parts or {}))
    body += [_section(window) for window in windows]
    if not windows:
        body.append('<p class="soft">No board differs from a vector, so there is nothing to plot.</p>')
    body.append(_vectors_table(results))
    if identity:
        rows = [f"<tr><td>{_text(name)}</td><td>{_text(value)}</td></tr>" for name, value in identity]
        body.append("<h2>Identity</h2>\n" + _table((), rows, "wide text"))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Golden vectors: {verdict}</title><style>{STYLE}</style></head><body>\n"
        "<h1>Golden vectors</h1>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def _text(text: str) -> str:
    """Escaped, with invalid bytes and control characters as backslash escapes."""
    plain = "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
    return html.escape(plain)


def _date() -> str:
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    known = epoch.isascii() and epoch.isdigit() and len(epoch) <= 10
    when = datetime.fromtimestamp(int(epoch), UTC) if known else datetime.now(UTC)
    return when.strftime("%Y-%m-%d %H:%M UTC")


def _table(head: Sequence[str], rows: Sequence[str], kind: str = "wide") -> str:
    """kind: wide, its lines are not broken and it scrolls on a narrow screen; wide text, they are."""
    cells = "".join(f"<th>{_text(cell)}</th>" for cell in head)
    first = f"<tr>{cells}</tr>\n" if head else ""
    return f'<div class="{kind}"><table>\n{first}' + "\n".join(rows) + "\n</table></div>"


def _boards_table(results: Mapping[str, Result]) -> str:
    rows = [
        f'<tr><td>{_text(board)}</td><td class="{one.verdict}">{one.verdict}</td><td>{one.vectors}</td>'
        f"<td>{one.steps}</td><td>{one.mismatches}</td></tr>"
        for board, one in results.items()
    ]
    return _table(["board", "verdict", "vectors", "steps", "mismatches"], rows, "wide text")


def _images_table(parts: Mapping[str, Mapping[str, object]]) -> str:
    """A row for every board that runs an image, or says which commit its image is of; empty where none does."""
    rows = []
    for board, part in parts.items():
        image, commit = part.get("image"), part.get("firmware_git_hash")
        if isinstance(image, Mapping) or commit:
            known = image if isinstance(image, Mapping) else {}
            cells = (board, known.get("file", ""), known.get("sha256", ""), known.get("compiler") or "", commit or "")
            rows.append("<tr>" + "".join(f"<td>{_text(str(cell))}</td>" for cell in cells) + "</tr>")
    head = ["board", "image", "SHA-256", "compiler", "commit, as the board says"]
    return "<h2>What ran</h2>\n" + _table(head, rows) if rows else ""


def _vectors_table(results: Mapping[str, Result]) -> str:
    """A row for every vector, a column for every board; a dash where the board does not take the vector."""
    found: dict[str, dict[str, VectorResult]] = {}
    for board, result in results.items():
        for row in result.rows:
            found.setdefault(row.vector, {})[board] = row
    rows = []
    for vector, cells in found.items():
        one = next(iter(cells.values()))
        marks = "".join(_mark(cells.get(board)) for board in results)
        rows.append(f"<tr><td>{_text(vector)}</td><td>{_text(one.system)}</td><td>{one.steps}</td>{marks}</tr>")
    return "<h2>Every vector</h2>\n" + _table(["vector", "system", "steps", *results], rows)


def _mark(row: VectorResult | None) -> str:
    if row is None:
        return "<td>-</td>"
    first = row.first_divergence
    text = row.verdict if first is None else f"fail at step {first.step}: {first.signal}"
    return f'<td class="{row.verdict}">{_text(text)}</td>'


def _section(window: Window) -> str:
    found = window.result.first_divergence
    assert found is not None
    about = (
        f"Step {found.step} is the first that differs; {window.result.mismatches} of {window.result.steps} steps do. "
        f"Shown are up to {AROUND_STEPS} steps before and after it."
    )
    title = f"{window.result.vector} on {window.board}: {found.signal}"
    return (
        f"<h2>{_text(title)}</h2>\n<p>{_text(about)}</p>\n"
        f'<div class="wide">{plot(window)}</div>\n{_near_table(window, found.step)}'
    )


def _near_table(window: Window, step: int) -> str:
    rows = []
    for at in range(max(window.first, step - NEAR_STEPS), min(window.end, step + NEAR_STEPS + 1)):
        expected, actual = window.expected[at - window.first], window.actual[at - window.first]
        apart = "no answer" if actual is None else "" if actual == expected else _apart(window, actual, expected)
        mark = ' class="first"' if at == step else ""
        rows.append(
            f"<tr{mark}><td>{at}</td><td>{_value(window, expected)}</td>"
            f"<td>{'' if actual is None else _value(window, actual)}</td><td>{apart}</td></tr>"
        )
    unit = f" ({window.unit})" if window.unit else ""
    return _table(["step", f"expected{unit}", "got", "got - expected"], rows)


def _apart(window: Window, actual: int, expected: int) -> str:
    return "differs" if window.signal == "digest" else f"{actual - expected:+d}"


def _value(window: Window, value: int) -> str:
    return f"{value:08x}" if window.signal == "digest" else str(value)


def plot(window: Window) -> str:
    """An SVG element: the signal with expected and got, and below it their difference; of digests the difference
    alone."""
    numbers = window.signal != "digest"
    top, height = 24, (2 if numbers else 1) * (PANEL + GAP) + BOTTOM - 10
    found = window.result.first_divergence
    assert found is not None
    differing = [at for at in range(len(window.expected)) if window.actual[at] != window.expected[at]]
    label = (
        f"{window.signal} of {window.result.vector} on {window.board}, steps {window.first} to {window.end - 1}: "
        f"expected and got agree before step {found.step} and differ in {len(differing)} of the steps shown"
    )
    if numbers:
        parts = [_signal_panel(window, top), _difference_panel(window, top + PANEL + GAP)]
    else:
        parts = [_digest_panel(window, top)]
    bottom = height - BOTTOM + 4
    x = _x(window, found.step - window.first)
    parts.append(f'<line class="first" x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{bottom}"/>')
    ticks = [at for at in range(window.first, window.end) if at % 10 == 0]
    for at in ticks if len(ticks) > 1 else [window.first, window.end - 1]:
        place = _x(window, at - window.first)
        parts.append(f'<text class="soft" x="{place:.1f}" y="{bottom + 14}" text-anchor="middle">{at}</text>')
    parts.append(
        f'<text class="soft" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{height - 4}" text-anchor="middle">step</text>'
    )
    return (
        f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{_text(label)}"><title>{_text(label)}</title>'
        + "".join(parts)
        + "</svg>"
    )


def _x(window: Window, at: int) -> float:
    return LEFT + (at + 0.5) * (WIDTH - LEFT - RIGHT) / len(window.expected)


def _frame(top: int, title: str, low: str, high: str) -> str:
    return (
        f'<rect class="axis" x="{LEFT}" y="{top}" width="{WIDTH - LEFT - RIGHT}" height="{PANEL}"/>'
        f'<text x="{LEFT}" y="{top - 8}">{_text(title)}</text>'
        f'<text class="soft" x="{LEFT - 8}" y="{top + 10}" text-anchor="end">{high}</text>'
        f'<text class="soft" x="{LEFT - 8}" y="{top + PANEL}" text-anchor="end">{low}</text>'
    )


def _signal_panel(window: Window, top: int) -> str:
    known = [*window.expected, *(value for value in window.actual if value is not None)]
    low, high = min(known), max(known)

    def y(value: int) -> float:
        return top + PANEL - 6 - (PANEL - 12) * ((value - low) / (high - low) if high > low else 0.5)

    line = " ".join(f"{_x(window, at):.1f},{y(value):.1f}" for at, value in enumerate(window.expected))
    dots = []
    for at, (expected, actual) in enumerate(zip(window.expected, window.actual, strict=True)):
        if actual is not None:
            hint = f"step {window.first + at}: expected {expected}, got {actual}"
            dots.append(
                f'<circle class="got" cx="{_x(window, at):.1f}" cy="{y(actual):.1f}" r="2.6">'
                f"<title>{hint}</title></circle>"
            )
    unit = f" ({window.unit})" if window.unit else ""
    keys = (
        f'<text class="key" x="{WIDTH - RIGHT - 90}" y="{top - 8}" text-anchor="end">expected (line)</text>'
        f'<text class="got" x="{WIDTH - RIGHT}" y="{top - 8}" text-anchor="end">got (dots)</text>'
    )
    frame = _frame(top, window.signal + unit, str(low), str(high))
    return f'{frame}{keys}<polyline class="expected" points="{line}"/>{"".join(dots)}'


def _difference_panel(window: Window, top: int) -> str:
    apart = [
        0 if actual is None else actual - expected
        for expected, actual in zip(window.expected, window.actual, strict=True)
    ]
    low, high = min(0, *apart), max(0, *apart)
    wide = max(1.0, (WIDTH - LEFT - RIGHT) / len(apart) - 2)

    def y(value: int) -> float:
        return top + PANEL - 6 - (PANEL - 12) * ((value - low) / (high - low) if high > low else 0.5)

    bars = []
    for at, value in enumerate(apart):
        if value:
            upper, lower = sorted((y(value), y(0)))
            bars.append(
                f'<rect class="got" x="{_x(window, at) - wide / 2:.1f}" y="{upper:.1f}" width="{wide:.1f}" '
                f'height="{max(1.5, lower - upper):.1f}"><title>step {window.first + at}: {value:+d}</title></rect>'
            )
    zero = f'<line class="axis" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(0):.1f}" y2="{y(0):.1f}"/>'
    return _frame(top, "got - expected (least significant bits)", str(low), str(high)) + zero + "".join(bars)


def _digest_panel(window: Window, top: int) -> str:
    """A bar for every step whose digest differs or is missing."""
    wide = max(1.0, (WIDTH - LEFT - RIGHT) / len(window.expected) - 2)
    bars = [
        f'<rect class="got" x="{_x(window, at) - wide / 2:.1f}" y="{top + 8}" width="{wide:.1f}" height="{PANEL - 8}">'
        f"<title>step {window.first + at}: {'no digest' if actual is None else 'the digest differs'}</title></rect>"
        for at, (expected, actual) in enumerate(zip(window.expected, window.actual, strict=True))
        if actual != expected
    ]
    return _frame(top, "digest", "equal", "differs") + "".join(bars)
