"""Session with a board: parameters, runs, arming, setpoints, on top of its frames (`board_frames`)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from plumb.errors import LinkError, UsageError
from plumb.link import unarmable
from plumb.link.board_frames import BoardFrames
from plumb.link.identity import NackError, plausibility_text, sensors_text
from plumb.link.listening import BoardWait
from plumb.link.nonces import execute_with_nonce
from plumb.link.parameter_transfer import ParameterTransfer
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES
from plumb.link.sample_codec import InputLayout, layout_of
from plumb.link.selection import RAW_FRAMES, Selection, select_bits
from plumb.spec import declarations
from plumb.spec.protocol import Frame
from plumb.spec.records import RECORDS

SENSORS_START_S = 0.3
"""Time within which the sensors are found, configured and read after the start of a run."""
BLOCKED_BY_FAULT = 1 << 3
RUN_TAG_SHIFT, RUN_TAG_MASK = 16, 15
"""Position of the run's tag in the detail of the ACK to RUN_BEGIN."""
BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY, BLOCKED_STOPPED = 1 << 11, 1 << 12, 1 << 15
PASSING = BLOCKED_BY_FAULT | BLOCKED_IMPLAUSIBLE | BLOCKED_NOT_READY | BLOCKED_STOPPED
"""Reasons that block a run that has just begun: a vehicle knows its rider after some 20 ms."""
ARM_AGAIN_S = 0.02
"""Pause between two attempts to arm a system that is not ready; each takes two requests of the link."""
READY_WAIT_S = 3.0
"""Longest wait of arming for a system that is not ready; at rest, a new run is ready after 0.6 s."""


class Session(BoardFrames):
    """Requests to a board: parameters, runs, arming, setpoints. parameters: their transfer."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.parameters = ParameterTransfer(self)

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
        """The next STATUS; raises LinkError when none comes."""
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
        return self.parameters.system()

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
        """End the run and disarm; returns its number of steps, modulo 2^16. While a pilot's switch holds the board
        armed the run goes on without this host."""
        self._let_go()
        try:
            return self.request("RUN_END", 0, 0)["detail"]
        except NackError as error:
            if error.reason != "ARMED":
                raise
            return error.detail

    def arm(self, ready_wait_s: float = READY_WAIT_S) -> None:
        """Arm. The caller must then call `receive` or `pump` every few milliseconds: a keep-alive value expires 40 ms
        after the board has issued it, travel time both ways included.

        Waits up to SENSORS_START_S for a fault of the sensors to clear, and up to ready_wait_s for a system that is not
        ready (at rest, converged, level, setpoint 0, sensors that agree, a step that lets the motors turn). Raises
        LinkError with the reasons that block.
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
                waiting = not error.detail & ~PASSING
                if not waiting or waited.over(SENSORS_START_S if faulty else ready_wait_s):
                    why = sensors_text(self.telemetry.get("SENSORS", {})) if faulty else []
                    if error.detail & (PASSING & ~BLOCKED_BY_FAULT):
                        why += plausibility_text(self.telemetry.get("PLAUSIBILITY", {}), self.parameters.uploaded)
                    error.args = ("; ".join([str(error), *why]),)
                    raise
                end_s = self.clock() + ARM_AGAIN_S
                while (left_s := end_s - self.clock()) > 0:
                    self.receive(left_s)

    def disarm(self) -> None:
        """Disarm the board. One that a pilot's switch holds armed obeys only a command with a nonce."""
        self._let_go()
        try:
            self.request("DISARM", 0, 0)
        except NackError as error:
            if error.reason != "ARMED":
                raise
            execute_with_nonce(self, "EXECUTE", self.protocol["EXECUTE"].value("verb", "DISARM"))

    def input_layout(self) -> InputLayout:
        """The inputs of a step of the system in use."""
        return layout_of(self.system) if len(RAW_FRAMES) > 2 else InputLayout()

    def setpoint_frames(self, setpoint: int, commands: tuple[int, ...] | None = None) -> list[Frame]:
        """A setpoint for a run in real time, to be sent in one write with other frames, and not repeated. commands:
        words that come with it; None: those said last. Without a frame while no step has come since the setpoint before
        it: then `receive` and `pump` send it."""
        self.setpoint.say(setpoint, commands, repeats=False)
        return self._setpoint_due()

    def set_commands(self, values: Mapping[str, int], setpoint: int | None = None) -> None:
        """Set the commands of a run in real time, all of them at once: those that are not given get the value that
        they have when nothing sets them. setpoint: that comes with them; None: the one said last.

        They are sent, counted and repeated with the setpoint (`set_setpoint`). Raises UsageError for an unknown name
        and for a value beyond its limits, LinkError as set_setpoint does.
        """
        commands = declarations.system(self.system).pack_commands(values)
        self.set_inputs(self.setpoint.value if setpoint is None else setpoint, commands)

    def set_setpoint(self, setpoint: int) -> None:
        """Set the setpoint of a run in real time, in the unit and format that its system declares. The board reports
        the first step that uses it in SETPOINT_USED. The host sends one setpoint for every step that it receives; of
        several in between the last one counts.

        `receive` and `pump` repeat it while this session keeps the board armed. Raises LinkError when the arming of
        this session has ended by itself: another host may have the board by now.
        """
        self.set_inputs(setpoint)

    def set_inputs(self, setpoint: int, commands: tuple[int, ...] | None = None) -> None:
        """As set_setpoint and set_commands; commands: their words, None: those said last."""
        self.pump()  # what has arrived meanwhile has the newest step, and may say that the arming is over
        if self.holding.over and (setpoint or self.holding.another):
            why = self.holding.over + ("" if self.holding.another else self.listening.unread_text)
            raise LinkError(f"the setpoint is not sent, because {why}: arm again")
        self.setpoint.say(setpoint, commands, repeats=True)
        self._say_setpoint()
