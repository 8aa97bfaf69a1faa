"""The loop of `wheels` that `plumb tune pid` tests: the turn rate, on a ride straight ahead in the simulation.

The stick of the turn rate swings. The loop of balance is not tested so: what falls over without its controller is no
body behind a lag and a delay. Its margins come from the model (figures.py) and from the sweep (sweep.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plumb.analyses.identification.pid_design import Search, as_typed
from plumb.analyses.identification.tested_loop import Held, Inputs
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import ControlParams
from plumb.judging.wheels.sweep import BEGINS_S, straight_ahead
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.systems.wheels import quantise
from plumb.systems.wheels.fixed_state import DRIVES, LOST, SLIPS
from plumb.systems.wheels.plant import FULL_Q15, WheelsPlant
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.tuning.cascade_model import Cascade, CascadeGains
from plumb.tuning.loop_model import Loop, PlantModel, Response

AXES = ("turn",)
YAW = 11
"""Place among the inputs: nine counts, roll and pitch come before it."""
TURN_RATE = Held("turn rate", "deg/s", "dps")
INTEGRAL_PER_S = (0.3, 6.0)
"""Integral by proportional gain. A faster one overshoots when a turn is asked for; its integer has no room for more."""


class TurnLoop(Loop[CascadeGains]):
    """A loop that is asked for the rate."""

    def closed(self, hz: FloatArray, gains: CascadeGains) -> Response:
        there = TurnLoop(self.plant, self.controller, hz)
        gain = there.gain(gains)
        return np.asarray(gain / (1.0 + gain))


class TurnSearch:
    """Proportional and integral gain of the turn rate; the derivative gain stays."""

    def starts(self, before: CascadeGains, period_s: float) -> list[FloatArray]:
        gains = np.array([before.kp_per_dps, before.ki_per_deg])
        return [np.asarray(np.log(np.maximum(by * gains, 1e-7)), np.float64) for by in (1.0, 0.5)]

    def gains(self, logs: FloatArray, before: CascadeGains, period_s: float) -> CascadeGains:
        kp, ki = (float(value) for value in np.exp(logs))
        low, high = INTEGRAL_PER_S
        return replace(before, kp_per_dps=kp, ki_per_deg=min(max(ki, low * kp), high * kp))

    def rounded(self, gains: CascadeGains) -> CascadeGains:
        kp, ki = as_typed(gains.kp_per_dps, gains.ki_per_deg)
        return replace(gains, kp_per_dps=kp, ki_per_deg=ki)

    def parts(self, gains: CascadeGains) -> list[CascadeGains]:
        return []


@dataclass(frozen=True)
class TurnRate:
    """The turn rate, positive to the left."""

    tuning: WheelsTuning
    settle_s: float = BEGINS_S
    signals: tuple[str, str] = ("turn_demand", "turn_rate_dps")
    on_link: bool = False
    held: Held = TURN_RATE

    @property
    def gains(self) -> CascadeGains:
        turning = self.tuning.turning
        return CascadeGains(turning.kp_per_dps, turning.ki_per_deg, turning.kd_per_dps2, 0.0)

    def plant(self, seed: int, seconds: float) -> WheelsPlant:
        return WheelsPlant(straight_ahead(self.tuning, seed, seconds))

    def inputs(self, counts: tuple[int, ...], setpoint: int, asked_deg: float) -> tuple[tuple[int, ...], int]:
        stick = round(FULL_Q15 * max(-1.0, min(1.0, asked_deg / self.tuning.turning.rate_max_dps)))
        return (*counts[:YAW], stick, *counts[YAW + 1 :]), setpoint

    def asked_deg(self, raw: RawCounts, setpoint: Setpoints) -> FloatArray:
        return np.asarray(raw[:, YAW] / FULL_Q15 * self.tuning.turning.rate_max_dps)

    def tilt_deg(self, truth: Mapping[str, float]) -> float:
        return truth["turn_dps"]

    def estimated_deg(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        return signals["turn_rate_dps"]

    def closed(self, words: Words) -> BoolArray:
        return np.asarray((words["flags"] & (DRIVES | SLIPS | LOST)) == DRIVES, np.bool_)

    def limited(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        return np.asarray(signals["turn_excess"] != 0.0, np.float64)

    def loop(self, plant: PlantModel, run: Inputs, period_us: int | None = None) -> Loop[CascadeGains]:
        period_s = self.tuning.period_s if period_us is None else 1e-6 * period_us
        return TurnLoop(plant, Cascade(period_s, 0.0))

    def search(self) -> Search[CascadeGains]:
        return TurnSearch()

    def named(self, gains: CascadeGains) -> dict[str, float]:
        return {f"turning.{name}": getattr(gains, name) for name in ("kp_per_dps", "ki_per_deg")}

    def tuned(self, gains: CascadeGains) -> WheelsTuning:
        turning = replace(self.tuning.turning, kp_per_dps=gains.kp_per_dps, ki_per_deg=gains.ki_per_deg)
        return replace(self.tuning, turning=turning)


def loop_of(params: ControlParams, axis: str) -> TurnRate:
    """The loop, with the tuning of these parameters."""
    return TurnRate(quantise.dequantise(params))
