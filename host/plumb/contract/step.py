"""Contract of the step of any system under proof, in integers and in float64, as Protocols."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning

Params = Mapping[str, int]
"""The parameters of a step, as integers by name."""


class FixedStep(Protocol):
    """fixed.py: the step in integers."""

    def control_init(self, p: Params, /) -> object:
        """The state before the first step."""

    def control_step(self, c: object, p: Params, raw: Sequence[int], setpoint: int, /) -> tuple[int, ...]:
        """One step: updates the state c; returns the values of the record's words, in order. raw: six counts."""


@runtime_checkable
class RetunedStep(Protocol):
    """fixed.py of a system that reads live parameters."""

    def control_retune(self, c: object, old: Params, new: Params, /) -> None:
        """Other values of live parameters from the next step on: moves the state c so that no output jumps."""


@runtime_checkable
class CheckedWords(Protocol):
    """fixed.py of a system whose C refuses some parameter words (`plumb_NAME_params_valid`)."""

    def control_valid(self, p: Params, /) -> bool:
        """Whether the core accepts these words: those of one set, as they are in memory."""


class ReferenceModel(Protocol):
    """reference.py: the published equations in float64."""

    def run_control(
        self, tuning: AnyTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None, /
    ) -> dict[str, FloatArray]:
        """A whole run; returns arrays (steps[, runs]) by name. raw: (steps, counts[, runs]); setpoint: (steps[, runs]),
        default 0."""


FIXED = Part[FixedStep]("fixed", FixedStep)
REFERENCE = Part[ReferenceModel]("reference", ReferenceModel)
