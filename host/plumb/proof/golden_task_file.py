"""The header fields of a golden vector of another kind than steps; plumb.proof.golden_file describes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import Change, ControlParams
from plumb.proof.golden_json import integer, integers
from plumb.proof.golden_tasks import own_rows, type_range
from plumb.systems.tasks import KINDS, Task


def task_fields(task: Task) -> dict[str, object]:
    changes, before = [], task.params
    for change in task.changes:
        changes.append([change.step, _difference(before, change.params)])
        before = change.params
    tables = [_difference(task.params, table) for table in task.tables]
    return {"kind": task.kind, "changes": changes, "tables": tables, "unit_turn2_q56": task.unit_turn2_q56}


def _difference(before: ControlParams, after: ControlParams) -> dict[str, int]:
    return {name: value for name, value in after.own().items() if value != before[name]}


def task_of_fields(header: Mapping[str, Any], params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Task:
    """The task of these header fields; raises ValueError when they are not a task."""
    kind, given, tables = header["kind"], header["changes"], header["tables"]
    if kind not in KINDS or not isinstance(given, list) or not isinstance(tables, list):
        raise ValueError("its kind, changes or tables are not valid")
    if (bool(given), bool(tables)) != (kind == "retune", kind == "refusal"):
        raise ValueError(f"changes are of a retune and tables of a refusal, and this is a {kind}")
    changes, now, least = [], params, 0
    for one in given:
        if not isinstance(one, list) or len(one) != 2:
            raise ValueError("a change is no pair of a step and words")
        least = integer(one[0], least, len(raw) - 1, "the step of a change")
        now = _changed(now, one[1])
        changes.append(Change(least, now))
    if kind == "refusal" and len(tables) != len(raw):
        raise ValueError("steps is not the number of tables")
    unit = integer(header["unit_turn2_q56"], 0, (1 << 32) - 1, "unit_turn2_q56")
    found = tuple(_changed(params, table) for table in tables)
    return Task(kind, params, raw, setpoint, tuple(changes), found, unit)


def _changed(params: ControlParams, words: object) -> ControlParams:
    ranges = {row.name: type_range(row) for row in own_rows(params)}
    given = integers(words, "words")
    for name, value in given.items():
        low, high = ranges.get(name, (1, 0))
        if not low <= value <= high:
            raise ValueError(f"{name[:80]} = {value} is no word that the system reads")
    return replace(params, values={**params.values, **given})
