"""A vehicle on two wheels with its board on the native port, in simulated time: the plant on the board's own sensors
and motors, the frames of a rider's receiver, and a host that listens."""

from __future__ import annotations

from dataclasses import replace

from plumb.link.identity import NOT_READY, disarmed_text
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.systems.wheels import quantise, scenarios
from plumb.systems.wheels.plant import WheelsPlant
from support.native_board import UartBoard

PARAMS = quantise.quantise(scenarios.TUNINGS["steered"])
PINS_WHEELS = 3
STEP_S, FRAME_S, HOLD_S = 0.001, 0.01, 0.1
OFF, ON = crsf.sticks(), crsf.sticks(on=True)
COUNTS, SAID, LISTEN_EVERY = 9, 20, 5
"""Counts of a sample; times that the host listens before it is asked; and ms between two times while it holds."""


class Ridden:
    """A vehicle that a hand holds upright for its first 3 s. sends: the frame of the receiver; empty: silence. words:
    parameters of the link's part."""

    def __init__(self, name: str = "steps-off", words: dict[str, int] | None = None) -> None:
        scenario = scenarios.scenario(name, 1000)
        self.plant = WheelsPlant(replace(scenario, asked_mps=0.0 * scenario.asked_mps))
        self.board, self.sends, self._turn = UartBoard(), OFF, 0
        self.wires = self.board.wires
        self.wires.strap = PINS_WHEELS
        self.wires.receiver_byte_ns = round(1e10 / crsf.BAUD)
        self._sense()
        with Session.open(self.board) as session:
            link = {**PARAMS.link_words(), **scenarios.LINK, "period_us": 5000, "arm_hold_ms": round(1000 * HOLD_S)}
            session.upload(PARAMS.words(), **{**link, "receiver": 1, "calibrated": 1, **(words or {})})
            session.execute("SAVE")
        self.board.mcu.power_off()
        self.board.mcu.power_on()
        self.session = Session.open(self.board)
        self.session.connect()

    @property
    def time_s(self) -> float:
        return self._turn * STEP_S

    def _sense(self) -> None:
        self.board.sensors(self.plant.counts(self.time_s)[:COUNTS], self.wires.faults)

    def passes(self, seconds: float, *, listens: bool = False) -> None:
        """listens: the host answers keep-alives meanwhile, which takes time of the board alone."""
        for _ in range(round(seconds / STEP_S)):
            self._turn += 1
            if self._turn % round(FRAME_S / STEP_S) == 0:
                self.board.mcu.receiver_send(self.sends)
            left, right = (duty / 32768.0 for duty in self.wires.wheel_duty_q15)
            on = bool(self.wires.wheels_on)
            self.plant.drive_to(self.time_s, (left if on else None, right if on else None))
            self._sense()
            self.board.run_us(round(STEP_S * 1e6))
            if listens and self._turn % LISTEN_EVERY == 0:
                self.session.receive(STEP_S)

    def arms(self) -> None:
        """Held upright by a hand, then the switch."""
        self.passes(2.2)
        self.sends = ON
        self.passes(HOLD_S + 0.3)
        assert self.board.armed, self.missing

    @property
    def driven(self) -> bool:
        return bool(self.wires.wheels_on)

    def _listen(self) -> None:
        for _ in range(SAID):
            self.session.receive(STEP_S)

    @property
    def missing(self) -> str:
        self._listen()
        bits = self.session.telemetry["PLAUSIBILITY"]["missing"]
        return "; ".join(text for bit, text in NOT_READY.items() if bits >> bit & 1)

    @property
    def why_disarmed(self) -> str:
        self._listen()
        said = self.session.telemetry
        return disarmed_text(said["EVENTS"]["disarm_cause"], said["PLAUSIBILITY"], self.session.parameters.uploaded)
