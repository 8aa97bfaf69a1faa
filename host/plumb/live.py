"""A live run on the virtual board: the plant drives volts into the ADC pins and follows the PWM pins, the board samples
by its own timer, is armed over its link, and streams raw counts and digests.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb import metrics
from plumb.boards import Answer
from plumb.boards.virtual import VirtualBoard
from plumb.capture import Capture
from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.f103.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.quantise import ControlParams
from plumb.sensors import adc_counts
from plumb.session import REPLY_TIMEOUT_S
from plumb.systems.quad import ESC_PERIOD_US, Scenario
from plumb.systems.quad_plant import QuadPlant
from plumb.trial import Flight, Trial, judge

ADC_PINS = ("PA0", "PA1", "PA2")
"""Gyro, y, z."""
ESC_PINS = ("PB6", "PB7")
FOLLOW_US = 1000
"""How often the plant looks at the PWM pins."""


class Coupling:
    """Joins a plant to a machine's pins; the plant's time 0 is the first conversion of the gyro channel.

    taken: one row a conversion of the gyro channel: its count, the true tilt and the true bias at that moment.
    """

    def __init__(self, machine: Machine, plant: QuadPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[tuple[int, float, float]] = []
        self._start: int | None = None
        machine.adc[ADC_PINS[0]] = self._gyro_volts
        for index in (1, 2):
            machine.adc[ADC_PINS[index]] = self._accel_volts(index)
        self._follow(machine.now)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else now_s - self._start / TICKS_PER_S

    def _gyro_volts(self, now_s: float) -> float:
        if self._start is None:
            self._start = round(now_s * TICKS_PER_S)
        time_s, plant = self._time_s(now_s), self.plant
        self._advance(time_s)
        volts = plant.volts(time_s)[0]
        self.taken.append((int(adc_counts(np.array(volts))), plant.tilt_deg, plant.bias_dps(time_s)))
        return volts

    def _accel_volts(self, index: int) -> Callable[[float], float]:
        return lambda now_s: self.plant.volts(self._time_s(now_s))[index]

    def _advance(self, time_s: float) -> None:
        pulses = [self.machine.pwm(pin) for pin in ESC_PINS]
        self.plant.advance_to(time_s, [pulse.pulse_us if pulse.enabled else 0.0 for pulse in pulses])

    def _follow(self, now: int) -> None:
        self._advance(self._time_s(now / TICKS_PER_S))
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)


def coupler(scenario: Scenario) -> Callable[[Machine], None]:
    """What `serve` calls to put a plant on the pins of the machine it serves."""

    def couple(machine: Machine) -> None:
        Coupling(machine, QuadPlant(scenario))

    return couple


def fly(board: VirtualBoard, scenario: Scenario, params: ControlParams, *, open_loop: bool = False) -> Trial:
    """Arm, run the scenario in real time on live sensors, disarm, and judge what was streamed.

    Raises LinkError when the board disarms itself or falls silent on the way.
    """
    from tqdm import tqdm

    session, steps = board.session, scenario.steps
    # The plant's speed controllers need no arming pulse, and its motion does not wait for one.
    session.upload(params.words(), period_us=scenario.period_us, esc_period_us=ESC_PERIOD_US, arm_hold_ms=0)
    capture = Capture(session)
    session.begin("REALTIME_LIVE", frames=("RAW_A", "ANGLE", "BIAS"))
    session.listener = capture.feed
    coupling = Coupling(board.machine, QuadPlant(scenario, open_loop=open_loop))
    session.arm()
    with tqdm(total=steps, desc="live on the virtual board", unit="step", leave=False, disable=None) as bar:
        while capture.steps < steps:
            if not session.receive(REPLY_TIMEOUT_S):
                raise LinkError(f"the board fell silent after step {capture.steps}")
            if capture.disarmed_step is not None:
                raise LinkError(f"the board disarmed itself before step {capture.disarmed_step}: run again")
            bar.update(min(capture.steps, steps) - bar.n)
    session.end()
    session.listener = None
    raw = capture.raw_counts(steps)
    first = matching(np.array([count for count, _, _ in coupling.taken]), raw[:, 0])
    truth = np.array([row[1:] for row in coupling.taken[first : first + steps]])
    flight = Flight(
        scenario.time_s, truth[:, 0], truth[:, 1], raw, capture.setpoints(steps), metrics.scored(scenario.time_s)
    )
    answer = Answer(capture.digests(steps), unverified_from=capture.unverified_from(steps))
    return judge(board, flight, params, answer)


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
