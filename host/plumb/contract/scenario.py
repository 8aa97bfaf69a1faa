"""Contract of the runs of any system under proof: scenarios, tunings and the plant, as Protocols.

`plumb.systems.load` checks a module against its contract. Scenarios, plants and tunings only fit the system that they
come from; the types do not express this, so a caller must not mix two systems.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from functools import cache
from typing import Protocol, TypeVar, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from plumb.contract.disturbance import Request
from plumb.errors import UsageError
from plumb.spec import dbc, declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.system import RECEIVER
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning, Start

TuningT = TypeVar("TuningT", bound=AnyTuning)


class Scenario(Protocol):
    """One run with all its random values, drawn from its seed."""

    @property
    def period_us(self) -> int:
        """Sampling period in us."""

    @property
    def steps(self) -> int:
        """Samples of the run."""

    @property
    def time_s(self) -> FloatArray:
        """Sampling instants in s, (steps,)."""

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
    """A scenario whose tuning depends on the drawn values."""

    def fit(self, tuning: TuningT) -> TuningT:
        """The tuning for this run."""


@runtime_checkable
class WiredScenario(Protocol):
    """A scenario of certain sensors, which have to be set on the board."""

    @property
    def link(self) -> Mapping[str, int]:
        """Parameters of the link's part that these sensors need, by name."""


@runtime_checkable
class TunedScenarios(Protocol):
    """A system with scenarios that have a tuning of their own."""

    @property
    def TUNING_FOR(self) -> Mapping[str, str]:
        """Scenario -> the tuning that it is made for, and with whose period it is drawn by default."""


class Plant(Protocol):
    """Simulated physics with the sensors."""

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with the outputs of the last step, by name of the word; {} before the first step."""

    def counts(self, time_s: float) -> tuple[int, ...]:
        """The inputs of a step at time_s: the raw counts, or these and the words of the commands."""

    def truth(self, time_s: float) -> dict[str, float]:
        """The true state at time_s by name."""

    def setpoint(self, time_s: float) -> int:
        """The setpoint at time_s, in the integers of the system."""


class System(Protocol):
    """scenarios.py: the scenarios, tunings and plant of a system. `absent` has the names that it may leave out."""

    @property
    def SCENARIOS(self) -> Mapping[str, str]:
        """Scenario -> one sentence."""

    @property
    def SECONDS(self) -> Mapping[str, float]:
        """Scenario -> its default length in s."""

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
        """Default period of a step in us."""

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
        """Names of the sensors or outputs that a fault can affect."""

    @property
    def OUTPUT_FRAMES(self) -> Mapping[str, tuple[str, str]]:
        """Word of the record that drives the plant -> (frame, signal) that carries it; {} without an actuator."""

    @property
    def OUTPUTS(self) -> Sequence[str]:
        """The words of OUTPUT_FRAMES; () without an actuator, when every loop is open."""

    def faults(self, requests: Sequence[Request], /) -> Sequence[object]:
        """The faults in the form that `scenario` accepts; raises UsageError for an unknown kind or channel."""

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
        """Draw a run. conditions: those of CONDITIONS. Raises UsageError for an invalid combination."""

    def plant(self, scenario: Scenario, /, *, open_loop: bool = ...) -> Plant:
        """The plant of a run. open_loop: the motion is prescribed and the outputs have no effect."""


@runtime_checkable
class PushedSystem(Protocol):
    """A system whose documentation page shows a run with a push."""

    @property
    def PUSHED(self) -> tuple[str, str]:
        """Scenario, and the push as text for `faults`."""


@runtime_checkable
class LinkedSensors(Protocol):
    """A system with tunings for sensors that have to be set on the board."""

    @property
    def SENSOR_LINKS(self) -> Mapping[str, Mapping[str, int]]:
        """Tuning -> parameters outside the control step that its sensors need."""


def absent(name: str) -> dict[str, object]:
    """Optional parts of scenarios.py of a system: link parameters, start-up modes, conditions and faults, if there are
    none, and the outputs, which system.toml declares."""

    def faults(requests: Sequence[Request]) -> Sequence[object]:
        if requests:
            raise UsageError(f"{name} has no faults")
        return ()

    frames = dbc.output_frames(name)
    return {
        "LINK": {},
        "STARTS": {},
        "START_NOTES": {},
        "CONDITIONS": {},
        "FAULTS": {},
        "FAULT_CHANNELS": (),
        "OUTPUT_FRAMES": frames,
        "OUTPUTS": tuple(frames),
        "faults": faults,
    }


SCENARIOS = Part[System]("scenarios", System, defaults=absent)


def link_words(system: System, scenario: Scenario) -> dict[str, int]:
    """Parameters of the link's part for a run: those of the system, then those of the scenario's sensors."""
    return {**system.LINK, **(scenario.link if isinstance(scenario, WiredScenario) else {})}


def sensor_words(system: System, tuning: str) -> Mapping[str, int]:
    """Parameters outside the control step that the sensors of a tuning need."""
    return system.SENSOR_LINKS.get(tuning, {}) if isinstance(system, LinkedSensors) else {}


def calibrated_words(name: str) -> dict[str, int]:
    """Says that the sensors are those of the tuning, as those of a simulated plant are that no hand holds."""
    return {"calibrated": 1} if RECEIVER in declarations.system(name).parts else {}


def tuning_for(system: System, scenario: str) -> str:
    """The default tuning of a scenario."""
    if _has_tuned_scenarios(cast(Hashable, system)):
        return cast(TunedScenarios, system).TUNING_FOR.get(scenario, system.DEFAULT_TUNING)
    return system.DEFAULT_TUNING


@cache
def _has_tuned_scenarios(system: Hashable) -> bool:
    return isinstance(system, TunedScenarios)


def fitted(scenario: Scenario, tuning: AnyTuning) -> AnyTuning:
    """The tuning, adapted to the scenario if it is a FittedScenario."""
    return scenario.fit(tuning) if isinstance(scenario, FittedScenario) else tuning
