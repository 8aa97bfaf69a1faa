"""Run a phone's steps on a board in lockstep, and compare every step with the integer model.

A step is sent when the phone's samples for it are complete, so the phone's clock sets the pace. Steps that become ready
while the board replies are sent together; a slow link thus gets larger batches instead of falling behind.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from plumb.boards.contract import Answer, RawCounts, StepBoard, Stepper
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import LinkError, UsageError
from plumb.judging.phone.inputs.resampler import Step
from plumb.judging.phone.inputs.udp import TURN_S, Intake, Listener
from plumb.proof import runs
from plumb.proof.compare import Divergence
from plumb.readers import recording
from plumb.systems.phone import scenarios as phone

SILENCE_S = 5.0
"""Time without a step after which the phone counts as stopped. Time in which this process did not listen, because the
board or the machine was busy, does not count."""


def params_of(tuning: str, period_us: int) -> ControlParams:
    """The parameters of a shipped tuning at a period; raises UsageError for an unknown tuning."""
    if tuning not in phone.TUNINGS:
        raise UsageError(f"phone has no tuning '{tuning}'; it has {', '.join(phone.TUNINGS)}")
    return quantise(replace(phone.TUNINGS[tuning], period_us=period_us))


def counts(steps: Iterable[Step]) -> RawCounts:
    """Raw counts of steps, (n, 6)."""
    rows = [(*step.rate_dps, *step.force_g) for step in steps]
    columns = np.array(rows, np.float64).reshape(-1, 6).T
    return phone.counts_of(columns[:3], columns[3:])


def longest_run(steps: Iterable[Step]) -> list[Step]:
    """The steps of the longest run."""
    found: list[list[Step]] = []
    for step in steps:
        if step.first:
            found.append([])
        found[-1].append(step)
    return max(found, key=len, default=[])


def inputs_of(steps: list[Step], params: ControlParams, recorded: recording.Recording | None = None) -> runs.RunInputs:
    """The inputs of one run. The truth is the recording's optical reference, if it has one."""
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
class Followed:
    """The steps of one run and the board's digests. judged: what they were found to be, where they had to be looked
    at."""

    steps: list[Step] = field(default_factory=list)
    digests: list[int] = field(default_factory=list)
    judged: runs.Run | None = None

    def run(self, board: StepBoard | None, params: ControlParams) -> runs.Run:
        """The run, judged. board: is asked for the words of the first step that differs; None when it is gone."""
        if self.judged is None:
            answer = Answer(np.array(self.digests, np.uint32))
            self.judged = runs.judge(board, inputs_of(self.steps, params), params, answer)
        return self.judged


@dataclass
class Outcome:
    """Result of a live feed. divergence: the first step of any run whose digest differs from the model's."""

    steps: int = 0
    mismatches: int = 0
    divergence: Divergence | None = None
    words: dict[str, int] = field(default_factory=dict)
    """The words of the last step."""
    longest: Followed = field(default_factory=Followed)

    @property
    def verdict(self) -> str:
        return "fail" if self.mismatches else "pass" if self.steps else "unverified"


class Follower:
    """Runs steps on a board and on the integer model, and compares the digests."""

    def __init__(self, board: StepBoard, params: ControlParams) -> None:
        self.outcome, self.params = Outcome(), params
        self._board = board
        self._run = Followed()
        self._pair: tuple[Stepper, run_fixed.Controller] | None = None

    def run_steps(self, steps: Sequence[Step]) -> Iterator[tuple[Step, dict[str, int]]]:
        """Run steps on both; yields each step with the model's words, which the board's digest confirms."""
        at = 0
        while at < len(steps):
            if steps[at].first or self._pair is None:
                self._pair, self._run = (
                    (self._board.stepper(self.params), run_fixed.Controller(self.params)),
                    Followed(),
                )
            end = next((i for i in range(at + 1, len(steps)) if steps[i].first), len(steps))
            for step, words in self._advance(self._pair, steps[at:end]):
                at += 1
                yield step, words

    def _advance(
        self, pair: tuple[Stepper, run_fixed.Controller], steps: Sequence[Step]
    ) -> Iterator[tuple[Step, dict[str, int]]]:
        """Run steps of one run, up to the first divergence that has not been located yet."""
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
                    self._pair = None  # locating it begins a new run on the board
                    outcome.divergence = run.run(self._board, self.params).divergence
            yield step, words
            if self._pair is None:
                return


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
    """Feed the board until `seconds` of the phone's time have passed, the phone is silent, or `stop` is not empty.

    Returns the reason for an early end, else "". Raises LinkError if no step is complete within wait_s.
    """
    most = None if seconds is None else max(1, round(seconds / follower.params.period_s))
    outcome, listened_s, counted = follower.outcome, 0.0, dict(intake.resampler.counts.samples)
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
            listened_s, counted = 0.0, dict(intake.resampler.counts.samples)
        if most is not None and outcome.steps >= most:
            return ""
    if stop:
        return ""
    if not outcome.steps:
        raise LinkError(f"no step in {wait_s:g} s on {listener.address}:{listener.port}: {intake.missing()}")
    done_s = outcome.steps * follower.params.period_s
    return f"no step for {SILENCE_S:g} s after {done_s:g} s of steps: {intake.silent_since(counted)}"
