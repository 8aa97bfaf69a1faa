"""The loops of `quadrotor` that `plumb tune pid` tests: roll and pitch in mode level, hovering in the simulation.

The pilot lets go of the sticks and holds the height; the stick of one axis swings. The gains are those of the rate
loop, and of the vertical over it; without the latter the loop is that of mode rate, which needs the same margins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plumb.analyses.identification.pid_design import Search, as_typed
from plumb.analyses.identification.tested_loop import TILT, Held, Inputs
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import ControlParams
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.systems.quadrotor import courses, quantise
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.fixed import AIRBORNE, FLIES, LEVELS, LOST
from plumb.systems.quadrotor.plant import QuadrotorPlant
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import FULL_Q15
from plumb.tuning.cascade_model import Cascade, CascadeGains
from plumb.tuning.loop_model import Loop, PlantModel

AXES = ("roll", "pitch")
FIRST_STICK = 6
"""Place among the inputs: six counts come before it."""
HEIGHT_SETTLES_S = 2.0
CLOSED = AIRBORNE | FLIES | LEVELS
"""Flags of a step in which the stick asks for a lean, in the air."""
LEVEL_PER_S = (1.0, 20.0)
INTEGRAL_PER_S = (0.3, 3.0)
"""Integral by proportional gain. A faster one rejects more, and overshoots when a lean is asked for."""
LONGEST_LEAD_S = 0.015
"""Derivative by proportional gain: more than the rotors' lag gives them their own vibration."""


class CascadeSearch:
    """Proportional, integral and derivative gain of the rate, and the gain of the vertical."""

    def starts(self, before: CascadeGains, period_s: float) -> list[FloatArray]:
        starts = []
        for by in (1.0, 0.5):
            gains = (by * before.kp_per_dps, by * before.ki_per_deg, by * before.kd_per_dps2, by * before.level_per_s)
            starts.append(np.asarray(np.log(np.maximum(gains, 1e-7)), np.float64))
        return starts

    def gains(self, logs: FloatArray, before: CascadeGains, period_s: float) -> CascadeGains:
        kp, ki, kd, level = (float(value) for value in np.exp(logs))
        level = min(max(level, LEVEL_PER_S[0]), LEVEL_PER_S[1])
        low, high = INTEGRAL_PER_S
        return CascadeGains(kp, min(max(ki, low * kp), high * kp), min(kd, LONGEST_LEAD_S * kp), level)

    def rounded(self, gains: CascadeGains) -> CascadeGains:
        return CascadeGains(*as_typed(gains.kp_per_dps, gains.ki_per_deg, gains.kd_per_dps2, gains.level_per_s))

    def parts(self, gains: CascadeGains) -> list[CascadeGains]:
        return [replace(gains, level_per_s=0.0)]


@dataclass(frozen=True)
class AxisOfVehicle:
    """Roll or pitch."""

    tuning: QuadrotorTuning
    axis: str
    settle_s: float = courses.ACTS_S + HEIGHT_SETTLES_S
    on_link: bool = False
    held: Held = TILT

    @property
    def index(self) -> int:
        return AXES.index(self.axis)

    @property
    def signals(self) -> tuple[str, str]:
        return f"{self.axis}_demand", f"rate_{self.index}_dps"

    @property
    def gains(self) -> CascadeGains:
        rate = getattr(self.tuning.rates, self.axis)
        return CascadeGains(rate.kp_per_dps, rate.ki_per_deg, rate.kd_per_dps2, self.tuning.level.gain_per_s)

    def plant(self, seed: int, seconds: float) -> QuadrotorPlant:
        run = quadrotor.scenario("lean", seed, period_us=self.tuning.period_us, seconds=seconds)
        return QuadrotorPlant(replace(run, course=replace(courses.LEVEL, seconds=seconds)))

    def inputs(self, counts: tuple[int, ...], setpoint: int, asked_deg: float) -> tuple[tuple[int, ...], int]:
        full = math.sin(math.radians(self.tuning.level.lean_max_deg))
        stick = round(FULL_Q15 * max(-1.0, min(1.0, math.sin(math.radians(asked_deg)) / full)))
        at = FIRST_STICK + self.index
        return (*counts[:at], stick, *counts[at + 1 :]), setpoint

    def asked_deg(self, raw: RawCounts, setpoint: Setpoints) -> FloatArray:
        full = math.sin(math.radians(self.tuning.level.lean_max_deg))
        return np.asarray(np.degrees(np.arcsin(raw[:, FIRST_STICK + self.index] / FULL_Q15 * full)))

    def tilt_deg(self, truth: Mapping[str, float]) -> float:
        """The lean about this axis: positive roll lowers the right side, positive pitch the nose."""
        up = (truth["up_y"], -truth["up_x"])[self.index]
        return math.degrees(math.asin(max(-1.0, min(1.0, up))))

    def estimated_deg(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        up = (signals["up_1"], -signals["up_0"])[self.index]
        return np.asarray(np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))))

    def closed(self, words: Words) -> BoolArray:
        return np.asarray((words["flags"] & (CLOSED | LOST)) == CLOSED, np.bool_)

    def limited(self, signals: Mapping[str, FloatArray]) -> FloatArray:
        return np.asarray(signals[f"{self.axis}_excess"] != 0.0, np.float64)

    def loop(self, plant: PlantModel, run: Inputs, period_us: int | None = None) -> Loop[CascadeGains]:
        period_s = self.tuning.period_s if period_us is None else 1e-6 * period_us
        return Loop(plant, Cascade(period_s, self.tuning.rates.d_tau_s))

    def search(self) -> Search[CascadeGains]:
        return CascadeSearch()

    def named(self, gains: CascadeGains) -> dict[str, float]:
        rates = {name: getattr(gains, name) for name in ("kp_per_dps", "ki_per_deg", "kd_per_dps2")}
        named = {f"rates.{self.axis}.{name}": value for name, value in rates.items()}
        return {**named, "level.gain_per_s": gains.level_per_s}

    def tuned(self, gains: CascadeGains) -> QuadrotorTuning:
        rate = replace(
            getattr(self.tuning.rates, self.axis),
            kp_per_dps=gains.kp_per_dps,
            ki_per_deg=gains.ki_per_deg,
            kd_per_dps2=gains.kd_per_dps2,
        )
        level = replace(self.tuning.level, gain_per_s=gains.level_per_s)
        return replace(self.tuning, rates=replace(self.tuning.rates, **{self.axis: rate}), level=level)


def loop_of(params: ControlParams, axis: str) -> AxisOfVehicle:
    """The loop of an axis, with the tuning of these parameters."""
    return AxisOfVehicle(quantise.dequantise(params), axis)
