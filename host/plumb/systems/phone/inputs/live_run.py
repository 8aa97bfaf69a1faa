"""A phone's steps to a board, every one of them compared with the integer model.

The board runs in lockstep: a step is sent when the phone's samples for it are complete, so the phone's clock paces the
board. What has come while the board answered is sent together: a slow link gets longer turns instead of falling behind.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from plumb.boards import Answer, Board, RawCounts, Stepper
from plumb.errors import LinkError, UsageError
from plumb.inputs import recording
from plumb.proof import runs
from plumb.proof.compare import Divergence, first_divergence
from plumb.systems import run_fixed, run_reference
from plumb.systems.phone import scenarios as phone
from plumb.systems.phone.inputs.resampler import Step
from plumb.systems.phone.inputs.udp import TURN_S, Intake, Listener
from plumb.tuning.quantise import ControlParams, quantise

SILENCE_S = 5.0
"""Listened for so long without a step, the phone has stopped. Time in which this process did not listen, because the
board or the machine was busy, is nobody's silence."""


def params_of(tuning: str, period_us: int) -> ControlParams:
    """The integers of a shipped tuning at a period; raises UsageError where there is none."""
    if tuning not in phone.TUNINGS:
        raise UsageError(f"phone has no tuning '{tuning}'; it has {', '.join(phone.TUNINGS)}")
    return quantise(replace(phone.TUNINGS[tuning], period_us=period_us))


def counts(steps: Iterable[Step]) -> RawCounts:
    """Raw counts of steps, (n, 6)."""
    rows = [(*step.rate_dps, *step.force_g) for step in steps]
    columns = np.array(rows, np.float64).reshape(-1, 6).T
    return phone.counts_of(columns[:3], columns[3:])


def longest_run(steps: Iterable[Step]) -> list[Step]:
    """The longest stretch of steps that one run makes."""
    found: list[list[Step]] = []
    for step in steps:
        if step.first:
            found.append([])
        found[-1].append(step)
    return max(found, key=len, default=[])


def inputs_of(steps: list[Step], params: ControlParams, recorded: recording.Recording | None = None) -> runs.RunInputs:
    """One run as a trial takes it; the truth is the recording's optical reference, where it has one."""
    period_s = params.period_s
    time_s = np.array([step.time_s for step in steps], np.float64)
    truth = {f"{axis}_deg": np.full(len(steps), np.nan) for axis in ("pitch", "roll")}
    scored = np.zeros(len(steps), bool)
    if recorded is not None and recorded.ref_quat is not None:
        middle_s = time_s + period_s / 2.0
        vertical = recording.vertical(recorded.ref_quat)
        there = np.stack([np.interp(middle_s, recorded.time_s, column) for column in vertical.T])
        truth["pitch_deg"], truth["roll_deg"] = phone.pitch_roll_deg(there)
        nearest = np.searchsorted(recorded.time_s, middle_s).clip(0, len(recorded.time_s) - 1)
        scored = recorded.movement[nearest] & np.isfinite(there).all(axis=0)
    return runs.RunInputs(time_s, truth, counts(steps), np.zeros(len(steps), np.int32), scored)


@dataclass
class Run:
    """Steps from one beginning, and what the board said of each. divergence: where it was looked for and found."""

    steps: list[Step] = field(default_factory=list)
    digests: list[int] = field(default_factory=list)
    divergence: Divergence | None = None

    def trial(self, params: ControlParams) -> runs.Run:
        """The run as the board answered it; the board is not asked again."""
        inputs = inputs_of(self.steps, params)
        words = run_fixed.run_control(params, inputs.raw, inputs.setpoint)
        ideal = run_reference.run_control(params, inputs.raw, inputs.setpoint)
        answer = Answer(np.array(self.digests, np.uint32))
        return runs.Run(inputs, params, words, ideal, answer, self.divergence)


@dataclass
class Outcome:
    """What a live feed came to. divergence: the first step of any run whose digest was not the model's."""

    steps: int = 0
    mismatches: int = 0
    divergence: Divergence | None = None
    words: dict[str, int] = field(default_factory=dict)
    """Of the last step."""
    longest: Run = field(default_factory=Run)

    @property
    def verdict(self) -> str:
        return "fail" if self.mismatches else "pass" if self.steps else "unverified"


class Follower:
    """A board that takes steps as they come, beside the model that says what its digests must be."""

    def __init__(self, board: Board, params: ControlParams) -> None:
        self.outcome, self.params = Outcome(), params
        self._board = board
        self._run = Run()
        self._pair: tuple[Stepper, run_fixed.Controller] | None = None

    def run_steps(self, steps: Sequence[Step]) -> Iterator[tuple[Step, dict[str, int]]]:
        """Steps on both; each with the model's words, which the board's digest confirms."""
        at = 0
        while at < len(steps):
            if steps[at].first or self._pair is None:
                self._pair, self._run = (self._board.stepper(self.params), run_fixed.Controller(self.params)), Run()
            end = next((i for i in range(at + 1, len(steps)) if steps[i].first), len(steps))
            for step, words in self._advance(self._pair, steps[at:end]):
                at += 1
                yield step, words

    def _advance(
        self, pair: tuple[Stepper, run_fixed.Controller], steps: Sequence[Step]
    ) -> Iterator[tuple[Step, dict[str, int]]]:
        """Steps of one run, up to the first that differs where nobody has looked for the reason yet."""
        (stepper, model), outcome, run = pair, self.outcome, self._run
        raw = counts(steps)
        for step, digest, row in zip(steps, stepper.digests(raw), raw.tolist(), strict=True):
            words = model.step(tuple(row), 0)
            run.steps.append(step)
            run.digests.append(digest)
            outcome.steps, outcome.words = outcome.steps + 1, words
            if len(run.steps) > len(outcome.longest.steps):
                outcome.longest = run
            if digest != model.digest():
                outcome.mismatches += 1
                if outcome.divergence is None:
                    self._pair = None  # looking for it begins another run on the board
                    outcome.divergence = run.divergence = self._locate()
            yield step, words
            if self._pair is None:
                return

    def _locate(self) -> Divergence | None:
        raw = counts(self._run.steps)
        setpoint = np.zeros(len(raw), np.int32)
        words = run_fixed.run_control(self.params, raw, setpoint)
        return first_divergence(
            words,
            np.array(self._run.digests, np.uint32),
            lambda step: self._board.words_of_step(self.params, raw, setpoint, step),
        )


def follow(
    listener: Listener,
    intake: Intake,
    follower: Follower,
    *,
    seconds: float | None,
    wait_s: float,
    stop: list[int],
    saw: Callable[[Step, dict[str, int]], None],
) -> str:
    """Feeds the board until so many seconds of the phone's time are done, the phone falls silent, or `stop` has
    something in it. Gives what cut it short, empty when nothing did; raises LinkError when within wait_s nothing came
    that makes a step.
    """
    most = None if seconds is None else max(1, round(seconds / follower.params.period_s))
    outcome, listened_s, heard = follower.outcome, 0.0, dict(intake.resampler.counts.samples)
    while not stop and listened_s < (SILENCE_S if outcome.steps else wait_s):
        begin_s = time.monotonic()
        came = listener.receive_all(stop)
        listened_s += min(time.monotonic() - begin_s, TURN_S)
        steps = [step for datagram in came for step in intake.push(*datagram)]
        if most is not None:
            del steps[most - outcome.steps :]
        for step, words in follower.run_steps(steps):
            saw(step, words)
        if steps:
            listened_s, heard = 0.0, dict(intake.resampler.counts.samples)
        if most is not None and outcome.steps >= most:
            return ""
    if stop:
        return ""
    if not outcome.steps:
        raise LinkError(f"no step in {wait_s:g} s on {listener.address}:{listener.port}: {intake.missing()}")
    done_s = outcome.steps * follower.params.period_s
    return f"no step for {SILENCE_S:g} s after {done_s:g} s of steps: {intake.silent_since(heard)}"
