"""The C core in this process: the fastest board."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.boards.in_process import InProcessBoard
from plumb.boards.native import core as native_core

if TYPE_CHECKING:
    from plumb.boards.contract import RawCounts, Setpoints
    from plumb.contract.parameters import Changes, ControlParams
    from plumb.spec.records import Words
    from plumb.systems.tasks import Task


class NativeBoard(InProcessBoard):
    name = "native"

    def controller(self, params: ControlParams) -> native_core.Controller:
        return native_core.Controller(params)

    def words(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Words:
        return native_core.run_control(params, raw, setpoint)

    def words_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Words:
        return native_core.run_changed(params, changes, raw, setpoint)

    def task_words(self, task: Task) -> Words:
        return native_core.run_task(task)
