"""The frames of a session with a board: what is sent, received, counted and answered, and requests with their replies.

It works over any python-can bus: `PlumbBus` on the board's UART, every other bus on its CAN bus (or, with python-can's
own slcan interface, on the UART, too). Time-outs are measured with the bus's clock if it has one, so that a simulated
board behaves the same on every machine. A request that is not answered is repeated; a failure raises LinkError with one
sentence.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Self

import can

from plumb.errors import LinkError
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.holding import Holding
from plumb.link.identity import Identity, identity_of, nack_error
from plumb.link.listening import Listening
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES, LinkCounters
from plumb.link.said_setpoint import SETPOINT_EVERY_S, SaidSetpoint
from plumb.link.selection import RAW_FRAMES, Selection
from plumb.link.transports.byte_stream import Channel
from plumb.link.transports.can_bus import AnyBus, FrameBus
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import dbc, parameters
from plumb.spec.protocol import Frame, protocol

KEEPALIVE_EVERY_S = 0.01
"""Interval at which the board issues a keep-alive value; the host answers each."""
SHORTEST_WAIT_S, STANDSTILL_S = 1e-6, 1.0
"""While the bus's clock does not advance, the wait for a frame doubles from SHORTEST_WAIT_S; above STANDSTILL_S the bus
counts as dead."""
PERIODIC = ("TIME", "STATUS", "COUNTERS", "EVENTS", "SENSORS", "PLAUSIBILITY", "CAN_HEALTH")
"""Messages that every board sends periodically on an open link."""
KEPT = (*PERIODIC, "BATTERY")
"""And those that some do."""
PRESENCE_EVERY_S, SILENCE_S = 0.5, 1.5
"""The board closes a CAN link after two seconds without a frame from the host. A waiting session therefore sends a
frame every PRESENCE_EVERY_S, and one that was busy for more than SILENCE_S sends HELLO again."""


@dataclass
class BoardFrames:
    """One board on one bus: frames both ways, telemetry, keep-alive, requests. Use as a context manager: leaving it
    closes the bus, which disarms.

    telemetry: the last of each KEPT message, as raw integers by name. run_tag: tag (1 to 15) of the run that this
    session began last; its setpoints carry it. listener: called with all received frames, including those that arrive
    while a request waits for its reply. listening: how long this session has listened, and received nothing; every
    time-out is measured by it. consent: asked before keep-alive values are answered; while it returns False the board
    is left to disarm itself. holding: whether the board is armed for this session. askers: the random numbers by which
    this session knows answers to its own commands.
    """

    bus: can.BusABC
    identity: Identity | None = None
    counters: LinkCounters = field(default_factory=LinkCounters)
    telemetry: dict[str, dict[str, int]] = field(default_factory=dict)
    selection: Selection = field(default_factory=Selection)
    listener: Callable[[list[Frame]], None] | None = None
    consent: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        self.protocol = protocol()
        self.frames: FrameBus = self.bus if isinstance(self.bus, FrameBus) else AnyBus(self.bus)
        self.fast = self.bus if isinstance(self.bus, PlumbBus) else None
        self.clock: Callable[[], float] = self.frames.clock
        self.listening = Listening(self.clock)
        self._sent: dict[int, int] = {}
        self._received: dict[int, int] = {}
        numbered = (*RAW_FRAMES, "STEP")
        self._numbered = {self.protocol[name].identifier for name in numbered}
        self._kept = {self.protocol[name].identifier: name for name in KEPT}
        self._of_board = {i for i, message in self.protocol.by_identifier.items() if message.sender == "BOARD"}
        self._pumped: list[Frame] = []
        self.holding = Holding(self.protocol)
        self.setpoint = SaidSetpoint(self.protocol)
        self._last_sent_s = 0.0
        # In simulated time two runs are the same to the byte.
        self.askers = random.Random(None if isinstance(self.frames, AnyBus) else self.clock())
        self.run_tag = 0

    @classmethod
    def open(cls, channel: Channel, baudrate: int = DEFAULT_BAUD) -> Self:
        """Open the serial channel and connect. Raises LinkError and closes the bus if that fails."""
        return cls.over(PlumbBus(channel, baudrate))

    @classmethod
    def over(cls, bus: can.BusABC) -> Self:
        """Connect over a bus. Raises LinkError and closes the bus if that fails."""
        try:
            session = cls(bus)
            session.connect()
        except BaseException:
            bus.shutdown()
            raise
        return session

    @property
    def armed(self) -> bool:
        """Whether this session has armed the board, and nothing that was received says that this is over."""
        return self.holding.number != 0

    def close(self) -> None:
        self._let_go()
        if self.fast is None:  # PlumbBus closes the link itself, with C
            with contextlib.suppress(LinkError):
                self.send([self.frame("CLOSE", 0, 0)])
        self.bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---- frames ----

    def frame(self, name: str, *words: int, flags: int = 0) -> Frame:
        """A frame with the next counter of its identifier, and its CRC."""
        message = self.protocol[name]
        counter = self._sent.get(message.identifier, 0)
        self._sent[message.identifier] = counter + 1 & 15
        return message.identifier, message.pack(counter, flags, *words)

    def send(self, frames: Sequence[Frame]) -> None:
        now_s = self.clock()
        if self.fast is None and self.identity is not None and now_s - self._last_sent_s > SILENCE_S:
            frames = [self.frame("HELLO", self.protocol.version, self.protocol.dbc_hash), *frames]
        self._last_sent_s = now_s
        self.frames.write_frames(frames)

    def receive(self, timeout_s: float) -> list[Frame]:
        """Receive frames, waiting up to timeout_s for the first; [] after the time-out.

        Counts lost frames, updates `telemetry`, and answers the keep-alive values of a board armed by this session.
        Raises LinkError if the bus fails or its clock stops.
        """
        end = self.clock() + timeout_s
        frames, self._pumped = self._pumped, []
        shortest_s = 0.0
        while not frames:
            self._send_presence()
            wait_s = max(0.0, end - self.clock())
            if self.fast is None:
                wait_s = min(wait_s, PRESENCE_EVERY_S)
            if self.armed and self.setpoint.moves:
                wait_s = min(wait_s, SETPOINT_EVERY_S)
            before_s = self.clock()
            frames = self._read(max(wait_s, shortest_s))
            self._follow(frames)
            now_s = self.clock()
            if now_s >= end:
                break
            # A simulated bus may round a short wait down to 0, and its time then stands still.
            shortest_s = max(SHORTEST_WAIT_S, 2 * shortest_s) if now_s == before_s else 0.0
            if shortest_s > STANDSTILL_S:
                raise LinkError(f"{self.bus.channel_info}: its time does not pass; start the board again")
        for frame in frames:
            self._count_and_keep(frame)
        if self.listener is not None:
            self.listener(frames)
        return frames

    def pump(self) -> None:
        """Answer the keep-alive values that have arrived, and keep a CAN link open; other frames are kept for
        `receive`.

        No thread does this, on purpose: if the caller hangs, the board must disarm."""
        frames = self._read(0.0)
        self._follow(frames)
        self._pumped += frames
        self._send_presence()

    def _read(self, wait_s: float) -> list[Frame]:
        begin_s = self.clock()
        frames = self.frames.read_frames(wait_s)
        self.listening.note(wait_s, begin_s, any(identifier in self._of_board for identifier, _ in frames))
        return frames

    def _follow(self, frames: list[Frame]) -> None:
        """Take what was just read. Answers the keep-alive values of this session's arming, if whoever is asked for
        consent gives it; when the arming is over, neither values nor setpoints go out any more."""
        armed = self.armed
        self.setpoint.follow(frames)
        values = self.holding.follow(frames, self.run_tag)
        if armed and not self.armed:
            self.setpoint.end()
        if values and (self.consent is None or self.consent()):
            number = self.holding.number
            self.send([self.frame("KEEPALIVE", number, value) for value in values])
        self._say_setpoint()

    def _let_go(self) -> None:
        """This session orders the end of its arming."""
        self.holding.release()
        self.setpoint.end()

    def _setpoint_due(self) -> list[Frame]:
        """The setpoint, where it waits for a step that has come, or that of an armed board is to be repeated."""
        now_s = self.clock()
        if not self.setpoint.due(now_s, armed=self.armed):
            return []
        self.setpoint.sent(now_s)
        return [
            *self.setpoint.set_frames(self.run_tag),
            self.frame("SETPOINT", self.setpoint.next_step, self.setpoint.value, flags=self.run_tag),
        ]

    def _say_setpoint(self) -> None:
        frames = self._setpoint_due()
        if frames:
            self.send(frames)

    def _send_presence(self) -> None:
        """On CAN, send a frame when PRESENCE_EVERY_S has passed, so that the board keeps the link open."""
        if self.fast is None and self.identity is not None and self.clock() - self._last_sent_s >= PRESENCE_EVERY_S:
            self.send([self.frame("KEEPALIVE", 0, 0)])

    def _count_and_keep(self, frame: Frame) -> None:
        identifier, data = frame
        if identifier not in self._numbered:
            counter, slot = data[1] & 15, dbc.counter_slot(identifier)
            last = self._received.get(slot)
            if last is not None:
                self.counters.lost += counter - last - 1 & 15
            self._received[slot] = counter
            kept = self._kept.get(identifier)
            if kept is not None:
                self.telemetry[kept] = self.protocol[kept].decode(data)
                if kept == "TIME":
                    self.listening.board_says(self.telemetry[kept]["time"])

    # ---- requests ----

    def request(
        self, name: str, *words: int, answer: str = "ACK", first: int | None = None, flags: int = 0, echo: int = 0
    ) -> dict[str, int]:
        """Send a request and return the reply by signal name; repeat the request up to TRIES times.

        answer: name of the reply's message. first: value that its first word must have (an ACK must name the request).
        echo: bits of the second word that an ACK must repeat in its detail.
        Raises NackError if the board refuses, LinkError if it does not reply.
        """
        expected, nack, ack = self.protocol[answer], self.protocol["NACK"], self.protocol["ACK"]
        asked = self.protocol[name].identifier
        for attempt in range(TRIES):
            self.counters.repeated_requests += attempt > 0
            frame = self.frame(name, *words, flags=flags)
            counter = frame[1][1] & 15
            self.send([frame])
            reply = self.listening.timeout(REPLY_TIMEOUT_S)
            while not reply.over:
                for identifier, data in self.receive(reply.left_s):
                    if identifier in (ack.identifier, nack.identifier):
                        said = self.protocol.by_identifier[identifier].decode(data)
                        if said["request"] != asked or said["request_counter"] != counter:
                            continue
                        if identifier == nack.identifier:
                            raise nack_error(self.protocol, said, self.identity)
                        if expected is ack and not (said["detail"] ^ words[1]) & echo:
                            return said
                    elif identifier == expected.identifier:
                        said = expected.decode(data)
                        if first is None or said[expected.words[0]] == first:
                            return said
        raise LinkError(f"the board stopped answering ({name} on {self.bus.channel_info}): check cable and power")

    # ---- connect ----

    def connect(self) -> Identity:
        """Open the link and read the board's identity. Identity.mismatch is the reason why arming is refused, or "".

        Raises LinkError if the board does not answer in full.
        """
        message = self.protocol["IDENTITY"]
        end_item = message.value("item", "END")
        for _ in range(TRIES):
            items: dict[int, int] = {}
            self._sent.clear()
            self._received.clear()
            self.send([self.frame("HELLO", self.protocol.version, self.protocol.dbc_hash)])
            reply = self.listening.timeout(2 * REPLY_TIMEOUT_S)
            while end_item not in items and not reply.over:
                for identifier, data in self.receive(reply.left_s):
                    if identifier == message.identifier:
                        item, value = message.unpack(data)[2:]
                        items[item] = value
                        reply.renew()
            if end_item in items and len(items) == items[end_item] + 1:
                self.identity = identity_of(items, self.protocol, len(parameters.table()))
                return self.identity
        what = "answered, but not in full" if items else "does not answer"
        check = "at this baud rate, and that no other program reads this port"
        if self.fast is None:
            check = "that wiring and termination are right, and that can_bitrate_kbit is the bus's bit rate"
        raise LinkError(f"{self.bus.channel_info}: the board {what}; check that it runs plumb, {check}")

    def require_match(self) -> Identity:
        """The identity; connects first if necessary. Raises LinkError if board and host do not match."""
        identity = self.identity or self.connect()
        if identity.mismatch:
            raise LinkError(identity.mismatch)
        return identity
