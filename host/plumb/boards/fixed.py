"""The integer model in Python as a board, so that golden files are also checked by the code that made them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards.contract import Answer, Board, RawCounts, Setpoints, StepOutput, Stepper
from plumb.spec.records import Words
from plumb.systems import run_fixed, run_tasks
from plumb.systems.tasks import KINDS, Task

if TYPE_CHECKING:
    from plumb.tuning.quantise import Changes, ControlParams


class FixedStepper:
    def __init__(self, params: ControlParams) -> None:
        self._controller = run_fixed.Controller(params)
        self._outputs = systems.load(params.system).OUTPUTS

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
        words = self._controller.step(raw, setpoint)
        return StepOutput(self._controller.digest(), {name: words[name] for name in self._outputs})

    def digests(self, raw: RawCounts) -> list[int]:
        return [self.step(tuple(row), 0).digest for row in raw.tolist()]


class FixedParts:
    def __init__(self, params: ControlParams) -> None:
        self._controller, self._system = run_fixed.Controller(params), params.system

    def run(self, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        counts, setpoints = run_fixed.check_inputs(self._system, raw, setpoint)
        return Words.from_bytes(self._controller.run(counts, setpoints), (len(raw),), self._system).digests()

    def change(self, params: ControlParams) -> None:
        self._controller.retune(params)

    def end(self) -> None:
        """Nothing is to be ended."""


class FixedBoard(Board):
    name = "fixed"
    task_kinds = KINDS

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = run_fixed.run_control(params, raw, setpoint)
        return Answer(words.digests(), words)

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = run_fixed.run_changed(params, changes, raw, setpoint)
        return Answer(words.digests(), words)

    def run_task(self, task: Task) -> Answer:
        words = run_tasks.run_task(task)
        return Answer(words.digests(), words)

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        return {name: int(values[step]) for name, values in run_tasks.run_task(task).items()}

    def part_runner(self, params: ControlParams) -> FixedParts:
        return FixedParts(params)

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = run_fixed.run_control(params, raw[: step + 1], setpoint[: step + 1])
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        return FixedStepper(params)
