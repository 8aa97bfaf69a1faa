"""The simulated sensor board: a plant in real time, whose samples go out as frames, as a second board on the bus sends
them, and which feels what the STM32 answers.

Sample k goes out k periods after the first; when this process is late by more than a period the time is given up, and
counted. The actuator's words come back in the frames of the step; they move the plant only while the last STEP says
that the board is armed, because only then would the pins.

A board can only be armed at rest, and every scenario that moves something begins with a few seconds of it. With rest_s
the plant stays in them, however long it takes until the board is armed; then the scenario goes on. A plant that has not
been driven for SET_BACK_AFTER_S after that is set back to the beginning, as a person does with a vehicle that fell: the
board can be armed again.

A setpoint that is not 0 is repeated, because the STM32 takes a silent source for a lost one. It carries the tag of the
run that TIME names; a bridge puts its own in.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import can

from plumb.link.lockstep import sample_frames
from plumb.link.session import SETPOINT_EVERY_S
from plumb.spec.protocol import check, protocol
from plumb.systems.contracts import Plant

HEARD_FOR_S = 0.1
"""Without a STEP for so long the actuators are taken to be at neutral."""
SET_BACK_AFTER_S = 3.0
"""Longer than a bridge needs to find a board that it lost, so that a short gap changes nothing."""
HELLO_EVERY_S = 1.0
"""Pause between greetings while no board is heard on a CAN bus: its link opens with a greeting, and times out."""


class SensorBoard:
    """One scenario's plant at one bus. sent: samples so far; late: periods given up; armed: as the last STEP said."""

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
    ) -> None:
        """plant: makes one at the beginning of the scenario. outputs: word of the record -> frame and signal that carry
        it. greet: say HELLO while no board is heard, as a node on the board's own CAN bus has to. rest_s: the first
        seconds of the scenario are at rest, and are repeated until the board is armed; 0: the scenario runs from the
        start."""
        self.bus, self.plant, self.period_s = bus, plant(), period_us * 1e-6
        self._new_plant = plant
        self.sent = self.late = 0
        self.armed = False
        self._protocol, self._clock = protocol(), clock
        self._outputs = [(self._protocol[frame].identifier, signal, word) for word, (frame, signal) in outputs.items()]
        self._values: dict[str, int] = {}
        self._setpoint = self._run_tag = 0
        self._setpoint_s = self._step_s = self._heard_s = self._greeted_s = float("-inf")
        self._driven_s: float | None = None
        self._greet = greet
        self._rest_steps, self._waited_steps = round(rest_s / self.period_s), 0
        self._from_board = {m.identifier for m in self._protocol.messages.values() if m.sender == "BOARD"}

    def run(self, stopped: Callable[[], bool], seconds: float | None = None) -> None:
        """Emit until stopped() holds or the seconds are over."""
        start_s = self._clock()
        while not stopped() and (seconds is None or self.sent * self.period_s < seconds - 1e-9):
            due_s = start_s + self.sent * self.period_s
            while (remaining := due_s - self._clock()) > 0 and not stopped():
                self._take(self.bus.recv(min(remaining, 0.2)))
            behind = int((self._clock() - due_s) / self.period_s)
            self.late += behind
            start_s += behind * self.period_s
            self.emit()

    def emit(self) -> None:
        """The next sample."""
        driven = self.armed and self._clock() - self._step_s < HEARD_FOR_S
        if driven:
            self._driven_s = self._clock()
        elif self._rest_steps and self._driven_s is not None and self._clock() - self._driven_s > SET_BACK_AFTER_S:
            self.plant, self._waited_steps, self._driven_s = self._new_plant(), self.sent, None
        elif self._driven_s is None and self._rest_steps and self.sent - self._waited_steps >= self._rest_steps:
            self._waited_steps += self._rest_steps
        time_s = (self.sent - self._waited_steps) * self.period_s
        self.plant.follow(time_s, self._values if driven else {})
        counts, setpoint, now_s = self.plant.counts(time_s), self.plant.setpoint(time_s), self._clock()
        if self._greet and min(now_s - self._heard_s, now_s - self._greeted_s) > HELLO_EVERY_S:
            self._greeted_s = now_s
            hello = self._protocol["HELLO"]
            self._send(hello.identifier, hello.pack(0, 0, self._protocol.version, self._protocol.dbc_hash))
        repeat = setpoint != 0 and now_s - self._setpoint_s >= SETPOINT_EVERY_S
        before = ~setpoint if repeat else self._setpoint
        for frame in sample_frames(self._protocol, self.sent, counts, setpoint, before, self._run_tag):
            self._send(*frame)
        self._setpoint_s = now_s if repeat or setpoint != self._setpoint else self._setpoint_s
        self._setpoint = setpoint
        self.sent += 1
        while (message := self.bus.recv(0)) is not None:
            self._take(message)

    def _send(self, identifier: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    def _take(self, message: can.Message | None) -> None:
        if message is None or message.is_extended_id or not check(message.arbitration_id, bytes(message.data)):
            return
        identifier, data = message.arbitration_id, bytes(message.data)
        if identifier in self._from_board:
            self._heard_s = self._clock()
        if identifier == self._protocol["TIME"].identifier:
            tag = self._protocol["TIME"].decode(data)["run_tag"]
            if tag != self._run_tag:
                self._run_tag, self._setpoint_s = tag, float("-inf")  # another run: it begins with a setpoint of 0
        if identifier == self._protocol["STEP"].identifier:
            self.armed, self._step_s = bool(data[1] >> 4 & 1), self._clock()
        for carrier, signal, word in self._outputs:
            if carrier == identifier:
                self._values[word] = self._protocol.by_identifier[identifier].decode(data)[signal]
