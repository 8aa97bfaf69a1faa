"""The conversation with a board: connect, parameters, runs, arming.

A session works over any python-can bus: over `PlumbBus` on the board's UART, over every other on its CAN bus (or, with
python-can's own slcan interface, on the UART too). All time-outs go by the bus's clock where it has one, so that a
simulated board answers the same way on every machine. Every request is answered, and repeated when it is not; trouble
is a LinkError of one sentence.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import can

from plumb.errors import LinkError, UsageError
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.identity import Identity, NackError, identity_of, nack_error, plausibility_text, sensors_text
from plumb.link.parameter_transfer import ParameterTransfer
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES, LinkCounters
from plumb.link.transports.byte_stream import Channel
from plumb.link.transports.can_bus import AnyBus, FrameBus
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import dbc, declarations, parameters
from plumb.spec.protocol import Frame, protocol
from plumb.spec.records import RECORDS

KEEPALIVE_EVERY_S = 0.01
"""The board issues a value for the keep-alive so often, and each is answered."""
KEEPALIVE_NEWEST = 4
"""Of values that came together, so many are answered: older ones do not count any more."""
SENSORS_START_S = 0.3
"""Sensors in use are found, set up and heard within this, or they are not there."""
BLOCKED_BY_FAULT = 1 << 3
SETPOINT_EVERY_S = 0.05
"""A setpoint is said again so often: a source that is silent for 200 ms counts as lost."""
RUN_TAG_SHIFT = 16
"""Where the ACK of RUN_BEGIN has the tag of the run."""
BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY = 1 << 11, 1 << 12
SHORTEST_WAIT_S, STANDSTILL_S = 1e-6, 1.0
"""While the bus's clock stands still, the wait for a frame doubles from the first; beyond the second, the bus counts as
dead."""
READY_WAIT_S = 3.0
"""How long arming waits for a system that is not ready: a run that has just begun takes 0.6 s at rest."""
PERIODIC = ("TIME", "STATUS", "COUNTERS", "EVENTS", "SENSORS", "PLAUSIBILITY", "CAN_HEALTH")
"""What an open link always says."""
PRESENCE_EVERY_S, SILENCE_S = 0.5, 1.5
"""A CAN link closes after two seconds without a frame from the host: who waits speaks now and then, and who was busy
with something else for so long opens it again."""


@dataclass
class Selection:
    """What every step sends after its STEP: frames by name, words by their place in the record."""

    frames: tuple[str, ...] = ()
    words: tuple[int, ...] = ()

    def count(self) -> int:
        return len(self.frames) + len(self.words)


RAW_FRAMES = ("RAW_A", "RAW_B")
"""The raw counts of a step, for every system."""


def selectable(system: str) -> tuple[str, ...]:
    """Frames of SELECT bank 0 for a system, bit by bit."""
    return (*RAW_FRAMES, *dbc.frame_names(system))


@dataclass
class Session:
    """One board on one bus. Use as a context manager: leaving it closes the bus, which disarms.

    telemetry: the last of each PERIODIC message, as raw integers by name. run_tag: of the run that was begun here last,
    1 to 15; setpoints carry it. listener: gets all frames as they come, those
    too that arrive while a request waits for its answer.
    """

    bus: can.BusABC
    identity: Identity | None = None
    counters: LinkCounters = field(default_factory=LinkCounters)
    telemetry: dict[str, dict[str, int]] = field(default_factory=dict)
    selection: Selection = field(default_factory=Selection)
    listener: Callable[[list[Frame]], None] | None = None

    def __post_init__(self) -> None:
        self.protocol = protocol()
        self.frames: FrameBus = self.bus if isinstance(self.bus, FrameBus) else AnyBus(self.bus)
        self.fast = self.bus if isinstance(self.bus, PlumbBus) else None
        self.clock: Callable[[], float] = self.frames.clock
        self._sent: dict[int, int] = {}
        self._received: dict[int, int] = {}
        numbered = ("RAW_A", "RAW_B", "STEP")
        self._numbered = {self.protocol[name].identifier for name in numbered}
        self._kept = {self.protocol[name].identifier: name for name in PERIODIC}
        self._value_id = self.protocol["KEEPALIVE_VALUE"].identifier
        self._pumped: list[Frame] = []
        self._setpoint, self._setpoint_s = 0, 0.0
        self._alive = False
        self._said_s = 0.0
        self.parameters = ParameterTransfer(self)
        self.run_tag = 0

    @classmethod
    def open(cls, channel: Channel, baudrate: int = DEFAULT_BAUD) -> Self:
        """Open the serial channel and connect; the bus is closed again when that fails."""
        return cls.over(PlumbBus(channel, baudrate))

    @classmethod
    def over(cls, bus: can.BusABC) -> Self:
        """Connect over a bus, which is closed when that fails."""
        try:
            session = cls(bus)
            session.connect()
        except BaseException:
            bus.shutdown()
            raise
        return session

    def close(self) -> None:
        self._alive = False
        if self.fast is None:  # which says C
            with contextlib.suppress(LinkError):
                self.send([self.frame("CLOSE", 0, 0)])
        self.bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # ---- frames ----

    def frame(self, name: str, *words: int, flags: int = 0) -> Frame:
        """A sealed frame with the next counter of its identifier."""
        message = self.protocol[name]
        counter = self._sent.get(message.identifier, 0)
        self._sent[message.identifier] = counter + 1 & 15
        return message.identifier, message.pack(counter, flags, *words)

    def send(self, frames: Sequence[Frame]) -> None:
        now_s = self.clock()
        if self.fast is None and self.identity is not None and now_s - self._said_s > SILENCE_S:
            frames = [self.frame("HELLO", self.protocol.version, self.protocol.dbc_hash), *frames]
        self._said_s = now_s
        self.frames.write_frames(frames)

    def receive(self, timeout_s: float) -> list[Frame]:
        """Frames that came, each looked at for what went missing and for telemetry; keeps an armed board alive."""
        end = self.clock() + timeout_s
        frames, self._pumped = self._pumped, []
        shortest_s = 0.0
        while not frames:
            self._show_presence()
            self._repeat_setpoint()
            wait_s = max(0.0, end - self.clock())
            if self.fast is None:
                wait_s = min(wait_s, PRESENCE_EVERY_S)
            if self._alive and self._setpoint:
                wait_s = min(wait_s, SETPOINT_EVERY_S)
            before_s = self.clock()
            frames = self.frames.read_frames(max(wait_s, shortest_s))
            self._answer_values(frames)
            now_s = self.clock()
            if now_s >= end:
                break
            # A simulated bus may round a short wait down to 0, and its time then stands still.
            shortest_s = max(SHORTEST_WAIT_S, 2 * shortest_s) if now_s == before_s else 0.0
            if shortest_s > STANDSTILL_S:
                raise LinkError(f"{self.bus.channel_info}: its time does not pass; start the board again")
        for frame in frames:
            self._note(frame)
        if self.listener is not None:
            self.listener(frames)
        return frames

    def _answer_values(self, frames: list[Frame]) -> None:
        """Keep the board alive that was armed here: send the values back that it issued."""
        if self._alive:
            unpack = self.protocol["KEEPALIVE_VALUE"].unpack
            values = [unpack(data)[3] for identifier, data in frames if identifier == self._value_id]
            if values:
                self.send([self.frame("KEEPALIVE", 0, value) for value in values[-KEEPALIVE_NEWEST:]])

    def _repeat_setpoint(self) -> None:
        """Say again what was asked of an armed board: it takes a silent source for a lost one."""
        if self._alive and self._setpoint and self.clock() - self._setpoint_s >= SETPOINT_EVERY_S:
            self.set_setpoint(self._setpoint)

    def _show_presence(self) -> None:
        """On CAN say now and then that somebody listens."""
        if self.fast is None and self.identity is not None and self.clock() - self._said_s >= PRESENCE_EVERY_S:
            self.send([self.frame("KEEPALIVE", 0, 0)])

    def _note(self, frame: Frame) -> None:
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

    # ---- requests ----

    def request(
        self, name: str, *words: int, answer: str = "ACK", first: int | None = None, flags: int = 0
    ) -> dict[str, int]:
        """Send, wait for the answer, repeat when there is none.

        answer: name of the message that answers. first: value its first word must have (ACK: always the request).
        Raises NackError for a no, LinkError for silence.
        """
        expected, nack, ack = self.protocol[answer], self.protocol["NACK"], self.protocol["ACK"]
        asked = self.protocol[name].identifier
        for attempt in range(TRIES):
            self.counters.repeated_requests += attempt > 0
            frame = self.frame(name, *words, flags=flags)
            counter = frame[1][1] & 15
            self.send([frame])
            end = self.clock() + REPLY_TIMEOUT_S
            while (remaining := end - self.clock()) > 0:
                for identifier, data in self.receive(remaining):
                    if identifier in (ack.identifier, nack.identifier):
                        said = self.protocol.by_identifier[identifier].decode(data)
                        if said["request"] != asked or said["request_counter"] != counter:
                            continue
                        if identifier == nack.identifier:
                            raise nack_error(self.protocol, said)
                        if expected is ack:
                            return said
                    elif identifier == expected.identifier:
                        said = expected.decode(data)
                        if first is None or said[expected.words[0]] == first:
                            return said
        raise LinkError(f"the board stopped answering ({name} on {self.bus.channel_info}): check cable and power")

    # ---- connect ----

    def connect(self) -> Identity:
        """Say hello and hear who is there; Identity.mismatch says why arming is out of the question, if it is.

        Raises LinkError when nobody answers.
        """
        message = self.protocol["IDENTITY"]
        end_item = message.value("item", "END")
        for _ in range(TRIES):
            items: dict[int, int] = {}
            self._sent.clear()
            self._received.clear()
            self.send([self.frame("HELLO", self.protocol.version, self.protocol.dbc_hash)])
            end = self.clock() + 2 * REPLY_TIMEOUT_S
            while end_item not in items and (remaining := end - self.clock()) > 0:
                for identifier, data in self.receive(remaining):
                    if identifier == message.identifier:
                        item, value = message.unpack(data)[2:]
                        items[item] = value
                        end = self.clock() + 2 * REPLY_TIMEOUT_S
            if end_item in items and len(items) == items[end_item] + 1:
                self.identity = identity_of(items, self.protocol, len(parameters.table()))
                return self.identity
        what = "answered, but not in full" if items else "does not answer"
        check = "at this baud rate, and that no other program reads this port"
        if self.fast is None:
            check = "that wiring and termination are right, and that can_bitrate_kbit is the bus's bit rate"
        raise LinkError(f"{self.bus.channel_info}: the board {what}; check that it runs plumb, {check}")

    def require_match(self) -> Identity:
        """The identity, connecting first when that was not done; raises LinkError with the mismatch if there is one."""
        identity = self.identity or self.connect()
        if identity.mismatch:
            raise LinkError(identity.mismatch)
        return identity

    # ---- parameters ----

    def read_parameters(self) -> list[int]:
        """Every parameter in use, as the integers of the table (unsigned where this version has no row for it)."""
        return self.parameters.read()

    def upload(self, control_words: Sequence[int], **link_words: int) -> int:
        """Commit a whole table, as ParameterTransfer.upload does; returns its CRC-32."""
        return self.parameters.upload(control_words, **link_words)

    # ---- runs and arming ----

    def _answer_nonce(self, request: str, verb: int, flags: int = 0) -> int:
        """Ask for a nonce and carry the command out with it; returns the detail of its ACK. A lost answer asks anew."""
        for attempt in range(TRIES):
            nonce = self.request("CHALLENGE", verb, 0, answer="NONCE", first=verb)["nonce"]
            try:
                return self.request(request, verb, nonce, flags=flags)["detail"]
            except NackError as error:
                if error.reason != "NONCE" or attempt == TRIES - 1:
                    raise
        raise LinkError("the board accepts no nonce")

    def execute(self, verb: str, *, matching: bool = True) -> int:
        """Carry out a verb of EXECUTE with a fresh nonce; returns the detail of its ACK.

        Raises NackError for a no, and LinkError when the board has other definitions, unless they need not match."""
        if matching:
            self.require_match()
        detail = self._answer_nonce("EXECUTE", self.protocol["EXECUTE"].value("verb", verb))
        if verb in ("LOAD", "DEFAULTS"):  # may be another system: who asks for its record asks the board
            self.identity = None
            self.parameters.forget()
        return detail

    def execute_idle(self, verb: str) -> None:
        """As execute, for what no run may be on for: ends the one that is."""
        try:
            self.execute(verb)
        except NackError as error:
            if error.reason != "BUSY":
                raise
            self.end()
            self.execute(verb)

    @property
    def system(self) -> str:
        """The system that was uploaded last, else the one that the board has; asked for once."""
        if self.parameters.uploaded is None:
            self.parameters.uploaded = declarations.name_of(self.read_parameters()[0])
        return self.parameters.uploaded

    @property
    def record_words(self) -> int:
        """Words in the record of the system that was uploaded last, else of the one the board said it has."""
        if self.parameters.uploaded is not None:
            return RECORDS[self.parameters.uploaded].itemsize // 4
        return (self.identity or self.connect())["RECORD_WORDS"]

    def select(self, frames: Iterable[str] = (), words: Iterable[int] = ()) -> None:
        """Choose what steps send: frames of selectable(), words by their place in the record. May change in a run."""
        chosen = Selection(tuple(frames), tuple(sorted(set(words))))
        known = RAW_FRAMES if set(chosen.frames) <= set(RAW_FRAMES) else selectable(self.system)
        for frame in chosen.frames:
            if frame not in known:
                raise UsageError(f"no frame '{frame}' can be selected; {self.system} has {', '.join(known)}")
        record_words = self.record_words
        banks = [0] * (1 + (record_words + 31) // 32)
        banks[0] = sum(1 << known.index(frame) for frame in set(chosen.frames))
        for word in chosen.words:
            if not 0 <= word < record_words:
                raise UsageError(f"the board's record has no word {word}")
            banks[1 + word // 32] |= 1 << word % 32
        # Emptier first, so that no state in between is larger than the old or the new one.
        for bank, mask in sorted(enumerate(banks), key=lambda entry: entry[1].bit_count()):
            self.request("SELECT", bank, mask)
        self.selection = chosen

    def begin(
        self,
        run: str = "LOCKSTEP",
        frames: Iterable[str] = (),
        words: Iterable[int] = (),
        elsewhere: Collection[str] = (),
    ) -> None:
        """Begin a run: LOCKSTEP, REALTIME_INJECTED or REALTIME_LIVE. State, step number and digest start anew.

        elsewhere: "samples" and "setpoints" where those come over the board's other link, in real time. A run that is
        on is ended first, and its last frames are not shown to the listener.
        """
        self.require_match()
        listener, self.listener = self.listener, None
        try:
            self.end()
            self.select(frames, words)
        finally:
            self.listener = listener
        self._setpoint = 0
        message = self.protocol["RUN_BEGIN"]
        flags = sum(1 << message.flags[f"{what}_elsewhere"][0] for what in elsewhere)
        self.run_tag = self._answer_nonce("RUN_BEGIN", message.value("run", run), flags) >> RUN_TAG_SHIFT

    def end(self) -> int:
        """End the run and disarm; returns its number of steps, modulo 2^16."""
        self._alive = False
        return self.request("RUN_END", 0, 0)["detail"]

    def arm(self, ready_wait_s: float = READY_WAIT_S) -> None:
        """Arm; from here on `receive` or `pump` has to be called every few milliseconds: a value that the board issues
        counts for 40 ms, the way to the host and back included.

        A board with a fault gets SENSORS_START_S for its sensors to come up; one that is not ready (at rest, converged,
        level, setpoint 0, sensors that agree) gets ready_wait_s. Raises LinkError with what is in the way.
        """
        begin_s = self.clock()
        while True:
            try:
                first = self.execute("ARM")
                break
            except NackError as error:
                if error.reason != "BLOCKED":
                    raise
                faulty = error.detail & BLOCKED_BY_FAULT
                waiting = not error.detail & ~(BLOCKED_BY_FAULT | BLOCKED_NOT_READY | BLOCKED_IMPLAUSIBLE)
                if not waiting or self.clock() - begin_s >= (SENSORS_START_S if faulty else ready_wait_s):
                    why = sensors_text(self.telemetry.get("SENSORS", {})) if faulty else []
                    if error.detail & (BLOCKED_IMPLAUSIBLE | BLOCKED_NOT_READY):
                        why += plausibility_text(self.telemetry.get("PLAUSIBILITY", {}))
                    error.args = ("; ".join([str(error), *why]),)
                    raise
                self.receive(REPLY_TIMEOUT_S / 5)
        self.send([self.frame("KEEPALIVE", 0, first)])
        self._alive = True

    def disarm(self) -> None:
        self._alive = False
        self.request("DISARM", 0, 0)

    def pump(self) -> None:
        """Answer the values for the keep-alive that have come, and on CAN say now and then that somebody is here; what
        else has come is kept for `receive`. There is no thread for it on purpose: who hangs must lose the board."""
        frames = self.frames.read_frames(0.0)
        self._answer_values(frames)
        self._pumped += frames
        self._repeat_setpoint()
        self._show_presence()

    def set_setpoint(self, setpoint_turn_q32: int) -> None:
        """Real time: the setpoint from the next step on; the board tells the step with SETPOINT_USED. `receive` and
        `pump` repeat it while the board is armed from here."""
        self._setpoint, self._setpoint_s = setpoint_turn_q32, self.clock()
        self.send([self.frame("SETPOINT", 0, setpoint_turn_q32, flags=self.run_tag)])
