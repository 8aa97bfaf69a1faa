"""Flights of `quadrotor` over many seeds: the C integers in the loop, all runs side by side."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from plumb.boards import native_core
from plumb.physics.airframe import HUMMINGBIRD_X, Airframe
from plumb.physics.pilots import vertical
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.scenarios import apart_deg
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.plant import command_of
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import Vehicles
from plumb.tuning.quantise import quantise


@dataclass(frozen=True)
class Flown:
    """Of every step and run, (steps, runs): error_deg: estimated to true vertical; apart_deg: true to wanted vertical;
    lean_deg: true; rate_dps, asked_dps: (steps, 3, runs); height_m; phase. time_s: (steps,)."""

    time_s: FloatArray
    error_deg: FloatArray
    apart_deg: FloatArray
    lean_deg: FloatArray
    rate_dps: FloatArray
    height_m: FloatArray
    phase: FloatArray
    rotor: FloatArray

    def between(self, begin_s: float, end_s: float) -> slice:
        """The steps of a time."""
        first, last = np.searchsorted(self.time_s, (begin_s - 1e-9, end_s - 1e-9))
        return slice(int(first), int(last))


def fly(
    name: str,
    seeds: Iterable[int],
    tuning: QuadrotorTuning = quadrotor.HUMMINGBIRD,
    period_us: int = quadrotor.PERIOD_US,
    seconds: float | None = None,
    *,
    open_loop: bool = False,
    frame: Airframe = HUMMINGBIRD_X,
) -> Flown:
    """One scenario, all seeds. open_loop: an ideal controller flies, and the core runs beside it."""
    drawn = [quadrotor.scenario(name, seed, period_us=period_us, seconds=seconds) for seed in seeds]
    params = quantise(drawn[0].fit(replace(tuning, period_us=period_us)))
    vehicles, core = Vehicles(drawn, ideal=open_loop, frame=frame), native_core.Controllers(params, len(drawn))
    rows: list[tuple[FloatArray, ...]] = []
    command = np.zeros((4, len(drawn)))
    for step in range(drawn[0].steps):
        if step:
            vehicles.advance(command)
        inputs = np.concatenate([vehicles.counts(), vehicles.commands()], 1)
        words = core.step(inputs, vehicles.throttle_q15())
        command = command_of(np.stack([words[f"pulse_halfus_{rotor}"] for rotor in range(4)]))
        body = vehicles.body
        up = body.matrix[2]
        estimate = np.stack([words[f"up_q30_{axis}"] for axis in range(3)]) / 2.0**30
        rows.append((
            apart_deg(estimate, up), apart_deg(vertical(*vehicles.lean_rad), up),
            np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))), np.degrees(body.rate_radps), body.position_m[2].copy(),
            words["phase"].astype(np.float64), np.stack([words[f"rotor_q24_{rotor}"] for rotor in range(4)]) / 2.0**24,
        ))  # fmt: skip
    return Flown(drawn[0].time_s, *(np.stack(column) for column in zip(*rows, strict=True)))
