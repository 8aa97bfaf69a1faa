"""Flights of `quadrotor` over many seeds: the C integers in the loop with the plant in C."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from plumb.boards.native import plant as native_plant
from plumb.contract.parameters import ControlParams, quantise
from plumb.physics.airframe import HUMMINGBIRD_X, Airframe
from plumb.physics.pilots import vertical
from plumb.physics.sensors import Fault
from plumb.proof import moments
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.scenarios import apart_deg
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.drawn_run import Scenario
from plumb.systems.quadrotor.tuning import QuadrotorTuning


@dataclass(frozen=True)
class Flown:
    """Signals of every step and run, (steps, runs): error_deg: estimated to true vertical; apart_deg: true to wanted
    vertical; lean_deg: true; rate_dps: (steps, 3, runs); height_m; phase; rotor: (steps, 4, runs). time_s: (steps,).
    later_s: how much later than written in COURSES the events of each run come, (runs,)."""

    time_s: FloatArray
    later_s: FloatArray
    error_deg: FloatArray
    apart_deg: FloatArray
    lean_deg: FloatArray
    rate_dps: FloatArray
    height_m: FloatArray
    phase: FloatArray
    rotor: FloatArray

    def between(self, begin_s: float, end_s: float) -> slice:
        """The steps of a time that all runs have in common."""
        first, last = np.searchsorted(self.time_s, (begin_s - 1e-9, end_s - 1e-9))
        return slice(int(first), int(last))

    def around(self, values: FloatArray, begin_s: float, end_s: float = np.inf) -> FloatArray:
        """The rows of each run between two times of COURSES, where its own events are; as many of all runs: up to the
        end of the one whose events come last."""
        return moments.around(values, self.time_s, begin_s + self.later_s, end_s + self.later_s)


def fly(
    name: str,
    seeds: Iterable[int],
    tuning: QuadrotorTuning = quadrotor.HUMMINGBIRD,
    period_us: int = quadrotor.PERIOD_US,
    seconds: float | None = None,
    *,
    open_loop: bool = False,
    frame: Airframe = HUMMINGBIRD_X,
    faults: tuple[Fault, ...] = (),
) -> Flown:
    """One scenario, all seeds. open_loop: an ideal controller flies, and the core runs without effect on the flight.
    frame: instead of that of the scenario, whose gains the tuning has."""
    drawn = [quadrotor.scenario(name, seed, period_us=period_us, seconds=seconds, faults=faults) for seed in seeds]
    params = quantise(drawn[0].fit(replace(tuning, period_us=period_us)))
    drawn = [run if run.frame is frame else replace(run, frame=frame) for run in drawn]
    rows = [_columns(run, params, open_loop=open_loop) for run in drawn]
    later_s = np.array([run.course.later_s for run in drawn])
    return Flown(drawn[0].time_s, later_s, *(np.stack(column, -1) for column in zip(*rows, strict=True)))


def _columns(run: Scenario, params: ControlParams, *, open_loop: bool) -> tuple[FloatArray, ...]:
    """The columns of Flown from error_deg on, of one run."""
    answer = native_plant.closed_loop(run, params, open_loop=open_loop)
    words, truth = answer.words, answer.truth
    up = np.stack([truth[f"up_{axis}"] for axis in "xyz"])
    estimate = np.stack([words[f"up_q30_{axis}"] for axis in range(3)]) / 2.0**30
    wanted = vertical(np.radians(truth["asked_roll_deg"]), np.radians(truth["asked_pitch_deg"]))
    return (
        apart_deg(estimate, up), apart_deg(wanted, up), truth["lean_deg"],
        np.stack([truth[f"rate_{axis}_dps"] for axis in "xyz"], 1), truth["height_m"],
        words["phase"].astype(np.float64), np.stack([words[f"rotor_q24_{rotor}"] for rotor in range(4)], 1) / 2.0**24,
    )  # fmt: skip
