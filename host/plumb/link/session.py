"""Session with a board: connect, parameters, runs, arming.

A session works over any python-can bus: `PlumbBus` on the board's UART, every other bus on its CAN bus (or, with
python-can's own slcan interface, on the UART, too). Time-outs are measured with the bus's clock if it has one, so that
a simulated board behaves the same on every machine. A request that is not answered is repeated; a failure raises
LinkError with one sentence.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import can

from plumb.errors import LinkError, UsageError
from plumb.link import unarmable
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.holding import Holding
from plumb.link.identity import Identity, NackError, identity_of, nack_error, plausibility_text, sensors_text
from plumb.link.listening import BoardWait, Listening
from plumb.link.nonces import execute_with_nonce
from plumb.link.parameter_transfer import ParameterTransfer
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES, LinkCounters
from plumb.link.said_setpoint import SETPOINT_EVERY_S, SaidSetpoint
from plumb.link.sample_codec import InputLayout, layout_of
from plumb.link.selection import RAW_FRAMES, Selection, select_bits
from plumb.link.transports.byte_stream import Channel
from plumb.link.transports.can_bus import AnyBus, FrameBus
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import dbc, declarations, parameters
from plumb.spec.protocol import Frame, protocol
from plumb.spec.records import RECORDS

KEEPALIVE_EVERY_S = 0.01
"""Interval at which the board issues a keep-alive value; the host answers each."""
SENSORS_START_S = 0.3
"""Time within which the sensors are found, configured and read after the start of a run."""
BLOCKED_BY_FAULT = 1 << 3
RUN_TAG_SHIFT, RUN_TAG_MASK = 16, 15
"""Position of the run's tag in the detail of the ACK to RUN_BEGIN."""
BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY = 1 << 11, 1 << 12
SHORTEST_WAIT_S, STANDSTILL_S = 1e-6, 1.0
"""While the bus's clock does not advance, the wait for a frame doubles from SHORTEST_WAIT_S; above STANDSTILL_S the bus
counts as dead."""
ARM_AGAIN_S = 0.02
"""Pause between two attempts to arm a system that is not ready; each takes two requests of the link."""
READY_WAIT_S = 3.0
"""Longest wait of arming for a system that is not ready; at rest, a new run is ready after 0.6 s."""
PERIODIC = ("TIME", "STATUS", "COUNTERS", "EVENTS", "SENSORS", "PLAUSIBILITY", "CAN_HEALTH")
"""Messages that the board sends periodically on an open link."""
PRESENCE_EVERY_S, SILENCE_S = 0.5, 1.5
"""The board closes a CAN link after two seconds without a frame from the host. A waiting session therefore sends a
frame every PRESENCE_EVERY_S, and one that was busy for more than SILENCE_S sends HELLO again."""


@dataclass
class Session:
    """One board on one bus. Use as a context manager: leaving it closes the bus, which disarms.

    telemetry: the last of each PERIODIC message, as raw integers by name. run_tag: tag (1 to 15) of the run that this
    session began last; its setpoints carry it. listener: called with all received frames, including those that arrive
    while a request waits for its reply. listening: how long this session has listened, and heard nothing; every
    time-out is measured by it. consent: asked before keep-alive values are answered; while it returns False
    the board is left to disarm itself. holding: whether the board is armed for this session. askers: the random numbers
    by which this session knows answers to its own commands.
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
        self._kept = {self.protocol[name].identifier: name for name in PERIODIC}
        self._of_board = {i for i, message in self.protocol.by_identifier.items() if message.sender == "BOARD"}
        self._pumped: list[Frame] = []
        self.holding = Holding(self.protocol)
        self.setpoint = SaidSetpoint(self.protocol)
        self._last_sent_s = 0.0
        # In simulated time two runs are the same to the byte.
        self.askers = random.Random(None if isinstance(self.frames, AnyBus) else self.clock())
        self.parameters = ParameterTransfer(self)
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

    # ---- parameters ----

    def read_parameters(self) -> list[int]:
        """Every parameter in use as the table's integers; unsigned for a number without a row in this version."""
        return self.parameters.read()

    def upload(self, control_words: Sequence[int], **link_words: int) -> int:
        """Commit a whole table, as ParameterTransfer.upload does; returns its CRC-32."""
        return self.parameters.upload(control_words, **link_words)

    # ---- runs and arming ----

    def execute(self, verb: str, *, matching: bool = True) -> int:
        """Execute a verb of EXECUTE with a fresh nonce; returns the detail of its ACK.

        Raises NackError if the board refuses. Raises LinkError if `matching` and the board has other definitions."""
        if matching:
            self.require_match()
        detail = execute_with_nonce(self, "EXECUTE", self.protocol["EXECUTE"].value("verb", verb))
        if verb in ("LOAD", "DEFAULTS"):  # the system may change: read it from the board when it is needed
            self.identity = None
            self.parameters.forget()
        return detail

    def execute_idle(self, verb: str, *, keep_armed: bool = False) -> None:
        """As execute, for verbs that the board refuses during a run: ends a run in progress first. Raises UsageError if
        `keep_armed` and the board is armed."""
        try:
            self.execute(verb)
        except NackError as error:
            if error.reason != "BUSY":
                raise
            if keep_armed and self._says_armed():
                raise UsageError(f"the board is armed, and {verb} would end its run: disarm it first") from None
            self.end()
            self.execute(verb)

    def _says_armed(self) -> bool:
        """What the next STATUS says; raises LinkError when none comes."""
        self.telemetry.pop("STATUS", None)
        status = self.listening.timeout(TRIES * REPLY_TIMEOUT_S)
        while "STATUS" not in self.telemetry:
            if status.over:
                raise LinkError("the board does not say whether it is armed: check the cable")
            self.receive(REPLY_TIMEOUT_S / 5)
        return bool(self.telemetry["STATUS"]["armed"])

    @property
    def system(self) -> str:
        """The system of the parameters last uploaded; otherwise read from the board once."""
        if self.parameters.uploaded is None:
            self.parameters.uploaded = declarations.name_of(self.read_parameters()[0])
        return self.parameters.uploaded

    @property
    def record_words(self) -> int:
        """32-bit words in the record of the system last uploaded; otherwise as in the board's identity."""
        if self.parameters.uploaded is not None:
            return RECORDS[self.parameters.uploaded].itemsize // 4
        return (self.identity or self.connect())["RECORD_WORDS"]

    def select(self, frames: Iterable[str] = (), words: Iterable[int] = ()) -> None:
        """Select the telemetry of the steps: frames of selectable(), words by position in the record. Allowed during a
        run. Raises UsageError for an unknown frame or word."""
        chosen = Selection(tuple(frames), tuple(sorted(set(words))))
        first_two = {name: bit for bit, name in enumerate(RAW_FRAMES[:2])}
        known = first_two if set(chosen.frames) <= set(first_two) else select_bits(self.system)
        for frame in chosen.frames:
            if frame not in known:
                raise UsageError(f"no frame '{frame}' can be selected; {self.system} has {', '.join(known)}")
        record_words = self.record_words
        banks = chosen.banks(known, record_words)
        # Banks with fewer bits first, so that no intermediate selection is larger than the old or the new one.
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

        elsewhere: "samples" and "setpoints" if those arrive over the board's other link, in real time. A run in
        progress is ended first; its last frames do not reach the listener.
        """
        self.require_match()
        listener, self.listener = self.listener, None
        try:
            self.end()
            self.select(frames, words)
        finally:
            self.listener = listener
        message = self.protocol["RUN_BEGIN"]
        flags = sum(1 << message.flags[f"{what}_elsewhere"][0] for what in elsewhere)
        detail = execute_with_nonce(self, "RUN_BEGIN", message.value("run", run), flags)
        self.run_tag = detail >> RUN_TAG_SHIFT & RUN_TAG_MASK
        self.setpoint.begin(self.input_layout().neutral)

    def end(self) -> int:
        """End the run and disarm; returns its number of steps, modulo 2^16."""
        self._let_go()
        return self.request("RUN_END", 0, 0)["detail"]

    def arm(self, ready_wait_s: float = READY_WAIT_S) -> None:
        """Arm. The caller must then call `receive` or `pump` every few milliseconds: a keep-alive value expires 40 ms
        after the board has issued it, travel time both ways included.

        Waits up to SENSORS_START_S for a fault of the sensors to clear, and up to ready_wait_s for a system that is not
        ready (at rest, converged, level, setpoint 0, sensors that agree). Raises LinkError with the reasons that block.
        """
        waited = BoardWait(self.telemetry, self.clock)
        while True:
            try:
                self.execute("ARM")
                self.setpoint.stop()  # the board has set its own to 0
                self.listening.unread_s = 0.0
                self.parameters.at_arming = self.parameters.table
                return
            except NackError as error:
                if error.reason == "UNSAFE_PARAMETER":
                    error.args = (f"the board refused to arm: {unarmable.reason(self, error.detail)}",)
                if error.reason != "BLOCKED":
                    raise
                faulty = error.detail & BLOCKED_BY_FAULT
                waiting = not error.detail & ~(BLOCKED_BY_FAULT | BLOCKED_NOT_READY | BLOCKED_IMPLAUSIBLE)
                if not waiting or waited.over(SENSORS_START_S if faulty else ready_wait_s):
                    why = sensors_text(self.telemetry.get("SENSORS", {})) if faulty else []
                    if error.detail & (BLOCKED_IMPLAUSIBLE | BLOCKED_NOT_READY):
                        why += plausibility_text(self.telemetry.get("PLAUSIBILITY", {}))
                    error.args = ("; ".join([str(error), *why]),)
                    raise
                end_s = self.clock() + ARM_AGAIN_S
                while (left_s := end_s - self.clock()) > 0:
                    self.receive(left_s)

    def disarm(self) -> None:
        self._let_go()
        self.request("DISARM", 0, 0)

    def pump(self) -> None:
        """Answer the keep-alive values that have arrived, and keep a CAN link open; other frames are kept for
        `receive`.

        No thread does this, on purpose: if the caller hangs, the board must disarm."""
        frames = self._read(0.0)
        self._follow(frames)
        self._pumped += frames
        self._send_presence()

    def input_layout(self) -> InputLayout:
        """The inputs of a step of the system in use."""
        return layout_of(self.system) if len(RAW_FRAMES) > 2 else InputLayout()

    def setpoint_frames(self, setpoint_turn_q32: int, commands: tuple[int, ...] | None = None) -> list[Frame]:
        """A setpoint for a run in real time, to be sent in one write with other frames, and not repeated. commands:
        words that come with it; None: those said last. Without a frame while no step has come since the setpoint before
        it: then `receive` and `pump` send it."""
        self.setpoint.say(setpoint_turn_q32, commands, repeats=False)
        return self._setpoint_due()

    def set_commands(self, values: Mapping[str, int], setpoint_turn_q32: int | None = None) -> None:
        """Set the commands of a run in real time, all of them at once: those that are not given get the value that
        they have when nothing sets them. setpoint_turn_q32: that comes with them; None: the one said last.

        They are sent, counted and repeated with the setpoint (`set_setpoint`). Raises UsageError for an unknown name
        and for a value beyond its limits, LinkError as set_setpoint does.
        """
        commands = declarations.system(self.system).pack_commands(values)
        self.set_inputs(self.setpoint.value if setpoint_turn_q32 is None else setpoint_turn_q32, commands)

    def set_setpoint(self, setpoint_turn_q32: int) -> None:
        """Set the setpoint of a run in real time, turn_q32. The board reports the first step that uses it in
        SETPOINT_USED. One is sent for every step that is heard of; of several in between the last one counts.

        `receive` and `pump` repeat it while this session keeps the board armed. Raises LinkError when the arming of
        this session has ended by itself: another host may have the board by now.
        """
        self.set_inputs(setpoint_turn_q32)

    def set_inputs(self, setpoint_turn_q32: int, commands: tuple[int, ...] | None = None) -> None:
        """As set_setpoint and set_commands; commands: their words, None: those said last."""
        self.pump()  # what has arrived meanwhile has the newest step, and may say that the arming is over
        if self.holding.over and (setpoint_turn_q32 or self.holding.another):
            why = self.holding.over + ("" if self.holding.another else self.listening.unread_text)
            raise LinkError(f"the setpoint is not sent, because {why}: arm again")
        self.setpoint.say(setpoint_turn_q32, commands, repeats=True)
        self._say_setpoint()
