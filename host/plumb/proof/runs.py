"""One run: the same raw counts through a board, the integer model and the float64 reference, and their comparison.

The three-way error budget: error of the sensors (accelerometer alone against truth), of the arithmetic (fixed against
reference), and of the board against the integers (must be zero).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from plumb import systems
from plumb.boards.contract import Answer, ChangesParameters, KeepsTime, RawCounts, Setpoints, StepBoard
from plumb.contract import run_fixed, run_reference
from plumb.contract.parameters import Changes, ControlParams
from plumb.contract.scenario import Scenario
from plumb.proof import limits
from plumb.proof.compare import Divergence, count_mismatches, first_divergence
from plumb.proof.measures import Measured, main_of
from plumb.proof.report import Plot, Statement
from plumb.proof.run_identity import part_of
from plumb.spec import declarations
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.spec.system_parts import Part


@dataclass(frozen=True)
class RunInputs:
    """Inputs of a board and the truth behind them; all arrays (steps,), raw (steps, 6).

    truth: by name, NaN where it is not known. scored: the samples that count.
    """

    time_s: FloatArray
    truth: dict[str, FloatArray]
    raw: RawCounts
    setpoint: Setpoints
    scored: BoolArray


class RunPlots(Measured, Protocol):
    """plots.py of a system: how a run is measured and drawn."""

    def metrics(self, run: Run, /) -> dict[str, float | None]:
        """Figures of a run by name: at least those of MEASURES, None where a run has no such figure."""

    def plots(self, run: Run, /, *, closed: bool) -> Sequence[Plot]:
        """The panels of the report. closed: the loop was closed."""


PLOTS = Part[RunPlots]("plots", RunPlots, place="judging")


def prescribed(scenario: Scenario) -> RunInputs:
    """Inputs of a scenario with prescribed motion: the controller runs but does not move the plant."""
    return RunInputs(scenario.time_s, scenario.truth(), scenario.counts(), scenario.setpoint(), scenario.scored)


@dataclass(frozen=True)
class Run:
    """A board's answer to some inputs, and the expected answer."""

    inputs: RunInputs
    params: ControlParams
    words: Words
    """The integer model's words for the same counts."""
    reference: dict[str, FloatArray]
    """Results of the float64 reference for the same counts, by name."""
    answer: Answer
    divergence: Divergence | None
    part: Mapping[str, object] = field(default_factory=dict)
    """Identity of the board, as from `plumb.proof.run_identity.part_of`; {}: unknown."""
    changes: Changes = ()
    """Changes of the parameters during the run."""

    @property
    def system(self) -> str:
        return self.params.system

    @property
    def board_words(self) -> Words:
        """The board's own words if it gave them, else the model's, which its digests confirm."""
        return self.words if self.answer.words is None else self.answer.words

    @property
    def mismatches(self) -> int:
        """Number of steps whose digest differs from the model's, of those of which all was received."""
        expected = self.words.digests()
        return count_mismatches(expected, self.answer.received(expected))

    @property
    def verdict(self) -> str:
        if self.mismatches:
            return "fail"
        return "pass" if self.answer.unverified_from is None else "unverified"

    @property
    def bit_exact(self) -> bool | None:
        """Whether every step equals the model; None where an answer was lost and no other one differs."""
        return {"pass": True, "fail": False}.get(self.verdict)

    def accuracy(self, heading: Mapping[str, object]) -> limits.Accuracy:
        """The metrics against the limits of the run that the heading of a summary names. A run with faults or
        conditions is held to the limit of the run without them, a shorter one to that of shorter runs."""
        from plumb.proof.figures import limits_of

        scenario, tuning, loop = (str(heading.get(name)) for name in ("scenario", "tuning", "loop"))
        whole_s = systems.load(self.system).SECONDS.get(scenario)
        if whole_s is None:
            return limits.judged(
                self.metrics(), (), main_of(self.system), "no limit: only the system's scenarios have one"
            )
        shorter = len(self.inputs.raw) * self.params.period_s < 0.999 * whole_s
        notes = [f"for less than {whole_s:g} s"] if shorter else []
        notes += ["without faults or conditions"] if heading.get("faults") or heading.get("conditions") else []
        declared = limits_of(self.system, scenario, tuning, loop, shorter=shorter)
        return limits.judged(self.metrics(), declared, main_of(self.system), note=", ".join(notes))

    def statements(self, heading: Mapping[str, object]) -> list[Statement]:
        """The meaning of the verdict in words: bits, then accuracy."""
        steps, differ, lost = len(self.inputs.raw), self.mismatches, self.answer.unverified_from
        if differ:
            bits = f"{differ} of {steps} steps differ from the model"
            bits += f"; the first at {self.divergence}" if self.divergence is not None else ""
        elif lost is not None:
            bits = f"unverified from step {lost} on: {self.answer.why or 'frames were lost on the way'}"
            bits += "; every step of which all was received equals the model"
        else:
            bits = f"every one of the {steps} steps equals the model"
        accuracy = self.accuracy(heading)
        return [
            Statement("bit-exact", bits, self.bit_exact),
            Statement("accuracy", accuracy.text, {"pass": True, "fail": False}.get(accuracy.verdict or "")),
        ]

    def metrics(self) -> dict[str, float | int | None]:
        """Metrics of the run by name; those that all systems have come first."""
        own = systems.load(self.system, PLOTS).metrics(self)
        known = {name: None if value is None or np.isnan(value) else value for name, value in own.items()}
        return {**known, "target_vs_fixed_mismatches": self.mismatches}

    def summary(self, **heading: Any) -> dict[str, Any]:
        """The JSON object of `run --json`; heading: its first entries."""
        tail: dict[str, Any] = {
            "steps": len(self.inputs.raw),
            "verdict": self.verdict,
            "bit_exact": self.bit_exact,
            **self.accuracy(heading).to_json(),
            "metrics": self.metrics(),
        }
        if self.divergence is not None:
            tail["first_divergence"] = self.divergence.as_dict()
        if self.answer.unverified_from is not None:
            tail["unverified_from_step"] = self.answer.unverified_from
        return {**heading, **tail}


def open_loop(board: StepBoard, inputs: RunInputs, params: ControlParams, changes: Changes = ()) -> Run:
    """Run these inputs in lockstep. changes: of the parameters during the run; a board that does not accept them in
    lockstep runs in real time if it is a `KeepsTime`, else it runs only the steps before the first change."""
    if not changes:
        return judge(board, inputs, params, board.run_injected(params, inputs.raw, inputs.setpoint))
    if isinstance(board, ChangesParameters):
        answer = board.run_changed(params, changes, inputs.raw, inputs.setpoint)
    else:
        answer = _across_changes(board, inputs, params, changes)
    return judge(board, inputs, params, answer, changes)


def _across_changes(board: StepBoard, inputs: RunInputs, params: ControlParams, changes: Changes) -> Answer:
    """The answer of a board that accepts no changes in lockstep: at least to the steps before the first change."""
    first, why = changes[0].step, f"{board.name} takes no other parameters in lockstep; native, fixed and qemu do"
    if isinstance(board, KeepsTime):
        answer = board.run_paced(params, changes, inputs.raw, inputs.setpoint)
        if answer.unverified_from is None or answer.unverified_from >= first:
            return answer
        why = answer.why
    before = board.run_injected(params, inputs.raw[:first], inputs.setpoint[:first])
    return Answer(before.digests, None, first, why)


def closed_loop(board: StepBoard, scenario: Scenario, params: ControlParams) -> Run:
    """Run in closed loop: the controller on the board, the plant on the host; the outputs of a step drive the plant
    until the next sample."""
    inputs, answer = closed_loop_inputs(board, scenario, params)
    return judge(board, inputs, params, answer)


def closed_loop_inputs(
    board: StepBoard, scenario: Scenario, params: ControlParams, *, progress: bool = True
) -> tuple[RunInputs, Answer]:
    """The inputs from the plant in a closed loop, and the answer of the board. progress: shown on a terminal."""
    from tqdm import tqdm

    plant, stepper = systems.load(params.system).plant(scenario), board.stepper(params)
    declared = declarations.system(params.system)
    raw, setpoint = np.zeros((scenario.steps, declared.inputs), np.int16), np.zeros(scenario.steps, np.int32)
    truth: list[dict[str, float]] = []
    digests = np.zeros(scenario.steps, np.uint32)
    outputs: dict[str, int] = {}
    hidden = None if progress else True
    for step in tqdm(range(scenario.steps), desc=f"closed loop on {board.name}", unit="step", disable=hidden):
        time_s = step * scenario.period_us * 1e-6
        plant.follow(time_s, outputs)
        counts = plant.counts(time_s)
        raw[step] = declared.whole_inputs(counts)
        setpoint[step] = plant.setpoint(time_s)
        truth.append(plant.truth(time_s))
        output = stepper.step(counts, int(setpoint[step]))
        digests[step], outputs = output.digest, output.outputs
    return RunInputs(scenario.time_s, columns(truth), raw, setpoint, scenario.scored), Answer(digests)


def columns(rows: Sequence[dict[str, float]]) -> dict[str, FloatArray]:
    """Rows of the truth as one array for each name."""
    return {name: np.array([row[name] for row in rows], np.float64) for name in (rows[0] if rows else ())}


def judge(
    board: StepBoard | None, inputs: RunInputs, params: ControlParams, answer: Answer, changes: Changes = ()
) -> Run:
    """Compare an answer with the model; if they differ, find the first step and signal. board: None when it is gone; a
    difference is then known by its digest alone."""
    words = run_fixed.run_changed(params, changes, inputs.raw, inputs.setpoint)
    ideal = _reference(inputs, params, changes)

    def words_of_step(step: int) -> Mapping[str, int]:
        if answer.words is not None and changes:
            return {name: int(values[step]) for name, values in answer.words.items()}
        return {} if board is None else board.words_of_step(params, inputs.raw, inputs.setpoint, step)

    asked = words_of_step if answer.words is not None or not changes else None  # no lockstep repeats a change
    divergence = first_divergence(words, answer.received(words.digests()), asked)
    return Run(inputs, params, words, ideal, answer, divergence, {} if board is None else part_of(board), changes)


def _reference(inputs: RunInputs, params: ControlParams, changes: Changes) -> dict[str, FloatArray]:
    """Results of the float64 reference. It does not follow changes of the gains: results that depend on them, because
    they differ between the tables of the run, are unknown from the first change on."""
    ideal = run_reference.run_control(params, inputs.raw, inputs.setpoint)
    tables = {tuple(change.params.words()): change.params for change in changes}
    for table in tables.values():
        for name, values in run_reference.run_control(table, inputs.raw, inputs.setpoint).items():
            if not np.array_equal(values, ideal[name], equal_nan=True):
                ideal[name] = np.where(np.arange(len(values)) < changes[0].step, ideal[name], np.nan)
    return ideal
