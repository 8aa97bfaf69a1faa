"""The integer model in Python as a board, so that golden files are also checked by the code that made them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.boards.in_process import InProcessBoard
from plumb.contract import run_fixed
from plumb.systems import run_tasks

if TYPE_CHECKING:
    from plumb.boards.contract import RawCounts, Setpoints
    from plumb.contract.parameters import Changes, ControlParams
    from plumb.spec.records import Words
    from plumb.systems.tasks import Task


class FixedBoard(InProcessBoard):
    name = "fixed"

    def controller(self, params: ControlParams) -> run_fixed.Controller:
        return run_fixed.Controller(params)

    def words(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Words:
        return run_fixed.run_control(params, raw, setpoint)

    def words_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Words:
        return run_fixed.run_changed(params, changes, raw, setpoint)

    def task_words(self, task: Task) -> Words:
        return run_tasks.run_task(task)
