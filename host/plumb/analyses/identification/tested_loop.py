"""Description of a loop for `plumb tune pid`: how it is swung, which signals show it, and which gains it has.

A one-axis system whose setpoint is a tilt has one loop, `AxisLoop`. Another system declares its loops, one for each
axis, in judging/NAME/tested_loops.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

import numpy as np

from plumb import systems
from plumb.analyses.identification.pid_design import PidSearch, Search
from plumb.analyses.identification.plant_fit import Excitation
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, dequantise
from plumb.contract.run_reference import run_control
from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.spec.signal_units import word_signals
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning, AxisTuning, Pid
from plumb.tuning.loop_model import Controller, Loop, PlantModel

if TYPE_CHECKING:
    from plumb.contract.scenario import Plant

G = TypeVar("G")
Gains: TypeAlias = Any  # Any: gains of any kind; the loop that made them takes them back
TURN_Q32 = 2.0**32
SCENARIO = "hold"
"""The scenario of the simulated plant of one axis: attitude hold with gusts, imbalance and the sensors' errors."""
MOST_COMMAND = 0.98
GAINS = ("kp_per_deg", "ki_per_deg_s", "kd_per_dps", "derivative_tau_s")


@dataclass(frozen=True)
class Held:
    """The controlled quantity of a loop: the quantity that its swing asks for, its unit, and that unit in a name."""

    quantity: str
    unit: str
    suffix: str


TILT = Held("tilt", "deg", "deg")


class Inputs(Protocol):
    """Raw counts and setpoints of a test, and the first step that is measured."""

    @property
    def raw(self) -> RawCounts: ...
    @property
    def setpoint(self) -> Setpoints: ...
    @property
    def begin(self) -> int: ...


class TestedLoop(Protocol[G]):
    """One loop of a system. The swing is what the setpoint, or a stick, asks for: a tilt in degrees, or what `held`
    names; the names of the members are those of a tilt."""

    @property
    def held(self) -> Held: ...
    @property
    def tuning(self) -> AnyTuning: ...
    @property
    def gains(self) -> G:
        """Those of the tuning."""

    @property
    def settle_s(self) -> float:
        """Before the swing of a simulated plant begins."""

    @property
    def signals(self) -> tuple[str, str]:
        """Names of the command's signal and of the rate's."""

    @property
    def on_link(self) -> bool:
        """Whether the test can be made in real time over a link."""

    def plant(self, seed: int, seconds: float) -> Plant:
        """The simulated plant of the test."""

    def inputs(self, counts: tuple[int, ...], setpoint: int, asked_deg: float) -> tuple[tuple[int, ...], int]:
        """Counts and setpoint of a step, with the swing. counts, setpoint: those of the plant."""

    def asked_deg(self, raw: RawCounts, setpoint: Setpoints) -> FloatArray:
        """The swing as the board had it, (steps,)."""

    def tilt_deg(self, truth: Mapping[str, float]) -> float:
        """The true tilt."""

    def estimated_deg(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        """The estimated tilt, (steps,)."""

    def closed(self, words: Words) -> BoolArray:
        """Whether the loop holds the tilt that is asked for, (steps,)."""

    def limited(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        """1 for every step at which a limit of the controller acted, (steps,)."""

    def loop(self, plant: PlantModel, run: Inputs, period_us: int | None = None) -> Loop[G]:
        """The loop with this plant. period_us: another period of the steps."""

    def search(self) -> Search[G]:
        """The gains that are tried."""

    def named(self, gains: G) -> dict[str, float]:
        """Gains by the whole names of their settings."""

    def tuned(self, gains: G) -> AnyTuning:
        """The tuning with other gains."""


class TestedLoops(Protocol):
    """tested_loops.py of a system: the loops that `plumb tune pid` tests."""

    @property
    def AXES(self) -> tuple[str, ...]: ...

    def loop_of(self, params: ControlParams, axis: str, /) -> TestedLoop[Gains]:
        """The loop of an axis, with the tuning of these parameters."""


TESTED = Part[TestedLoops]("tested_loops", TestedLoops, without="it holds no tilt that a host sets", place="judging")


@dataclass(frozen=True)
class AxisLoop:
    """The loop of a one-axis system: a PID that holds the tilt of its setpoint."""

    tuning: AxisTuning
    settle_s: float = 16.0
    """The simulated axis is held by hand, pulled and let go first."""
    signals: tuple[str, str] = ("command", "rate_dps")
    on_link: bool = True
    held: Held = TILT

    @property
    def gains(self) -> Pid:
        return self.tuning.pid

    def plant(self, seed: int, seconds: float) -> Plant:
        system = systems.load(self.tuning.system)
        return system.plant(system.scenario(SCENARIO, seed, seconds=seconds, period_us=self.tuning.period_us))

    def inputs(self, counts: tuple[int, ...], setpoint: int, asked_deg: float) -> tuple[tuple[int, ...], int]:
        turns = round(asked_deg / 360.0 * TURN_Q32)
        return counts, (turns + (1 << 31)) % (1 << 32) - (1 << 31)

    def asked_deg(self, raw: RawCounts, setpoint: Setpoints) -> FloatArray:
        return np.asarray(setpoint / TURN_Q32 * 360.0)

    def tilt_deg(self, truth: Mapping[str, float]) -> float:
        return truth["tilt_deg"]

    def estimated_deg(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        return signals["tilt_deg"]

    def closed(self, words: Words) -> BoolArray:
        return np.ones(len(words), np.bool_)

    def limited(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        return np.asarray(np.abs(signals[self.signals[0]]) > MOST_COMMAND, np.float64)

    def loop(self, plant: PlantModel, run: Inputs, period_us: int | None = None) -> Loop[Pid]:
        r_deg2 = float(np.mean(run_control(self.tuning, run.raw, run.setpoint)["r_deg2"][run.begin :]))
        tuning = self.tuning
        if period_us is not None:
            tuning = replace(tuning, period_us=period_us, exact_period_s=None)
        return Loop(plant, Controller(tuning, r_deg2))

    def search(self) -> Search[Pid]:
        return PidSearch()

    def named(self, gains: Pid) -> dict[str, float]:
        return {f"pid.{name}": getattr(gains, name) for name in GAINS}

    def tuned(self, gains: Pid) -> AxisTuning:
        return replace(self.tuning, pid=gains)


def signals_of(system: str, words: Words) -> dict[str, FloatArray]:
    """Every signal of a record by name with its unit, (steps,)."""
    return {
        name: np.asarray(words[signal.word] * signal.scale, np.float64) for name, signal in word_signals(system).items()
    }


@dataclass(frozen=True)
class TestedRun:
    """params, raw counts and setpoints of every step. truth_deg: of the simulated tilt, empty without one."""

    params: ControlParams
    tested: TestedLoop[Gains]
    excitation: Excitation
    raw: RawCounts
    setpoint: Setpoints
    begin: int
    truth_deg: FloatArray

    def signals(self) -> dict[str, FloatArray]:
        """Every signal by name with its unit, (steps,)."""
        return signals_of(self.params.system, run_fixed.run_control(self.params, self.raw, self.setpoint))


def loop_of(params: ControlParams, axis: str | None = None) -> TestedLoop[Gains]:
    """The loop of a system, or of one of its axes. Raises UsageError for a system without one, and an axis that it has
    not."""
    system = declarations.system(params.system)
    if system.name in systems.with_part(TESTED.name):
        loops = systems.load(system.name, TESTED)
        chosen = axis or loops.AXES[0]
        if chosen not in loops.AXES:
            raise UsageError(f"{system.name} has no loop '{chosen}': give --loop {' or '.join(loops.AXES)}")
        return loops.loop_of(params, chosen)
    tuning = dequantise(params)
    setpoints = [word for word in system.words if word.name == "setpoint" or word.name.startswith("setpoint_")]
    if not isinstance(tuning, AxisTuning) or not setpoints or setpoints[0].unit != "turn" or not system.output:
        raise UsageError(f"{params.system} holds no tilt that a host sets: its loop cannot be tested so")
    if axis:
        raise UsageError(f"{params.system} has one loop: leave --loop {axis} out")
    return AxisLoop(tuning)
