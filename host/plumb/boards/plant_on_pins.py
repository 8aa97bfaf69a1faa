"""A live run on the virtual board: the plant drives the sensors' pins and follows the actuators', the board samples by
its own timer, is armed over its link, is told the setpoints as they change, and streams raw counts and digests.

How a system's plant is joined to a machine its part `live` says:

    Coupling(machine, plant)    the plant's time 0 is the first sample of a step that the board takes; it has
        taken                   one row a sample: the first raw count, and the truth at that moment
    FRAMES                      what a step sends: the raw counts that the system uses, and what a viewer wants
    SCENARIO                    what a served board's plant does unless told otherwise
    SHOWN, TUNING               what a plant that is only looked at does; the tuning for the board's own sensors
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb import systems
from plumb.boards import Answer
from plumb.boards.virtual import VirtualBoard
from plumb.errors import LinkError
from plumb.f103 import START_US
from plumb.f103.attached.strap import BY_PIN_SET, set_strap
from plumb.f103.machine import Machine
from plumb.link.identity import FAULT_STRAP, disarmed_text
from plumb.link.realtime import Capture
from plumb.link.session import REPLY_TIMEOUT_S, Session
from plumb.proof.runs import Flight, Scenario, Trial, columns, judge
from plumb.tuning.quantise import ControlParams, quantise

FOUND_US = 50_000
"""Digital sensors that were just connected are found within this time."""
STANDSTILL_US = 500_000
"""Without a step for so long, the run is over: a sensor gives no samples any more."""


def coupler(system: str, scenario: Scenario) -> Callable[[Machine], None]:
    """What `serve` calls to put a plant on the pins of the machine it serves."""
    live = systems.load(system, "live")

    def couple(machine: Machine) -> None:
        live.Coupling(machine, systems.load(system).plant(scenario))

    return couple


def become(board: VirtualBoard, params: ControlParams, **link: int) -> Session:
    """Make the board this system; link: words of the link's part of the parameters. Strap and pins are read at the
    start alone, so that for others it is rewired and started again, with what it then has saved."""
    session = board.session
    pins = link.get("pins", 0)
    session.upload(params.words(), **{**params.link_words(), **link, "pins": pins})
    if session.require_match()["PINS"] != pins or session.require_match()["FAULTS"] >> FAULT_STRAP & 1:
        set_strap(board.machine, BY_PIN_SET[pins])
        session.execute_idle("SAVE")
        session = board.restart()
    return session


def show(board: VirtualBoard, name: str, scenario: str | None, seed: int) -> None:
    """Make the board this system, and put a plant on its pins that moves as the scenario says, whatever comes back."""
    system, live = systems.load(name), systems.load(name, "live")
    chosen = system.scenario(scenario or live.SHOWN, seed)
    plant = system.plant(chosen, open_loop=True)
    become(board, quantise(system.TUNINGS[live.TUNING]), period_us=chosen.period_us, **system.LINK)
    live.Coupling(board.machine, plant)
    board.machine.advance_us(FOUND_US)


def comes_up_as(machine: Machine, name: str, strap: str | None = None) -> None:
    """Make a machine that was just started a system for its own sensors, as `plumb params tuning SYSTEM --save` and a
    reset do, with its strap wired for the system: tuning, period and pin set come out of its flash from then on."""
    system, live = systems.load(name), systems.load(name, "live")
    with Session.open(machine.uart) as session:
        params = quantise(system.TUNINGS[live.TUNING])
        session.upload(params.words(), **params.link_words(), period_us=system.PERIOD_US, **system.LINK)
        session.execute_idle("SAVE")
    set_strap(machine, strap or BY_PIN_SET[system.LINK.get("pins", 0)])
    machine.reset()
    machine.advance_us(START_US)


def fly(board: VirtualBoard, scenario: Scenario, params: ControlParams, *, open_loop: bool = False) -> Trial:
    """Arm, run the scenario in real time on live sensors, disarm, and judge what was streamed.

    Raises LinkError when the board disarms itself or falls silent on the way.
    """
    from tqdm import tqdm

    steps = scenario.steps
    system, live = systems.load(params.system), systems.load(params.system, "live")
    # The plant's actuators need no arming pulse, and its motion does not wait for one.
    session = become(board, params, period_us=scenario.period_us, arm_hold_ms=0, **system.LINK)
    coupling = live.Coupling(board.machine, system.plant(scenario, open_loop=open_loop))
    board.machine.advance_us(FOUND_US)
    capture = Capture(session)
    session.begin("REALTIME_LIVE", frames=live.FRAMES)
    session.listener = capture.feed
    if system.OUTPUT_FRAMES:
        session.arm()
    wanted, asked = scenario.setpoint(), 0
    with tqdm(total=steps, desc="live on the virtual board", unit="step", leave=False, disable=None) as bar:
        heard, heard_us = 0, board.machine.now_us
        while capture.steps < steps:
            if asked != wanted[capture.steps]:
                asked = int(wanted[capture.steps])
                capture.set_setpoint(asked)
            if not session.receive(REPLY_TIMEOUT_S):
                raise LinkError(f"the board fell silent after step {capture.steps}")
            if capture.disarmed_step is not None:
                raise LinkError(f"the board disarmed itself before step {capture.disarmed_step}: {_why(session)}")
            if capture.steps > heard:
                bar.update(capture.steps - heard)
                heard, heard_us = capture.steps, board.machine.now_us
            elif board.machine.now_us - heard_us > STANDSTILL_US:
                raise LinkError(f"the board takes no samples after step {capture.steps}: a sensor or the link failed")
    session.end()
    session.listener = None
    raw = capture.raw_counts(steps)
    first = matching(np.array([count for count, _ in coupling.taken]), raw[:, 0])
    truth = columns([row for _, row in coupling.taken[first : first + steps]])
    flight = Flight(scenario.time_s, truth, raw, capture.setpoints(steps), scenario.scored)
    answer = Answer(capture.digests(steps), unverified_from=capture.unverified_from(steps))
    return judge(board, flight, params, answer)


def _why(session: Session) -> str:
    """What ended the armed time, as soon as the board says it."""
    session.telemetry.pop("EVENTS", None)
    session.telemetry.pop("PLAUSIBILITY", None)
    end_s = session.clock() + REPLY_TIMEOUT_S
    while not {"EVENTS", "PLAUSIBILITY"} <= set(session.telemetry) and session.clock() < end_s:
        session.receive(REPLY_TIMEOUT_S / 5)
    said = session.telemetry
    return disarmed_text(said.get("EVENTS", {}).get("disarm_cause", 0), said.get("PLAUSIBILITY", {}))


def matching(
    taken: np.ndarray[tuple[int], np.dtype[np.int64]], streamed: np.ndarray[tuple[int], np.dtype[np.int16]]
) -> int:
    """Index of the conversion that became the first step: some may have gone before the run began.

    The one from which on the most counts agree, so that a count lost on the link does not matter.
    """
    spare = len(taken) - len(streamed)
    if spare < 0:
        raise LinkError(f"the board streamed {len(streamed)} steps of {len(taken)} conversions")
    agree = [int(np.count_nonzero(taken[at : at + len(streamed)] == streamed)) for at in range(spare + 1)]
    return int(np.argmax(agree))
