"""A live run on the virtual board: the board samples its own sensors by its own timer. The host arms it, and compares
the streamed raw counts and digests with the model. The plant's pilot sends his sticks to the board's receiver; where
the plant has none, the host sends each change of the setpoint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plumb import systems
from plumb.boards.contract import Answer, RawCounts, SimulatedBoard
from plumb.boards.plant_on_pins import FOUND_US, PilotOnLine, configure_as, sampling_began_s
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.contract.scenario import Scenario, calibrated_words, link_words
from plumb.errors import LinkError
from plumb.link.identity import disarmed_text
from plumb.link.realtime import Capture
from plumb.link.retries import REPLY_TIMEOUT_S
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.proof.gain_changes import GainChange, GainChanges, changes_of
from plumb.proof.runs import Run, RunInputs, columns, judge
from plumb.spec import crsf, declarations
from plumb.spec.system import RECEIVER
from plumb.systems.contracts import PINS, Conversion

STANDSTILL_US = 500_000
"""Without a step for this long the run ends with an error: a sensor or the link has failed."""


def run_live(
    board: SimulatedBoard,
    scenario: Scenario,
    params: ControlParams,
    *,
    open_loop: bool = False,
    gains: Sequence[GainChange] = (),
) -> Run:
    """Arm, run the scenario in real time on the board's own sensors, disarm, and compare the streamed steps with the
    model. gains: changes during the run, while the board is armed; the model follows them.

    Raises UsageError when the board refuses a change, LinkError when it disarms itself or falls silent during the
    run.
    """
    from tqdm import tqdm

    steps = scenario.steps
    system, live = systems.load(params.system), systems.load(params.system, PINS)
    declared = declarations.system(params.system)
    prescribed = run_fixed.check_inputs(params.system, scenario.counts(), scenario.setpoint())
    commands = prescribed[0][:, declared.counts :]
    piloted = RECEIVER in declared.parts and bool(commands[:, crsf.NUMBER_AT].any())
    # No hold at neutral: the plant's actuators need no arming pulse, and its motion begins at once.
    words = link_words(system, scenario)
    if piloted:
        words |= {"receiver": crsf.IN_USE, **calibrated_words(params.system)}
    session = configure_as(board, params, period_us=scenario.period_us, arm_hold_ms=0, **words)
    plant = system.plant(scenario, open_loop=open_loop)
    coupling = live.couple(board.machine, plant)
    pilot = PilotOnLine(board.machine, plant, coupling, params.system, scenario.period_us) if piloted else None
    board.machine.advance_us(FOUND_US)
    changing = GainChanges(session, gains, params.period_s, steps)
    capture = Capture(session, raw_frames=set(RAW_FRAMES).intersection(live.FRAMES))
    session.begin("REALTIME_LIVE", frames=live.FRAMES)
    session.listener = capture.feed
    if system.OUTPUT_FRAMES:
        session.arm()
    if pilot is not None:
        pilot.armed = True
    wanted = list(zip(prescribed[1].tolist(), map(tuple, commands.tolist()), strict=True))
    asked = 0, declared.default_commands()
    with tqdm(total=steps, desc="live on the virtual board", unit="step", leave=False, disable=None) as bar:
        steps_seen, seen_us = 0, board.machine.now_us
        while capture.steps < steps:
            if not piloted and asked != wanted[capture.steps]:
                asked = wanted[capture.steps]
                capture.set_setpoint(*asked)
            changing.commit(capture.steps)
            if not session.receive(REPLY_TIMEOUT_S):
                raise LinkError(f"the board fell silent after step {capture.steps}")
            if capture.disarmed_step is not None:
                raise LinkError(
                    f"the board disarmed itself before step {capture.disarmed_step}: {why_disarmed(session)}"
                )
            if capture.steps > steps_seen:
                bar.update(capture.steps - steps_seen)
                steps_seen, seen_us = capture.steps, board.machine.now_us
            elif board.machine.now_us - seen_us > STANDSTILL_US:
                raise LinkError(f"the board takes no samples after step {capture.steps}: a sensor or the link failed")
    begun_s = sampling_began_s(board.machine)
    session.end()
    session.listener = None
    raw = capture.raw_counts(steps)[:, : declared.inputs]
    truth = columns([conversion.truth for conversion in conversions_of(coupling.taken, begun_s, raw)])
    inputs = RunInputs(scenario.time_s, truth, raw, capture.setpoints.of_steps(steps), scenario.scored)
    changes, unknown = changes_of(capture, params, steps)
    return judge(board, inputs, params, received(capture, steps, unknown), changes)


def received(capture: Capture, steps: int, unknown: int | None) -> Answer:
    """The answer of a board of which frames may be lost. unknown: first step whose parameters are not known. A step
    whose digest is lost is not compared; from a step on whose inputs are not known, none is."""
    first = min((step for step in (capture.first_doubt(steps), unknown) if step is not None), default=None)
    known = min((step for step in (capture.inputs_until(steps), unknown) if step is not None), default=steps)
    arrived = np.array([step in capture.digest for step in range(steps)], np.bool_)
    return Answer(capture.digests(steps), None, first, compared=arrived & (np.arange(steps) < known))


def why_disarmed(session: Session) -> str:
    """The board's cause of disarming; waits for the status that reports it."""
    session.telemetry.pop("EVENTS", None)
    session.telemetry.pop("PLAUSIBILITY", None)
    said_why = session.listening.timeout(REPLY_TIMEOUT_S)
    while not {"EVENTS", "PLAUSIBILITY"} <= set(session.telemetry) and not said_why.over:
        session.receive(REPLY_TIMEOUT_S / 5)
    said = session.telemetry
    cause = said.get("EVENTS", {}).get("disarm_cause", 0)
    system = session.parameters.uploaded
    return disarmed_text(cause, said.get("PLAUSIBILITY", {}), system, session.listening.unread_text)


def conversions_of(taken: Sequence[Conversion], begun_s: float, raw: RawCounts) -> list[Conversion]:
    """The conversions behind the steps of a run, in order: those since the board's sampling timer was started.

    begun_s: the time of that start. raw: the streamed counts, (steps, 6); all zero for a step whose counts were lost.
    Raises LinkError when a step has no conversion, or streamed another count than its conversion.
    """
    rows = [conversion for conversion in taken if conversion.time_s > begun_s]
    if len(rows) < len(raw):
        raise LinkError(f"the board streamed {len(raw)} steps of {len(rows)} conversions")
    for step, (conversion, counts) in enumerate(zip(rows, raw.tolist(), strict=False)):
        if any(counts) and counts[0] != conversion.raw_count:
            raise LinkError(
                f"step {step} is not the conversion of its turn: the board streamed {counts[0]}, its sensor gave "
                f"{conversion.raw_count}; a sample was missed"
            )
    return rows[: len(raw)]
