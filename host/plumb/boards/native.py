"""The C core in this process: the quickest board."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb import native
from plumb.boards import Answer, Board, RawCounts, Setpoints, StepOutput, Stepper

if TYPE_CHECKING:
    from plumb.quantise import ControlParams


class NativeStepper:
    """One control loop in C memory that this object owns."""

    def __init__(self, params: ControlParams) -> None:
        self._controller = native.Controller(params)

    def step(self, raw: tuple[int, ...], setpoint_turn_q32: int) -> StepOutput:
        words = self._controller.step(raw, setpoint_turn_q32)
        return StepOutput(self._controller.digest(), (words["pulse_halfus_0"], words["pulse_halfus_1"]))


class NativeBoard(Board):
    name = "native"

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint_turn_q32: Setpoints) -> Answer:
        words = native.run_control(params, raw, setpoint_turn_q32)
        return Answer(words.digests(), words)

    def words_of_step(
        self, params: ControlParams, raw: RawCounts, setpoint_turn_q32: Setpoints, step: int
    ) -> dict[str, int]:
        words = native.run_control(params, raw[: step + 1], setpoint_turn_q32[: step + 1])
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        return NativeStepper(params)
