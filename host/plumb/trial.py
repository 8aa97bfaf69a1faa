"""One trial: counts through a board, the same counts through the model and the reference, and what came of it.

The three-way error budget: how far the sensors are off (accelerometer alone against truth), how far the integers are
from the equations (fixed against reference), and how far the board is from the integers (must be nothing).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb import fixed, metrics, reference
from plumb.boards import Answer, Board, RawCounts, Setpoints
from plumb.compare import Divergence, first_digest_divergence
from plumb.quantise import ControlParams, quantise
from plumb.recording import AxisInput
from plumb.systems.quad import Scenario
from plumb.systems.quad_plant import QuadPlant
from plumb.tuning import Tuning
from plumb.words import Words

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
TURN_DEG = 360.0 / 2.0**32
"""Degrees per unit of a binary angle."""


@dataclass(frozen=True)
class Flight:
    """What went into a board, and the truth behind it; all arrays (steps,), raw (steps, 6).

    tilt_deg, bias_dps: the truth, NaN where it is not known. scored: the samples that count.
    """

    time_s: FloatArray
    tilt_deg: FloatArray
    bias_dps: FloatArray
    raw: RawCounts
    setpoint_turn_q32: Setpoints
    scored: BoolArray


def prescribed(scenario: Scenario) -> Flight:
    """A scenario's own motion: the controller runs, and does not move the plant."""
    return Flight(
        scenario.time_s,
        scenario.tilt_deg(),
        scenario.bias_dps,
        scenario.counts(),
        scenario.setpoint_turn_q32(),
        metrics.scored(scenario.time_s),
    )


def recorded(axis: AxisInput, tuning: Tuning) -> tuple[Flight, ControlParams]:
    """One axis of a recording, and the tuning made to fit its sensor and its period."""
    steps = len(axis.raw)
    flight = Flight(
        axis.time_s, axis.truth_deg, np.full(steps, np.nan), axis.raw, np.zeros(steps, np.int32), axis.scored
    )
    return flight, quantise(replace(tuning, calibration=axis.calibration, period_us=axis.period_us))


@dataclass(frozen=True)
class Trial:
    """What a board answered to a flight, beside what it should have answered."""

    flight: Flight
    params: ControlParams
    words: Words
    """The integer model's words for the same counts."""
    reference_tilt_deg: FloatArray
    answer: Answer
    divergence: Divergence | None

    @property
    def mismatches(self) -> int:
        """Steps whose digest is not the model's."""
        return int(np.count_nonzero(self.words.digests() != self.answer.digests))

    @property
    def verdict(self) -> str:
        if self.mismatches:
            return "fail"
        return "pass" if self.answer.unverified_from is None else "unverified"

    @property
    def estimate_deg(self) -> FloatArray:
        """The board's tilt: its own words where it gave them, else the model's, which its digests confirm."""
        words = self.words if self.answer.words is None else self.answer.words
        return np.asarray(words["tilt_turn_q32"] * TURN_DEG)

    @property
    def accel_only_deg(self) -> FloatArray:
        """What the accelerometer alone says of the sampled values."""
        y, z = (self.words[name].astype(np.float64) for name in ("accel_y_g_q26", "accel_z_g_q26"))
        return metrics.accel_only_deg(y, z)

    def metrics(self) -> dict[str, float | int | None]:
        """The figures every trial reports; windows and definitions are in plumb.metrics."""
        truth_deg, scored = self.flight.tilt_deg, self.flight.scored

        def figure(measure: Callable[[FloatArray, FloatArray, BoolArray], FloatArray], deg: FloatArray) -> float | None:
            return float(measure(deg, truth_deg, scored)) if scored.any() else None

        apart = metrics.wrap_deg(self.words["tilt_turn_q32"] * TURN_DEG - self.reference_tilt_deg)
        return {
            "angle_rmse_deg": figure(metrics.angle_rmse_deg, self.estimate_deg),
            "angle_max_deg": figure(metrics.angle_max_deg, self.estimate_deg),
            "accel_only_rmse_deg": figure(metrics.angle_rmse_deg, self.accel_only_deg),
            "fixed_vs_reference_max_deg": float(np.max(np.abs(apart))),
            "target_vs_fixed_mismatches": self.mismatches,
        }

    def summary(self, **heading: Any) -> dict[str, Any]:
        """What `run --json` prints, after its heading."""
        tail = {"steps": len(self.flight.raw), "verdict": self.verdict, "metrics": self.metrics()}
        if self.divergence is not None:
            tail["first_divergence"] = self.divergence.as_dict()
        if self.answer.unverified_from is not None:
            tail["unverified_from_step"] = self.answer.unverified_from
        return {**heading, **tail}


def open_loop(board: Board, flight: Flight, params: ControlParams) -> Trial:
    """A flight as it is, in lockstep."""
    return judge(board, flight, params, board.run_injected(params, flight.raw, flight.setpoint_turn_q32))


def closed_loop(board: Board, scenario: Scenario, params: ControlParams) -> Trial:
    """The plant on the host, the loop on the board: each step's pulses move the axis until the next sample."""
    from tqdm import tqdm

    plant, stepper = QuadPlant(scenario), board.stepper(params)
    period_s = scenario.period_us * 1e-6
    raw = np.zeros((scenario.steps, 6), np.int16)
    tilt_deg, bias_dps = np.zeros(scenario.steps), np.zeros(scenario.steps)
    setpoint = scenario.setpoint_turn_q32()
    digests = np.zeros(scenario.steps, np.uint32)
    pulse_us = (0.0, 0.0)
    for step in tqdm(range(scenario.steps), desc=f"closed loop on {board.name}", unit="step", disable=None):
        time_s = step * period_s
        plant.advance_to(time_s, pulse_us)
        counts = plant.counts(time_s)
        raw[step], tilt_deg[step], bias_dps[step] = counts, plant.tilt_deg, plant.bias_dps(time_s)
        output = stepper.step(counts, int(setpoint[step]))
        digests[step] = output.digest
        pulse_us = (output.pulse_halfus[0] / 2.0, output.pulse_halfus[1] / 2.0)
    flight = Flight(scenario.time_s, tilt_deg, bias_dps, raw, setpoint, metrics.scored(scenario.time_s))
    return judge(board, flight, params, Answer(digests))


def judge(board: Board, flight: Flight, params: ControlParams, answer: Answer) -> Trial:
    """Compare an answer with the model, and where they differ find the first step and signal."""
    words = fixed.run_control(params, flight.raw, flight.setpoint_turn_q32)
    reference_tilt_deg = reference.run_control(params, flight.raw, flight.setpoint_turn_q32)["tilt_deg"]
    step = first_digest_divergence(words.digests(), answer.digests)
    divergence = None if step is None else locate(board, flight, params, words, step)
    return Trial(flight, params, words, reference_tilt_deg, answer, divergence)


def locate(board: Board, flight: Flight, params: ControlParams, words: Words, step: int) -> Divergence:
    """Run again up to the step whose digest differed, and name the first word that does."""
    actual = board.words_of_step(params, flight.raw, flight.setpoint_turn_q32, step)
    for name in words.names:
        expected = int(words[name][step])
        if actual[name] != expected:
            return Divergence(step, 0, name, expected, actual[name])
    return Divergence(step, 0, "digest", int(words.digests()[step]), None)
