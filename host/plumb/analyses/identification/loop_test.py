"""Swing the setpoint of a closed attitude loop, on a simulated plant or on a board, and keep what it did.

What is kept is the run's raw counts and setpoints: the integer model makes every signal of the board from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from plumb import systems
from plumb.analyses.identification.plant_fit import Excitation, Measurement
from plumb.analyses.identification.tested_loop import Gains, TestedLoop, TestedRun, loop_of
from plumb.boards import plant_on_pins
from plumb.boards.contract import Setpoints, SimulatedBoard, StepBoard
from plumb.boards.link import LinkBoard
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.errors import LinkError, UsageError
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.realtime import Capture
from plumb.link.retries import REPLY_TIMEOUT_S
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.proof.live_run import why_disarmed
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.signals import signals
from plumb.systems.contracts import PINS

if TYPE_CHECKING:
    from tqdm import tqdm

BOARD_SETTLE_S = 3.0
"""Before the test signal of a real machine begins."""
TILT_LIMIT_DEG = 45.0
"""A real machine that tilts further is disarmed."""
TILT = "tilt_deg"
READY_WAIT_S = 5.0
"""Longest wait for a machine that is not ready to be armed, the same as for the arm switch."""
STANDSTILL_S = 0.5
TOO_SLOW = (
    "the test is ended, disarmed; end other programs on this computer, and test a simulated board with "
    "--board virtual --live, which needs no real time"
)
"""Advice for a board whose steps come late: a simulated one on a busy computer, or a computer that reads late."""
MOST_LIMITED = 0.02
"""Share of steps at which a limit of the controller may act: the loop is no linear one then."""


@dataclass(frozen=True)
class LoopRun(TestedRun):
    """A test, from the beginning of the run; begin: the first step of the first whole period of the test signal."""

    def measurement(self) -> Measurement:
        """The whole periods of the test signal. Raises UsageError when a limit of the controller acted."""
        signals = self.signals()
        samples = len(self.excitation.setpoint_deg)
        periods = (len(self.raw) - self.begin) // samples
        used = slice(self.begin, self.begin + periods * samples)
        if float(np.mean(self.tested.limited(signals)[used])) > MOST_LIMITED:
            raise UsageError("the command reaches its limit in the test: give a smaller --amplitude")
        command, rate = self.tested.signals
        return Measurement(
            self.excitation,
            self.tested.asked_deg(self.raw, self.setpoint)[used].reshape(periods, samples),
            signals[command][used].reshape(periods, samples),
            signals[rate][used].reshape(periods, samples),
        )


def schedule(excited: Excitation, settle_s: float, periods: int) -> tuple[FloatArray, int]:
    """The setpoint of a test in every step, in deg, and the first step of its first whole period: one more comes
    before, in which the loop settles into the signal."""
    still = round(settle_s / excited.period_s)
    signal_deg = np.concatenate([np.zeros(still), np.tile(excited.setpoint_deg, periods + 1)])
    return signal_deg, still + len(excited.setpoint_deg)


def on_twin(
    board: StepBoard, params: ControlParams, excited: Excitation, periods: int, seed: int, axis: str | None = None
) -> LoopRun:
    """In lockstep with the system's plant on the host."""
    from tqdm import tqdm

    tested = loop_of(params, axis)
    asked, begin = schedule(excited, tested.settle_s, periods)
    inputs = declarations.system(params.system).inputs
    plant = tested.plant(seed, len(asked) * excited.period_s)
    raw, setpoint = np.zeros((len(asked), max(inputs, 6)), np.int16), np.zeros(len(asked), np.int32)
    truth_deg = np.zeros(len(asked))
    stepper = board.stepper(params)
    outputs: dict[str, int] = {}
    steps = tqdm(enumerate(asked.tolist()), total=len(asked), desc="test", unit="step", disable=None, leave=False)
    for step, asked_deg in steps:
        time_s = step * excited.period_s
        plant.follow(time_s, outputs)
        counts, setpoint[step] = tested.inputs(plant.counts(time_s), plant.setpoint(time_s), asked_deg)
        raw[step] = counts
        truth_deg[step] = tested.tilt_deg(plant.truth(time_s))
        outputs = stepper.step(tuple(raw[step].tolist()), int(setpoint[step])).outputs
    return LoopRun(params, tested, excited, raw, setpoint, begin, truth_deg)


def linked_loop(params: ControlParams) -> TestedLoop[Gains]:
    """The loop of a test in real time; raises UsageError for one that is tested in lockstep alone."""
    tested = loop_of(params)
    if not tested.on_link:
        raise UsageError(
            f"{params.system} is tested in lockstep, on its simulated plant: give --board native, or virtual without "
            "--live"
        )
    return tested


def attach_plant(board: LinkBoard, params: ControlParams, excited: Excitation, periods: int, seed: int) -> None:
    """Put the system's plant on the pins of the simulated chip, and give the board the parameters of the test."""
    assert isinstance(board, SimulatedBoard)
    system, tested = systems.load(params.system), linked_loop(params)
    asked, _ = schedule(excited, tested.settle_s, periods)
    seconds, period_us = len(asked) * excited.period_s, round(excited.period_s * 1e6)
    plant_on_pins.configure_as(board, params, period_us=period_us, arm_hold_ms=0, **system.LINK)
    systems.load(params.system, PINS).couple(board.machine, tested.plant(seed, seconds + 2.0))
    board.machine.advance_us(plant_on_pins.FOUND_US)


def on_link(board: LinkBoard, params: ControlParams, excited: Excitation, periods: int, settle_s: float) -> LoopRun:
    """Armed, in real time, on the board's own sensors: the machine moves. The board ends disarmed, whatever happens.

    Raises LinkError when the board disarms itself, tilts beyond TILT_LIMIT_DEG, falls silent, is slower than real time,
    loses counts, or disagrees with the integer model.
    """
    session, tested = board.session, linked_loop(params)
    frames = systems.load(params.system, PINS).FRAMES
    capture = Capture(session, raw_frames=set(RAW_FRAMES).intersection(frames))
    asked, begin = schedule(excited, settle_s, periods)
    setpoint = np.array([tested.inputs((), 0, one)[1] for one in asked.tolist()], np.int32)
    tilt = next((at, scale) for at, column, scale in signals(session.system) if column == TILT)
    bar = _progress(len(setpoint))
    try:
        session.begin("REALTIME_LIVE", frames=frames)
        session.listener = capture.feed
        session.arm(READY_WAIT_S)
        first = capture.steps
        _swing(capture, setpoint, first, excited.period_s, tilt, bar)
        session.disarm()
    finally:
        bar.close()
        session.listener = None
        session.end()
    steps = first + len(setpoint)
    if capture.unverified_from(steps) is not None:
        raise LinkError("samples were lost on the link in the test: its result is not valid; take a faster link")
    raw, used = (
        capture.raw_counts(steps)[:, : declarations.system(params.system).inputs],
        capture.setpoints.of_steps(steps),
    )
    if np.any(run_fixed.run_control(params, raw, used).digests() != capture.digests(steps)):
        raise LinkError("the board's steps differ from the integer model: run `plumb golden check` on it first")
    return LoopRun(params, tested, excited, raw, used, first + begin, np.empty(0))


def _progress(steps: int) -> tqdm[NoReturn]:
    """Made before the board is armed: what is slow the first time may outlast a keep-alive value."""
    from tqdm import tqdm

    return tqdm(total=steps, desc="test", unit="step", disable=None, leave=False)


def _swing(
    capture: Capture,
    setpoint: Setpoints,
    first: int,
    period_s: float,
    tilt: tuple[tuple[str, str], float],
    bar: tqdm[NoReturn],
) -> None:
    """Send the setpoints of the steps from `first` on, as the steps come. tilt: (frame, signal) and its scale."""
    session, asked = capture.session, 0
    place, scale = tilt
    received, step = first, session.listening.timeout(STANDSTILL_S)
    watch = RealTimeWatch("the board", TOO_SLOW, _end_the_test, session.clock)
    while (at := capture.steps - first) < len(setpoint):
        if asked != setpoint[at]:
            asked = int(setpoint[at])
            try:
                capture.set_setpoint(asked)
            except LinkError:
                if not session.holding.over:
                    raise
        session.receive(REPLY_TIMEOUT_S)
        if session.holding.over:
            raise LinkError(f"the board is disarmed after step {capture.steps}: {_why_over(session)}")
        tilts = capture.values.get(place, {})
        if tilts and abs(tilts[max(tilts)] * scale) > TILT_LIMIT_DEG:
            raise LinkError(f"the machine tilted beyond {TILT_LIMIT_DEG:g} deg: the test is ended, disarmed")
        if capture.steps > received:
            bar.update(capture.steps - received)
            received = capture.steps
            step.renew()
        elif step.over:
            raise LinkError(f"the board takes no steps after step {capture.steps}")
        watch.note((capture.steps - first) * period_s, session.clock())


def _why_over(session: Session) -> str:
    """Why the arming is over: another host, else what the board says."""
    return session.holding.over if session.holding.another else why_disarmed(session)


def _end_the_test(sentence: str) -> None:
    raise LinkError(sentence)
