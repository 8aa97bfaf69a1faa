"""The C core in this process: the fastest board."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards import native_core
from plumb.boards.contract import Answer, Board, RawCounts, Setpoints, StepOutput, Stepper
from plumb.systems import run_fixed
from plumb.systems.tasks import KINDS, Task

if TYPE_CHECKING:
    from plumb.tuning.quantise import Changes, ControlParams


class NativeStepper:
    """One run of the C core, whose state this object owns."""

    def __init__(self, params: ControlParams) -> None:
        self._controller = native_core.Controller(params)
        self._outputs = systems.load(params.system).OUTPUTS

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
        words = self._controller.step(raw, setpoint)
        return StepOutput(self._controller.digest(), {name: words[name] for name in self._outputs})

    def digests(self, raw: RawCounts) -> list[int]:
        return [self.step(tuple(row), 0).digest for row in raw.tolist()]


class NativeParts:
    def __init__(self, params: ControlParams) -> None:
        self._controller, self._system = native_core.Controller(params), params.system

    def run(self, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        return self._controller.run(*run_fixed.check_inputs(self._system, raw, setpoint)).digests()

    def change(self, params: ControlParams) -> None:
        self._controller.retune(params)

    def end(self) -> None:
        """Nothing is to be ended."""


class NativeBoard(Board):
    name = "native"
    task_kinds = KINDS

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = native_core.run_control(params, raw, setpoint)
        return Answer(words.digests(), words)

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = native_core.run_changed(params, changes, raw, setpoint)
        return Answer(words.digests(), words)

    def run_task(self, task: Task) -> Answer:
        words = native_core.run_task(task)
        return Answer(words.digests(), words)

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        return {name: int(values[step]) for name, values in native_core.run_task(task).items()}

    def part_runner(self, params: ControlParams) -> NativeParts:
        return NativeParts(params)

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = native_core.run_control(params, raw[: step + 1], setpoint[: step + 1])
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        return NativeStepper(params)
