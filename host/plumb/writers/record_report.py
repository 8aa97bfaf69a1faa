"""The page of a recording: every recorded signal over time, and what it was recorded with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from plumb.errors import counted
from plumb.proof import run_identity
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, Statement, page
from plumb.readers.log_replay import RecordedRun
from plumb.readers.step_quantities import MOTORS, STICKS
from plumb.readers.step_table import table_of
from plumb.readers.table_column import Column
from plumb.spec import declarations
from plumb.spec.system import FLIGHT, System

ROWS_MAX = 500_000
"""Steps that the page shows, the first ones: 17 minutes at 500 Hz. The log has all."""
COLOURS = (ESTIMATE, SECOND, SENSOR, "#1a8f7a", "#8a63d2", "#c2578f")
"""Colours of the lines of one panel, in their order. Each is distinct from the background in light and in dark mode."""
SHARES = "Shares"
"""Title of a panel of signals without a unit."""
TITLES = {STICKS: "Sticks", MOTORS: "Motors"}
"""Group of columns -> title of their panel."""
NOT_DRAWN = ("time_s", "step", "digest", "armed")


RANKS = ("deg", "m", "m/s", *TITLES.values(), "deg/s")
"""Units and titles of the first panels, the most wanted first."""


@dataclass(frozen=True)
class Compared:
    """A comparison of a run with the integer model while it ran, and its result as a part of a sentence."""

    verdict: Literal["pass", "fail", "unverified"]
    text: str


def _line(index: int, column: Column) -> Line:
    values = column.values.astype(np.float64)
    if column.known is not None:
        values = np.where(column.known, values, np.nan)
    return Line(_label(column), values, COLOURS[index % len(COLOURS)])


def _label(column: Column) -> str:
    """The name of a line; a stick and a motor without the words that title and unit of their panel say."""
    plain = column.name.removeprefix("stick_").removeprefix("motor_").removesuffix("_pct")
    return plain if column.frame in TITLES else column.name


def panels(columns: Sequence[Column], declared: System) -> list[Plot]:
    """A panel for each unit, the angles first; then one for each choice, with its values in words. Folded behind them:
    the raw counts, and the integers and shares that stand in other panels."""
    time_s = np.asarray(columns[0].values, np.float64)
    replaced = {name for column in columns for name in column.replaces}
    choices = {word.name: word.choices for word in declared.words if word.choices}
    groups: dict[tuple[str, str], list[Column]] = {}
    for column in columns:
        if column.name in NOT_DRAWN or column.name in replaced or column.texts:
            continue
        if column.name == "setpoint" and not column.values.any():
            continue
        sensed = column.unit and not column.frame
        kind = "Raw counts" if column.unit == "counts" else f"Sensors in {column.unit}" if sensed else ""
        share = not column.unit and column.values.dtype.kind == "f"
        title = kind or (f"Signals in {column.unit}" if column.unit else SHARES if share else column.name)
        groups.setdefault((TITLES.get(column.frame, title), column.unit), []).append(column)
    found = []
    for (title, unit), of in groups.items():
        words = "; ".join(f"{value}: {text}" for value, text in choices.get(title, {}).items())
        integers = unit == "counts" or (not unit and not words and all(one.values.dtype.kind in "iu" for one in of))
        lines = [_line(index, column) for index, column in enumerate(of)]
        found.append(Plot(title, unit, time_s, lines, words, folded=integers))
    return sorted(found, key=_rank)


def _rank(plot: Plot) -> int:
    """Place of a panel: signals and sticks, then sensors, then what is folded."""
    wanted = next((rank for rank, key in enumerate(RANKS) if key in (plot.title, plot.title[len("Signals in ") :])), 9)
    return 20 if plot.folded else 10 if plot.title.startswith("Sensors") else wanted


def no_height(columns: Sequence[Column], declared: System) -> str:
    """Why the page of a vehicle that flies has no height, as a sentence of its lead; "" where it has one."""
    if declared.checks != FLIGHT or any(column.unit == "m" for column in columns):
        return ""
    return " There is no height: the log holds what the board sent, and no sensor of the board measures it."


def page_of(recorded: RecordedRun, compared: Compared | None = None) -> str:
    """The page of one run of a log. compared: what a shadow said of it while it ran; None: it was not compared."""
    run, params, head = recorded.run, recorded.used.params, recorded.log.head
    most = f" The page shows the first {ROWS_MAX} steps." if run.steps > ROWS_MAX else ""
    again = f"plumb replay {recorded.log.path.name} --board native"
    said = f"While it ran: {compared.text}. {again} compares again." if compared else ""
    said = said or f"No step was compared with the integer model: {again} does that."
    declared = declarations.system(recorded.system)
    shown_steps = table_of(replace(recorded, run=run.first_steps(ROWS_MAX)))
    said = f"{said}{most}{no_height(shown_steps, declared)}"
    lead = f"{counted(run.steps, 'step')} of {1e3 * params.period_s:g} ms. {said}"
    lost = run.incomplete
    whole = (
        "no step lacks its counts or its digest" if not lost else f"{counted(lost, 'step')} without counts or digest"
    )
    plant = head.get("plant")
    heading = {"system": recorded.system, **(plant if isinstance(plant, dict) else {})}
    if recorded.of > 1:
        heading["run"] = f"{recorded.number} of {recorded.of}"
    shown = ("plumb", "protocol", "date_utc", "command", "part", "host")
    entry = {name: head[name] for name in shown if name in head}
    entry |= {
        "parameters_crc32": f"0x{params.crc32():08x}",
        "parameters": run_identity.parameters_of(params),
    }
    part = head.get("part")
    name = part.get("board", "a bus") if isinstance(part, dict) else "a bus"
    return page(
        f"{recorded.system}, recorded from {name}",
        compared.verdict if compared else "",
        lead,
        [*panels(shown_steps, declared), *run_identity.tables(entry, heading)],
        [Statement("link", whole, not lost)] if run.steps else [],
    )
