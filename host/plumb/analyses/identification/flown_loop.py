"""The loop of a machine that a pilot moved, from the recording of it: his sticks, or setpoints, are the test signal.

They do not repeat. The response is that of windows of the recording, related to what was asked for as in a test
(`plant_fit`): noise of the sensors and gusts do not reach the sticks above the frequency at which a pilot reacts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plumb.analyses.identification.loop_test import MOST_LIMITED
from plumb.analyses.identification.plant_fit import HIGHEST_HZ, LINES, Excitation, Measurement
from plumb.analyses.identification.tested_loop import Gains, TestedLoop, TestedRun, loop_of, signals_of
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.readers import log_replay
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray

WINDOW_S = 4.0
OVERLAP = 2
"""A window begins every half of its length: faded, they are nearly independent."""
LOWEST_HZ = 0.5
"""Below it a pilot reacts to the machine, and with it to gusts."""
LEAST_WINDOWS = 20
LEAST_ASKED_DEG = 0.5
"""Least rms of the setpoint in a window: a window with less determines nothing."""


@dataclass(frozen=True)
class FlownRun(TestedRun):
    """A recording. begin: the first step of the first window."""

    windows: tuple[int, ...]
    """First step of each."""

    def measurement(self) -> Measurement:
        """The windows, each less its mean and faded in and out."""
        samples = len(self.excitation.setpoint_deg)
        signals, fade = self.signals(), np.hanning(samples)
        command, rate = (signals[name] for name in self.tested.signals)

        def cut(whole: FloatArray) -> FloatArray:
            parts = [whole[begin : begin + samples] for begin in self.windows]
            return np.stack([(part - part.mean()) * fade for part in parts])

        asked = self.tested.asked_deg(self.raw, self.setpoint)
        return Measurement(self.excitation, cut(asked), cut(command), cut(rate))


def flown(params: ControlParams, raw: RawCounts, setpoint: Setpoints, axis: str | None) -> FlownRun:
    """The loop of an axis in these steps. Raises UsageError where too few of them determine it."""
    tested = loop_of(params, axis)
    period_s = tested.tuning.period_s
    samples = round(WINDOW_S / period_s)
    highest = min(HIGHEST_HZ, 0.4 / period_s)
    lines = np.unique(np.rint(np.geomspace(LOWEST_HZ, highest, LINES) * WINDOW_S).astype(np.int_))
    excited = Excitation(period_s, np.zeros(samples), lines)
    windows = tuple(_windows(params, tested, raw, setpoint, samples))
    if len(windows) < LEAST_WINDOWS:
        least_s = WINDOW_S * (1.0 + (LEAST_WINDOWS - 1) / OVERLAP)
        raise UsageError(
            f"{len(windows)} windows of {WINDOW_S:g} s in which the loop is closed and the stick of its axis moves are "
            f"too few, {LEAST_WINDOWS} are needed: move it for {least_s:.0f} s or longer, gently enough for no limit"
        )
    return FlownRun(params, tested, excited, raw, setpoint, windows[0], np.empty(0), windows)


@dataclass(frozen=True)
class KnownSteps:
    """The run of a log that is known best, from its first step on, as the board computed it. unknown: why the steps
    behind them are not, "" when there are none."""

    params: ControlParams
    raw: RawCounts
    setpoint: Setpoints
    unknown: str


def known_steps(path: Path) -> KnownSteps:
    """Raises UsageError for a log without inputs from the first step on, for gains that changed, and for steps that are
    not those of the counts."""
    recorded = log_replay.chosen(log_replay.runs_of(log_replay.open_log(path)), None)
    run, params = recorded.run, recorded.used.params
    if recorded.changes:
        raise UsageError(f"{path}: gains changed within the run: record a flight with the same gains from its start on")
    if not recorded.known:
        raise UsageError(f"{path} does not have the inputs of a run from its first step on: record with --run live")
    steps, inputs = run.first_steps(recorded.known).together, declarations.system(params.system).inputs
    raw, setpoint = steps.raw[:, :inputs], steps.setpoint
    digests, own = steps.digest, run_fixed.run_control(params, raw, setpoint).digests()
    if np.any((digests != own) & steps.digest_known):
        raise UsageError(f"{path}: the board's steps are not those of its counts: `plumb replay` says from where on")
    return KnownSteps(
        params, raw, setpoint, f"{recorded.known} steps are known: {recorded.unknown}" * bool(recorded.unknown)
    )


def of_log(path: Path, axis: str | None) -> FlownRun:
    """The loop of the board in a log, in the run that is known best. Raises UsageError for a log that determines too
    little."""
    known = known_steps(path)
    try:
        return flown(known.params, known.raw, known.setpoint, axis)
    except UsageError as error:
        if known.unknown:
            raise UsageError(f"{error}; of {path} {known.unknown}") from None
        raise


def _windows(
    params: ControlParams, tested: TestedLoop[Gains], raw: RawCounts, setpoint: Setpoints, samples: int
) -> Iterator[int]:
    """First steps of the windows in which the loop is closed all the time, hardly limited, and swung."""
    words = run_fixed.run_control(params, raw, setpoint)
    closed, limited = tested.closed(words), tested.limited(signals_of(params.system, words))
    asked_deg = tested.asked_deg(raw, setpoint)
    for begin in range(0, len(raw) - samples + 1, samples // OVERLAP):
        used = slice(begin, begin + samples)
        swung = float(np.std(asked_deg[used])) >= LEAST_ASKED_DEG
        if swung and closed[used].all() and float(np.mean(limited[used])) <= MOST_LIMITED:
            yield begin
