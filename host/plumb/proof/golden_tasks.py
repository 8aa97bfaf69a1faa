"""Golden vectors of other kinds than steps (plumb.systems.tasks), from an entry of the recipe: `kind = "refusal"`.

retune        live parameters change at a few steps, each to an end of its range, next to it, or to any size
plausibility  the counts of the entry; the state of the checks after each step
refusal       tables of parameters at both sides of every limit of the core, found by bisection between an accepted
              word and the end of its type; then tables with one or two words of any value
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import Change, ControlParams
from plumb.proof.golden_random import Draw
from plumb.proof.golden_reach import value_of
from plumb.spec import declarations, parameters
from plumb.spec.parameters import Parameter
from plumb.systems.tasks import Task
from plumb.tuning.variances import variance_turn2_q56

CHANGES = 8
"""Number of changes in a retune."""


def task_of(kind: str, seed: int, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Task:
    """The task of an entry with these inputs."""
    draw = Draw(seed ^ 0x7A5C)
    if kind == "retune":
        return Task(kind, params, raw, setpoint, changes=_changes(params, draw, len(raw)))
    if kind == "plausibility":
        return Task(kind, params, raw, setpoint, unit_turn2_q56=variance_turn2_q56(params))
    nothing = np.zeros_like(raw), np.zeros_like(setpoint)
    return Task(kind, params, *nothing, tables=_tables(params, draw, len(raw)))


def own_rows(params: ControlParams) -> list[Parameter]:
    """The parameters of the groups that the system reads."""
    return _rows_of(params.system)


@lru_cache(maxsize=32)
def _rows_of(system: str) -> list[Parameter]:
    groups = declarations.system(system).all_groups
    return [row for row in parameters.table() if row.owner == "control" and row.group in groups]


def _changes(params: ControlParams, draw: Draw, steps: int) -> tuple[Change, ...]:
    live, found = [row for row in own_rows(params) if row.live], []
    for step in sorted(1 + draw.below(max(steps - 1, 1)) for _ in range(CHANGES)):
        for row in live:
            changed = _with(params, {row.name: value_of(row, params[row.name], draw)})
            if draw.chance(500) and run_fixed.params_valid(changed):
                params = changed
        found.append(Change(step, params))
    return tuple(found)


def _with(params: ControlParams, words: dict[str, int]) -> ControlParams:
    return replace(params, values={**params.values, **words})


def type_range(row: Parameter) -> tuple[int, int]:
    """The range of the row's type."""
    return (-(1 << 31), (1 << 31) - 1) if row.type == "int32" else (0, (1 << 32) - 1)


def _tables(params: ControlParams, draw: Draw, count: int) -> tuple[ControlParams, ...]:
    rows = own_rows(params)
    found: list[ControlParams] = []
    for row in rows:
        for end in type_range(row):
            found += _around_limit(params, row, end)
    while len(found) < count:
        table = params
        for _ in range(1 + draw.below(2)):
            row = draw.of(rows)
            low, high = type_range(row)
            value = draw.of((row.min, row.max, row.min - 1, row.max + 1, low + draw.below(1 << 32)))
            table = _with(table, {row.name: min(max(value, low), high)})
        found.append(table)
    return tuple(found[:count])


def _around_limit(params: ControlParams, row: Parameter, end: int) -> Iterator[ControlParams]:
    """The last accepted table on the way to the end, and the first refused one."""
    good, bad = params[row.name], end
    if run_fixed.params_valid(_with(params, {row.name: end})):
        yield _with(params, {row.name: end})
        return
    while abs(bad - good) > 1:
        between = (good + bad) // 2
        if run_fixed.params_valid(_with(params, {row.name: between})):
            good = between
        else:
            bad = between
    yield _with(params, {row.name: good})
    yield _with(params, {row.name: bad})
