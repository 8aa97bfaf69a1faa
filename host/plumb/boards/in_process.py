"""A board in this process: the integer model in Python (`plumb.boards.fixed`), or the C core (`native.board`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards.contract import Answer, RawCounts, Setpoints, StepBoard, StepOutput, Stepper
from plumb.contract import run_fixed
from plumb.spec.records import Words
from plumb.systems.tasks import KINDS, Task

if TYPE_CHECKING:
    from plumb.contract.parameters import Changes, ControlParams


class Controller(Protocol):
    """One run, which owns its state."""

    def step(self, raw: Sequence[int], setpoint: int) -> dict[str, int]: ...

    def digest(self) -> int: ...

    def retune(self, params: ControlParams) -> None: ...

    def run(self, raw: npt.NDArray[np.int64], setpoint: npt.NDArray[np.int64]) -> Words: ...


class InProcessStepper:
    def __init__(self, controller: Controller, system: str) -> None:
        self._controller, self._outputs = controller, systems.load(system).OUTPUTS

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
        words = self._controller.step(raw, setpoint)
        return StepOutput(self._controller.digest(), {name: words[name] for name in self._outputs})

    def digests(self, raw: RawCounts) -> list[int]:
        return [self.step(tuple(row), 0).digest for row in raw.tolist()]


class InProcessParts:
    def __init__(self, controller: Controller, system: str) -> None:
        self._controller, self._system = controller, system

    def run(self, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        return self._controller.run(*run_fixed.check_inputs(self._system, raw, setpoint)).digests()

    def change(self, params: ControlParams) -> None:
        self._controller.retune(params)

    def end(self) -> None:
        """Does nothing: the run holds no resources."""


class InProcessBoard(StepBoard, ABC):
    """A subclass says how to run a single step, a whole run, a run whose parameters change, and a task other than
    steps."""

    task_kinds = KINDS

    @abstractmethod
    def controller(self, params: ControlParams) -> Controller:
        """One run with these parameters, a step at a time."""

    @abstractmethod
    def words(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Words:
        """The signals of every step of a run."""

    @abstractmethod
    def words_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Words:
        """The signals of every step of a run whose gains change."""

    @abstractmethod
    def task_words(self, task: Task) -> Words:
        """The signals of a task that is not a run of steps."""

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = self.words(params, raw, setpoint)
        return Answer(words.digests(), words)

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = self.words_changed(params, changes, raw, setpoint)
        return Answer(words.digests(), words)

    def run_task(self, task: Task) -> Answer:
        words = self.task_words(task)
        return Answer(words.digests(), words)

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        return {name: int(values[step]) for name, values in self.task_words(task).items()}

    def part_runner(self, params: ControlParams) -> InProcessParts:
        return InProcessParts(self.controller(params), params.system)

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = self.words(params, raw[: step + 1], setpoint[: step + 1])
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        return InProcessStepper(self.controller(params), params.system)
