"""Send a board's telemetry as JSON in UDP datagrams, for PlotJuggler and other programs that plot a stream.

A datagram is one JSON object. `timestamp` is the time of the step in seconds of the board's clock; the other entry is
`board` (mode, arming, counters) or the name of the system, with its signals by column, units in the names:

    {"timestamp": 12.34, "SYSTEM": {"step": 617, "tilt_deg": -0.11, "rate_dps": 0.5}}
"""

from __future__ import annotations

import json

from plumb.errors import UsageError
from plumb.link.datagrams import Datagrams
from plumb.link.endpoint_names import quoted
from plumb.spec import declarations
from plumb.spec.protocol import Frame, protocol
from plumb.spec.signals import signals

LOOPBACK = "127.0.0.1"
BOARD = ("STATUS", "COUNTERS", "EVENTS", "CAN_HEALTH")
"""Messages whose words are sent as signals of `board`."""


def parse_target(text: str) -> tuple[str, int]:
    """[HOST:]PORT; without HOST this machine. Raises UsageError."""
    host, _, number = text.rpartition(":")
    if not (number.isascii() and number.isdigit() and len(number) <= 5 and 0 < int(number) <= 65535):
        raise UsageError(f"{quoted(text)} is no UDP port to send to; write PORT or HOST:PORT, up to 65535")
    return host or LOOPBACK, int(number)


class StepClock:
    """Time of a step on the board's clock, from the TIME messages: (step, microseconds), both wrapping.

    TIME comes up to one period after the step that it names, a different part of a period each time. The period is
    therefore measured from the beginning of the run, and the time of a step follows TIME slowly (SHARE of the
    difference): times of steps are even, and never go back.
    """

    SHARE = 0.1
    FIRST_STEPS = 10
    """Steps that the first measurement of the period takes; before that no step has a time."""

    def __init__(self) -> None:
        self._time_us = 0
        self._begin_us: int | None = None
        self._step = self._steps = 0
        self._period_us = self._anchor_us = 0.0

    def feed(self, step: int, time_us: int) -> None:
        self._time_us += time_us - self._time_us & 0xFFFFFFFF
        ahead = step - self._step & 0xFFFF
        self._step = step
        if self._begin_us is None or ahead >= 0x8000:  # the first TIME, or a new run
            self._begin_us, self._steps, self._period_us = self._time_us, 0, 0.0
            return
        self._steps += ahead
        predicted_us = self._anchor_us + ahead * self._period_us
        if self._steps < self.FIRST_STEPS:
            return
        known = self._period_us > 0
        self._period_us = (self._time_us - self._begin_us) / self._steps
        self._anchor_us = predicted_us + self.SHARE * (self._time_us - predicted_us) if known else self._time_us

    def now_s(self) -> float:
        """Time of the last TIME."""
        return self._time_us * 1e-6

    def time_s(self, step: int) -> float | None:
        """Time of a step near the last TIME; None at the beginning of a run."""
        if not self._period_us:
            return None
        ahead = (step - self._step + 0x8000 & 0xFFFF) - 0x8000
        return (self._anchor_us + ahead * self._period_us) * 1e-6


class JsonStream:
    """Call `feed` with every frame received; sends what they say to host:port. sent: number of datagrams."""

    def __init__(self, host: str, port: int) -> None:
        """Raises LinkError for a host that is not known."""
        self._datagrams = Datagrams(host, port)
        self._clock = StepClock()
        self._step: int | None = None
        self._values: dict[str, dict[str, float]] = {}
        self._columns: dict[str, tuple[str, list[tuple[str, str, float]]]] = {}
        """Frame -> its system, and (signal, column, scale) of its signals."""
        for system in declarations.names():
            for (frame, signal), column, scale in signals(system):
                self._columns.setdefault(frame, (system, []))[1].append((signal, column, scale))

    def feed(self, frames: list[Frame]) -> None:
        for message, data in protocol().known(frames):
            if message.name == "TIME":
                said = message.decode(data)
                self._clock.feed(said["step"], said["time"])
            elif message.name == "STEP":
                self._end_step()
                self._step = message.decode(data)["step"]
            elif message.name in BOARD:
                said = {name: value for name, value in message.decode(data).items() if not name.startswith("reserved")}
                self._send({"timestamp": self._clock.now_s(), "board": {message.name.lower(): said}})
            elif message.name in self._columns:
                system, columns = self._columns[message.name]
                said = message.decode(data)
                values = self._values.setdefault(system, {})
                values.update((column, said[signal] * scale) for signal, column, scale in columns)

    def _end_step(self) -> None:
        """Send the values that came after the last STEP: those of its step."""
        values, self._values = self._values, {}
        time_s = None if self._step is None else self._clock.time_s(self._step)
        for system, signals_of in values.items():
            if time_s is not None and self._step is not None:
                self._send({"timestamp": round(time_s, 6), system: {"step": self._step, **signals_of}})

    def _send(self, message: dict[str, object]) -> None:
        self._datagrams.send(json.dumps(message).encode())

    @property
    def sent(self) -> int:
        return self._datagrams.sent

    def close(self) -> None:
        self._datagrams.close()
