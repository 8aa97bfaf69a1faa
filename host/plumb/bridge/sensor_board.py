"""Simulated sensor board: a plant in real time that sends its samples as frames and is driven by the STM32's outputs.

Sample k is sent k periods after the first. If this process is late by more than a period, the missed periods are
counted and skipped. The actuator's words arrive in the frames of each step; they drive the plant only while the last
STEP says that the board is armed, as the pins would.

A board can only be armed at rest, and every scenario that moves begins with a few seconds at rest. With rest_s the
plant repeats them until the board is armed; then the scenario continues. If the plant is not driven for RESET_AFTER_S
after that, it is reset to the beginning, as a person would put a fallen vehicle upright, so that the board can be armed
again.

Where the board under test has a radio receiver, the setpoint and the commands of the scenario go to it as frames of
CRSF, and none goes to the bus.

A setpoint that is not 0 is repeated, because the STM32 treats a silent source as lost. It carries the tag of the run
from TIME; a bridge replaces it with its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import can

from plumb.contract.scenario import Plant
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.said_setpoint import SaidSetpoint
from plumb.link.sample_codec import InputLayout, sample_frames
from plumb.spec import crsf
from plumb.spec.protocol import check, protocol

STEP_TIMEOUT_S = 0.1
"""Without a STEP for this long, the actuators count as neutral."""
RESET_AFTER_S = 3.0
"""Time without drive after which the plant is reset. Longer than a bridge needs to reconnect, so that a short gap does
not reset it."""
HELLO_EVERY_S = 1.0
"""Interval of HELLO frames on a CAN bus while no board sends: HELLO opens the board's link, which times out."""


class SensorBoard:
    """The plant of one scenario on one bus. sent: samples sent; late: periods skipped; armed: from the last STEP."""

    def __init__(
        self,
        bus: can.BusABC,
        plant: Callable[[], Plant],
        period_us: int,
        outputs: Mapping[str, tuple[str, str]],
        clock: Callable[[], float] = time.monotonic,
        *,
        greet: bool = False,
        rest_s: float = 0.0,
        layout: InputLayout | None = None,
        sticks: Callable[[bytes], object] | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        """plant: creates the plant at the beginning of the scenario. outputs: word of the record -> (frame, signal)
        that carries it. greet: send HELLO while no board sends, as a node on the board's CAN bus must. rest_s:
        length of the rest at the beginning of the scenario, repeated until the board is armed; 0 runs the scenario
        at once. layout: inputs of the system; None: six counts. sticks: the line to the board's receiver. say:
        called with a sentence when the samples fall behind real time, and when they keep up again."""
        self.bus, self.plant, self.period_s = bus, plant(), period_us * 1e-6
        self._new_plant = plant
        self.sent = self.late = 0
        self.armed = False
        self._protocol, self._clock = protocol(), clock
        self._outputs = [(self._protocol[frame].identifier, signal, word) for word, (frame, signal) in outputs.items()]
        self._values: dict[str, int] = {}
        self._setpoint = self._run_tag = 0
        self._layout = layout or InputLayout()
        self._sticks, self._pilot = sticks, crsf.Pilot()
        self._said = SaidSetpoint(self._protocol)
        self._said.begin(self._layout.neutral)
        self._step_s = self._received_s = self._greeted_s = float("-inf")
        self._driven_s: float | None = None
        self._greet = greet
        self._watch = RealTimeWatch("the sensor board", "this machine is too slow or too busy for it", say, clock)
        self._rest_steps, self._waited_steps = round(rest_s / self.period_s), 0
        self._from_board = {m.identifier for m in self._protocol.messages.values() if m.sender == "BOARD"}

    def run(self, stopped: Callable[[], bool], seconds: float | None = None) -> None:
        """Send samples until stopped() is true or `seconds` have passed."""
        start_s = self._clock()
        while not stopped() and (seconds is None or self.sent * self.period_s < seconds - 1e-9):
            due_s = start_s + self.sent * self.period_s
            while (remaining := due_s - self._clock()) > 0 and not stopped():
                self._handle(self.bus.recv(min(remaining, 0.2)))
            behind = int((self._clock() - due_s) / self.period_s)
            self.late += behind
            start_s += behind * self.period_s
            self.emit()
            self._watch.note(self.sent, self.sent + self.late)

    def emit(self) -> None:
        """Advance the plant by one period, send the next sample, and handle received frames."""
        driven = self.armed and self._clock() - self._step_s < STEP_TIMEOUT_S
        if driven:
            self._driven_s = self._clock()
        elif self._rest_steps and self._driven_s is not None and self._clock() - self._driven_s > RESET_AFTER_S:
            self.plant, self._waited_steps, self._driven_s = self._new_plant(), self.sent, None
        elif self._driven_s is None and self._rest_steps and self.sent - self._waited_steps >= self._rest_steps:
            self._waited_steps += self._rest_steps
        time_s = (self.sent - self._waited_steps) * self.period_s
        self.plant.follow(time_s, self._values if driven else {})
        counts, setpoint, now_s = self.plant.counts(time_s), self.plant.setpoint(time_s), self._clock()
        if self._greet and min(now_s - self._received_s, now_s - self._greeted_s) > HELLO_EVERY_S:
            self._greeted_s = now_s
            hello = self._protocol["HELLO"]
            self._send(hello.identifier, hello.pack(0, 0, self._protocol.version, self._protocol.dbc_hash))
        if self._sticks is not None:
            self._sticks(self._pilot.frames(setpoint, counts[self._layout.counts :]))
        elif setpoint != self._setpoint:
            self._setpoint = setpoint
            self._said.say(setpoint, repeats=True)
        if self._said.due(now_s, armed=True):
            setpoint_message, number = self._protocol["SETPOINT"], self._said.next_step
            for frame in self._said.set_frames(self._run_tag):
                self._send(*frame)
            self._send(
                setpoint_message.identifier,
                setpoint_message.pack(self.sent & 15, self._run_tag, number, self._said.value),
            )
            self._said.sent(now_s)
        for frame in sample_frames(self._protocol, self.sent, counts[: self._layout.counts], layout=self._layout):
            self._send(*frame)
        self.sent += 1
        while (message := self.bus.recv(0)) is not None:
            self._handle(message)

    def _send(self, identifier: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    def _handle(self, message: can.Message | None) -> None:
        if message is None or message.is_extended_id or not check(message.arbitration_id, bytes(message.data)):
            return
        identifier, data = message.arbitration_id, bytes(message.data)
        if identifier in self._from_board:
            self._received_s = self._clock()
        if identifier == self._protocol["TIME"].identifier:
            tag = self._protocol["TIME"].decode(data)["run_tag"]
            if tag != self._run_tag:
                self._run_tag, self._setpoint = tag, 0  # a new run begins with setpoint 0: send it again
                self._said.begin(self._layout.neutral)
        self._said.follow([(identifier, data)])
        if identifier == self._protocol["STEP"].identifier:
            self.armed, self._step_s = bool(data[1] >> 4 & 1), self._clock()
        for carrier, signal, word in self._outputs:
            if carrier == identifier:
                self._values[word] = self._protocol.by_identifier[identifier].decode(data)[signal]
