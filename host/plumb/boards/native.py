"""The C core in this process: the fastest board."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb import systems
from plumb.boards import Answer, Board, RawCounts, Setpoints, StepOutput, Stepper, native_core

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


class NativeBoard(Board):
    name = "native"

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = native_core.run_control(params, raw, setpoint)
        return Answer(words.digests(), words)

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        words = native_core.run_changed(params, changes, raw, setpoint)
        return Answer(words.digests(), words)

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = native_core.run_control(params, raw[: step + 1], setpoint[: step + 1])
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        return NativeStepper(params)
