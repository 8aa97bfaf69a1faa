"""The page of a recording: every recorded signal over time, and what it was recorded with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumb.proof import run_identity
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, Statement, page
from plumb.readers.log_replay import RecordedRun
from plumb.readers.step_table import Column, table_of

ROWS_MAX = 500_000
"""Steps that the page shows, the first ones: 17 minutes at 500 Hz. The log has all."""
COLOURS = (ESTIMATE, SECOND, SENSOR, "#1a8f7a", "#8a63d2", "#c2578f")
"""Colours of the lines of one panel, in their order. Each is distinct from the background in light and in dark mode."""
NOT_DRAWN = ("time_s", "step", "digest", "armed")


def panels(columns: Sequence[Column]) -> list[Plot]:
    """A panel for each unit, and one for each signal without a unit."""
    time_s = np.asarray(columns[0].values, np.float64)
    groups: dict[tuple[str, str], list[tuple[str, Column]]] = {}
    for column in columns:
        if column.name in NOT_DRAWN or (column.name == "setpoint" and not column.values.any()):
            continue
        sensed = column.unit and not column.frame
        kind = "Raw counts" if column.unit == "counts" else f"Sensors in {column.unit}" if sensed else ""
        title = kind or (f"Signals in {column.unit}" if column.unit else column.name)
        groups.setdefault((title, column.unit), []).append((column.name, column))
    found = []
    for (title, unit), of in groups.items():
        lines = []
        for index, (name, column) in enumerate(of):
            values = column.values.astype(np.float64)
            if column.known is not None:
                values = np.where(column.known, values, np.nan)
            lines.append(Line(name, values, COLOURS[index % len(COLOURS)]))
        found.append(Plot(title, unit, time_s, lines))
    return found


def page_of(recorded: RecordedRun) -> str:
    """The page of one run of a log."""
    run, params, head = recorded.run, recorded.used.params, recorded.log.head
    most = f" The page shows the first {ROWS_MAX} steps." if run.steps > ROWS_MAX else ""
    lead = (
        f"{run.steps} steps of {1e3 * params.period_s:g} ms. No step was compared with the integer model: "
        f"plumb replay {recorded.log.path.name} --board native does that.{most}"
    )
    lost = run.incomplete
    whole = "no step lacks its counts or its digest" if not lost else f"{lost} steps lack their counts or their digest"
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
        "",
        lead,
        [*panels(table_of(replace(recorded, run=run.first_steps(ROWS_MAX)))), *run_identity.tables(entry, heading)],
        [Statement("link", whole, not lost)] if run.steps else [],
    )
