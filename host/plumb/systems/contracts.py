"""What the modules of a system's folder offer, as types; `plumb.systems` says what a system's folder holds.

`plumb.systems.load` holds a system's modules to these contracts when it loads them. The scenarios, plants and
tunings of a system fit that system alone: the contracts cannot say so, and a caller never mixes two systems.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer
from plumb.physics.disturbance import Request
from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning, Start

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

TuningT = TypeVar("TuningT", bound=AnyTuning)


class Conversion(NamedTuple):
    """A sample that the board took of the first raw channel. time_s: on the machine's clock; truth: at that moment."""

    time_s: float
    raw_count: int
    truth: dict[str, float]


class Scenario(Protocol):
    """Everything random of one run, drawn from its seed."""

    @property
    def period_us(self) -> int:
        """Sampling period."""

    @property
    def steps(self) -> int:
        """Samples of the run."""

    @property
    def time_s(self) -> FloatArray:
        """When the samples are taken, (steps,)."""

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """The samples that count for the figures, (steps,)."""

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of the prescribed motion, (steps, 6)."""

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Setpoints in the integers of the system, (steps,)."""

    def truth(self) -> dict[str, FloatArray]:
        """The prescribed motion by name, (steps,) each."""


@runtime_checkable
class FittedScenario(Protocol):
    """A scenario whose run needs a tuning of its own, which depends on what was drawn."""

    def fit(self, tuning: TuningT) -> TuningT:
        """The tuning for this run."""


class Plant(Protocol):
    """The physics, and the sensors that ride on it."""

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with the signals of the last step; {}: none yet."""

    def counts(self, time_s: float) -> tuple[int, ...]:
        """Six raw counts at time_s."""

    def truth(self, time_s: float) -> dict[str, float]:
        """The true state at time_s by name."""

    def setpoint(self, time_s: float) -> int:
        """The setpoint at time_s, in the integers of the system."""


class System(Protocol):
    """scenarios.py: the scenarios, tunings and plant of a system. Mappings that have nothing to name are empty."""

    @property
    def SCENARIOS(self) -> Mapping[str, str]:
        """Scenario -> one sentence."""

    @property
    def SECONDS(self) -> Mapping[str, float]:
        """Scenario -> its length unless told otherwise."""

    @property
    def DEFAULT_SCENARIO(self) -> str: ...

    @property
    def TUNINGS(self) -> Mapping[str, AnyTuning]: ...

    @property
    def TUNING_NOTES(self) -> Mapping[str, str]:
        """Tuning -> one sentence."""

    @property
    def DEFAULT_TUNING(self) -> str: ...

    @property
    def PERIOD_US(self) -> int:
        """Period of a step unless told otherwise."""

    @property
    def LINK(self) -> Mapping[str, int]:
        """Parameters of the link's part that the system needs, by name; {}: the defaults."""

    @property
    def STARTS(self) -> Mapping[str, Start]:
        """Start-up mode of the filter -> its settings, for tunings with a field `start`; {}: there are none."""

    @property
    def START_NOTES(self) -> Mapping[str, str]:
        """Start-up mode -> one sentence."""

    @property
    def CONDITIONS(self) -> Mapping[str, str]:
        """Keyword of `scenario` that takes a number -> one sentence; {}: there are none."""

    @property
    def FAULTS(self) -> Mapping[str, str]:
        """Kind of a fault -> one sentence; {}: there are none."""

    @property
    def FAULT_CHANNELS(self) -> Sequence[str]:
        """What a fault can be of."""

    @property
    def OUTPUT_FRAMES(self) -> Mapping[str, tuple[str, str]]:
        """Signal of the record that moves the plant -> (frame, signal) that carries it; {}: nothing is driven."""

    @property
    def OUTPUTS(self) -> Sequence[str]:
        """These signals of the record; (): nothing is driven, and every loop is open."""

    def faults(self, requests: Sequence[Request], /) -> Sequence[object]:
        """What `scenario` takes as faults; raises UsageError for a kind or a channel that there is not."""

    def scenario(
        self,
        name: str,
        seed: int,
        /,
        *,
        seconds: float | None = None,
        period_us: int = ...,
        faults: Sequence[object] = (),
        **conditions: float,
    ) -> Scenario:
        """Draw a run. conditions: those of CONDITIONS. Raises UsageError for what cannot be drawn."""

    def plant(self, scenario: Scenario, /, *, open_loop: bool = ...) -> Plant:
        """The physics of a run. open_loop: its motion is prescribed, and the outputs move nothing."""


@runtime_checkable
class PushedSystem(Protocol):
    """A system whose page shows a run with a push."""

    @property
    def PUSHED(self) -> tuple[str, str]:
        """Scenario, and the push as text for `faults`."""


class Coupling(Protocol):
    """A plant joined to the pins of a simulated machine."""

    @property
    def taken(self) -> list[Conversion]:
        """The samples that the board took, in order of time."""


Couple = Callable[["Machine", Plant], Coupling]
"""Joins a plant to the pins of a machine; the plant's time 0 is the first sample of a step that the board takes."""


class Pins(Protocol):
    """pins.py: a system on the pins of the virtual board."""

    @property
    def Coupling(self) -> Couple: ...

    @property
    def FRAMES(self) -> tuple[str, ...]:
        """What a step sends: the raw counts that the system uses, and what a viewer wants."""

    @property
    def SCENARIO(self) -> str:
        """What a served board's plant does unless told otherwise."""

    @property
    def SHOWN(self) -> str:
        """What a plant that is only looked at does."""

    @property
    def TUNING(self) -> str:
        """The tuning for the board's own sensors."""


@runtime_checkable
class AnalogPins(Protocol):
    """pins.py of a system whose sensors are analog; a system without ADC_PINS has digital ones on I2C."""

    @property
    def ADC_PINS(self) -> tuple[str, ...]:
        """The pins of its raw channels, in their order."""


@runtime_checkable
class BridgePins(Protocol):
    """pins.py of a system that drives a bridge; a system without BREAK_PIN drives speed controllers, or nothing."""

    @property
    def BREAK_PIN(self) -> str:
        """Low: the driver of the bridge reports a fault."""


class FixedStep(Protocol):
    """fixed.py: the step in integers. A value is an int (one run), or an int64 array (one value per run)."""

    def control_init(self, p: Params, /) -> object:
        """The state before the first step."""

    def control_step(self, c: object, p: Params, raw: Sequence[Integer], setpoint: Integer, /) -> tuple[Integer, ...]:
        """One step: changes the state c; gives the values of its words, in the written order. raw: six counts."""


class ReferenceModel(Protocol):
    """reference.py: the published equations in float64."""

    def run_control(
        self, tuning: AnyTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None, /
    ) -> dict[str, FloatArray]:
        """A whole run. raw: (steps, counts[, runs]); setpoint: (steps[, runs]), 0 when left out; (steps[, runs])."""


SCENARIOS = Part[System]("scenarios", System)
FIXED = Part[FixedStep]("fixed", FixedStep)
REFERENCE = Part[ReferenceModel]("reference", ReferenceModel)
PINS = Part[Pins]("pins", Pins, without="the board has no sensors of its own for it, its samples come as frames")


def fitted(scenario: Scenario, tuning: AnyTuning) -> AnyTuning:
    """The tuning for a scenario's run."""
    return scenario.fit(tuning) if isinstance(scenario, FittedScenario) else tuning
