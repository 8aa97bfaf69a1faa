"""The integer model of the tasks of a board other than plain steps (plumb.systems.tasks)."""

from __future__ import annotations

import numpy as np

from plumb.contract import run_fixed
from plumb.contract.step import FIXED
from plumb.errors import UsageError
from plumb.kernels.fixed import plausibility
from plumb.spec import parameters
from plumb.spec.records import PLAUSIBILITY, VALIDITY, Words
from plumb.systems import load
from plumb.systems.contracts import BoundedSignals
from plumb.systems.tasks import Task


def run_task(task: Task) -> Words:
    """Raises UsageError for a plausibility of a system that has none to check."""
    if task.kind == "refusal":
        return Words(np.array([(int(run_fixed.params_valid(table)),) for table in task.tables], VALIDITY))
    words = run_fixed.run_changed(task.params, task.changes, task.raw, task.setpoint)
    return _plausibility(task, words) if task.kind == "plausibility" else words


def _plausibility(task: Task, words: Words) -> Words:
    system = load(task.params.system, FIXED)
    if not isinstance(system, BoundedSignals):
        raise UsageError(f"{task.params.system} has no output with the checks axis or ride: no plausibility is checked")
    state, rows = plausibility.State(), []
    dt_s_q33 = parameters.period_s_q33(task.params.system, task.params.values)
    for row in words.record:
        word = {name: int(row[name]) for name in words.names}
        plausibility.step(state, system.PLAUSIBLE, word, dt_s_q33, task.unit_turn2_q56)
        rows.append(state.words())
    return Words(np.array(rows, PLAUSIBILITY))
