"""A vehicle that flies, on the native port in simulated time, with the frames of a pilot's receiver and a host."""

from __future__ import annotations

from collections.abc import Callable

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.link.identity import NOT_READY, disarmed_text
from plumb.link.session import Session
from plumb.spec import crsf
from support.native_board import UartBoard
from support.noise import with_noise

SYSTEM = systems.load("quadrotor")
PARAMS = quantise(SYSTEM.TUNINGS["hummingbird"])
PINS_QUADROTOR = 2
ONE_G = 2048
LEVEL = (0, 0, 0, 0, 0, ONE_G)
PERIOD_S, HOLD_S = 0.0025, 0.5
NEUTRAL_HALFUS = 2000
FRAME_S = 0.01
OFF, ON = crsf.sticks(), crsf.sticks(on=True)


class Field:
    """A vehicle with its board switched on, a pilot whose receiver sends a frame every frame_s, and a host that
    listens. sends: the pilot's frame; empty: silence."""

    def __init__(self, sends: bytes = OFF, **words: int) -> None:
        self.board, self.feels, self.sends, self._number = UartBoard(), LEVEL, sends, 0
        self.frame_s = FRAME_S
        self.transmit: Callable[[bytes], object] = self.board.mcu.receiver_send
        self.board.wires.strap = PINS_QUADROTOR
        self.board.wires.receiver_byte_ns = round(1e10 / crsf.BAUD)
        self.board.sensors(LEVEL)
        with Session.open(self.board) as session:
            link = {**PARAMS.link_words(), **SYSTEM.LINK, "period_us": 2500, "arm_hold_ms": round(1000 * HOLD_S)}
            session.upload(PARAMS.words(), **{**link, "receiver": 1, "calibrated": 1, **words})
            session.execute("SAVE")
        self.board.mcu.power_off()
        self.board.mcu.power_on()
        self.session = Session.open(self.board)
        self.session.connect()
        self.listens = True

    def leaves(self) -> None:
        """The host goes."""
        self.session.close()
        self.listens = False

    def passes(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            if self._number % round(self.frame_s / PERIOD_S) == 0:
                self.transmit(self.sends)
            self._number += 1
            self.board.sensors(with_noise(self.feels, self._number, 6), self.board.wires.faults)
            if self.listens:
                self.session.receive(PERIOD_S)
            else:
                self.board.run_us(round(PERIOD_S * 1e6))

    def pilot(self, sends: bytes, seconds: float) -> None:
        self.sends = sends
        self.passes(seconds)

    def arms(self) -> None:
        """Stands for long enough, then the switch."""
        self.passes(4.0)
        self.pilot(ON, HOLD_S + 0.2)
        assert self.board.armed

    @property
    def pulses(self) -> list[int]:
        return list(self.board.wires.pulse_halfus)

    @property
    def missing(self) -> str:
        bits = self.session.telemetry["PLAUSIBILITY"]["missing"]
        return "; ".join(text for bit, text in NOT_READY.items() if bits >> bit & 1)

    @property
    def why_disarmed(self) -> str:
        said = self.session.telemetry
        return disarmed_text(said["EVENTS"]["disarm_cause"], said["PLAUSIBILITY"], self.session.parameters.uploaded)


def turns(pulses: list[int]) -> bool:
    return all(pulse > NEUTRAL_HALFUS + 20 for pulse in pulses)
