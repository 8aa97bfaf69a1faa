"""The page of a check of golden vectors: every vector on every board, and a plot around each first divergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from plumb.proof import report
from plumb.proof.golden_result import Result, VectorResult
from plumb.proof.golden_window import AROUND_STEPS, Window
from plumb.proof.report import Statement, Table
from plumb.proof.svg_plot import ESTIMATE, SECOND, TRUTH
from plumb.proof.xy_plot import Axis, Curve, XyPlot

NEAR_STEPS = 5
"""Rows of the table before and after the step that differs first."""
SMALL_SHARE = 1e-3
"""When the span of the integers is less than this share of their size, the axis starts at the least of them."""
MEANING = {
    "pass": "bit-exact: every step of every vector equals the integer model.",
    "fail": "not bit-exact: at least one step differs from the integer model.",
    "unverified": "answers were lost, or a board did not finish: neither right nor wrong.",
}


def page(
    results: Mapping[str, Result],
    errors: Mapping[str, str],
    windows: Sequence[Window],
    verdict: str,
    parts: Mapping[str, Mapping[str, object]] | None = None,
    identity: Sequence[tuple[str, str]] = (),
) -> str:
    """The whole page. errors: board -> why its check ended early. parts: board -> its identity, as from
    `run_identity.part_of`. identity: name and value of everything else that identifies the check."""
    body: list[XyPlot | Table] = [_boards_table(results, plotted=bool(windows))]
    for window in windows:
        body += [*plots(window), _near_table(window)]
    body += [_vectors_table(results), *_images_table(parts or {})]
    body += [Table("Identity", ["", ""], identity)] if identity else []
    ended = [Statement(board, f"ended early: {why}", None) for board, why in errors.items()]
    return report.page("Golden vectors", verdict, MEANING[verdict], body, ended)


def _boards_table(results: Mapping[str, Result], plotted: bool) -> Table:
    rows = [
        [board, one.verdict, str(one.vectors), str(one.steps), str(one.mismatches)] for board, one in results.items()
    ]
    bad = frozenset(at for at, one in enumerate(results.values()) if one.verdict == "fail")
    note = "" if plotted else "No board differs from a vector, so there is nothing to plot."
    return Table("Boards", ["board", "verdict", "vectors", "steps", "mismatches"], rows, note, bad_rows=bad)


def _images_table(parts: Mapping[str, Mapping[str, object]]) -> list[Table]:
    """A row for every board that runs an image or reports the commit of its image; [] without such a board."""
    rows = []
    for board, part in parts.items():
        image, commit = part.get("image"), part.get("firmware_git_hash")
        if isinstance(image, Mapping) or commit:
            known = image if isinstance(image, Mapping) else {}
            cells = (board, known.get("file", ""), known.get("sha256", ""), known.get("compiler") or "", commit or "")
            rows.append([str(cell) for cell in cells])
    head = ["board", "image", "SHA-256", "compiler", "commit, as the board says"]
    return [Table("What ran", head, rows)] if rows else []


def _vectors_table(results: Mapping[str, Result]) -> Table:
    """A row for every vector, a column for every board; a dash where the board does not run the vector."""
    found: dict[str, dict[str, VectorResult]] = {}
    for board, result in results.items():
        for row in result.rows:
            found.setdefault(row.vector, {})[board] = row
    rows = []
    for vector, cells in found.items():
        one = next(iter(cells.values()))
        rows.append([vector, one.system, str(one.steps), *(_mark(cells.get(board)) for board in results)])
    failed = [any(cell.verdict == "fail" for cell in cells.values()) for cells in found.values()]
    bad = frozenset(np.flatnonzero(failed).tolist())
    return Table("Every vector", ["vector", "system", "steps", *results], rows, bad_rows=bad)


def _mark(row: VectorResult | None) -> str:
    if row is None:
        return "-"
    first = row.first_divergence
    return row.verdict if first is None else f"fail at step {first.step}: {first.signal}"


def _first_step(window: Window) -> int:
    found = window.result.first_divergence
    assert found is not None, "a window is around a difference"
    return found.step


def _near_table(window: Window) -> Table:
    """The integers of the steps around the one that differs first."""
    step, rows = _first_step(window), []
    near = range(max(window.first, step - NEAR_STEPS), min(window.end, step + NEAR_STEPS + 1))
    for at in near:
        expected, actual = window.expected[at - window.first], window.actual[at - window.first]
        apart = "no answer" if actual is None else "" if actual == expected else _apart(window, actual, expected)
        rows.append([str(at), _value(window, expected), "" if actual is None else _value(window, actual), apart])
    unit = f" ({window.unit})" if window.unit else ""
    head = ["step", f"expected{unit}", "got", "got - expected"]
    return Table(f"Around step {step}", head, rows, bad_rows=frozenset({near.index(step)}))


def _apart(window: Window, actual: int, expected: int) -> str:
    return "differs" if window.signal == "digest" else f"{actual - expected:+d}"


def _value(window: Window, value: int) -> str:
    return f"{value:08x}" if window.signal == "digest" else str(value)


def plots(window: Window) -> list[XyPlot]:
    """The signal, expected and got, and their difference; of digests the difference alone."""
    step = _first_step(window)
    differing = sum(actual != expected for actual, expected in zip(window.actual, window.expected, strict=True))
    about = (
        f"Expected and got agree before step {step} and differ in {differing} of the steps shown, up to {AROUND_STEPS} "
        f"before and after it; of the whole vector {window.result.mismatches} of {window.result.steps} steps differ."
    )
    title = f"{window.result.vector} on {window.board}: {window.signal}"
    if window.signal == "digest":
        return [_difference_plot(window, title, about)]
    return [_signal_plot(window, title, about), _difference_plot(window, f"{title}, got - expected", "")]


def _signal_plot(window: Window, title: str, about: str) -> XyPlot:
    known = [*window.expected, *(value for value in window.actual if value is not None)]
    low, high = min(known), max(known)
    base = low if high - low < SMALL_SHARE * max(abs(low), abs(high)) else 0
    expected = np.array([value - base for value in window.expected], float)
    got = np.array([np.nan if value is None else value - base for value in window.actual])
    hints = [
        f"step {window.first + at}: expected {one}, got {other}"
        for at, (one, other) in enumerate(zip(window.expected, window.actual, strict=True))
    ]
    unit = f" ({window.unit})" if window.unit else ""
    above = f" - {base}" if base else ""
    steps = np.arange(window.first, window.end, dtype=float)
    curves = [
        Curve("expected", steps, expected, ESTIMATE),
        Curve("got", steps, got, SECOND, points=True, hints=hints),
        _first_line(window, float(low - base), float(high - base)),
    ]
    return XyPlot(title, Axis("step"), Axis(window.signal + above + unit), curves, about)


def _difference_plot(window: Window, title: str, about: str) -> XyPlot:
    """A bar from 0 for every step that differs; of digests from equal, 0, to different, 1."""
    digest = window.signal == "digest"
    apart, hints = [], []
    for at, (expected, actual) in enumerate(zip(window.expected, window.actual, strict=True), window.first):
        if digest:
            apart.append(float(actual != expected))
            hints.append(f"step {at}: {'no digest' if actual is None else 'the digest differs'}")
        else:
            apart.append(np.nan if actual is None else float(actual - expected))
            hints.append(f"step {at}: " + ("no answer" if actual is None else f"{actual - expected:+d}"))
    steps, values = np.arange(window.first, window.end, dtype=float), np.array(apart)
    values[values == 0.0] = np.nan  # without a bar
    known = values[np.isfinite(values)]
    low, high = min(0.0, *known), max(0.0, *known)
    bars = Curve(
        "difference", steps, values, SECOND, low=np.minimum(0, values), high=np.maximum(0, values), points=True,
        hints=hints,
    )  # fmt: skip
    zero = Curve("equal", np.array([steps[0], steps[-1]]), np.zeros(2), ESTIMATE)
    y = Axis("digest: 0 equal, 1 differs" if digest else "got - expected (least significant bits)")
    return XyPlot(title, Axis("step"), y, [zero, bars, _first_line(window, low, high)], about)


def _first_line(window: Window, low: float, high: float) -> Curve:
    step = float(_first_step(window))
    return Curve("first step that differs", np.array([step, step]), np.array([low, high]), TRUTH, 1.0, dashed=True)
