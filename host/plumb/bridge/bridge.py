"""Bridge between a sensor board and an STM32 on two buses: forwards every frame unchanged and counts it.

Samples go to the STM32, all frames of the STM32 go to the sensor board. The bridge is the host of the STM32: it
connects, uploads the parameters of the system, begins a real-time run on injected samples with the first sample, ends
the run (which disarms) when the samples stop, and sends the keep-alive while the board is armed. Either side may
disconnect and return.

With a shadow, the integer model runs in step with the board on the counts that the board reports
(`plumb.proof.shadow`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from plumb.bridge.bus_end import (
    LOOP_INTERVAL_S,
    PEER_TIMEOUT_S,
    RECONNECT_INTERVAL_S,
    End,
    Open,
    Say,
    Tap,
)
from plumb.bridge.frame_counts import BoardCounts, Flow
from plumb.bridge.latency import LatencyHistogram
from plumb.bridge.sample_assembler import SAMPLE_MESSAGES, Samples
from plumb.contract.parameters import ControlParams
from plumb.errors import LinkError
from plumb.link.identity import NackError, disarmed_text
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.realtime import Capture
from plumb.link.session import BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY, Session
from plumb.link.transports.open_bus import open_bus
from plumb.proof.shadow import Shadow
from plumb.spec import dbc, declarations
from plumb.spec.parameters import control_part
from plumb.spec.protocol import Frame, protocol

FIRST_SAMPLE_HINT_S = 3.0
"""Wait for the first sample before the bridge asks whether a sensor board is running."""
BOARD_TIMEOUT_S = 2.0
"""An open link sends TIME every 50 ms: a board that is silent for this long was reset or disconnected."""
BACKLOG_WINDOW = 25
"""Window, in samples, over which the smallest backlog is measured. Both sides have the same period, so a backlog never
shrinks by itself: the bridge skips as many samples as the smallest backlog of a window."""
ARM_AFTER_STEPS = 10
BLOCKED_BY_SILENCE = 1 << 7
WAITED_FOR = BLOCKED_BY_SILENCE | BLOCKED_NOT_READY | BLOCKED_IMPLAUSIBLE
"""Arming blocks that clear by themselves once samples arrive and the plant is at rest: the bridge retries."""

Sample = tuple[float, list[Frame]]
"""(time at which the sample was complete, its frames)."""


class Bridge:
    """Connects the sensor board at `sensor` to the STM32 at `board`.

    params: parameters to upload when a run begins, with those of the link's part by name (`link`). None: those that
    params_of returns for the board's system; without params_of, the board keeps its own. frames: frames of the actuator
    to select in addition to the raw counts; () selects all of the system. arm: arm once, when the first run has steps;
    after a disarm the board stays disarmed. say: called with messages for the user. tap: called with all frames of both
    sides.

    down, up: time in the bridge, from the arrival of a whole sample, or of frames of the board, to the end of their
    write on the other side; sample_to_step: from the arrival of a sample to that of the board's report of its step.
    runs, steps: of the board. skipped: samples left out to keep the latency short. unused: samples received while no
    run was in progress. If both names are the same CAN bus, the samples reach the STM32 directly and the bridge
    forwards nothing; it is only the host of the run. The same holds with `direct`: the sensor board is on the CAN bus
    of the STM32, the bridge on its UART, and the run names the other link as the source of its samples.
    """

    def __init__(
        self,
        sensor: str,
        board: str,
        params: ControlParams | None,
        frames: tuple[str, ...],
        link: dict[str, int],
        *,
        arm: bool = False,
        shadow: bool = False,
        direct: bool = False,
        params_of: Callable[[str], tuple[ControlParams, dict[str, int]]] | None = None,
        say: Say = lambda text: None,
        tap: Tap = lambda frames: None,
        open_: Open = open_bus,
    ) -> None:
        self.one_bus, self.direct = sensor == board, direct and sensor != board
        self.carries = not self.one_bus and not self.direct
        self._sample_ids = {protocol()[name].identifier for name in SAMPLE_MESSAGES}
        self.sensor = End(sensor, open_, None if self.carries else self._sample_ids)
        self.board_spec, self.board, self.counted = board, Flow(), BoardCounts()
        self.params, self.frames, self.link, self.params_of = params, frames, link, params_of
        self.want_arm, self.want_shadow, self.say, self.tap, self._open = arm, shadow, say, tap, open_
        self.runs = self.steps = self.skipped = self.unused = 0
        self.sample_to_step, self.down, self.up = LatencyHistogram(), LatencyHistogram(), LatencyHistogram()
        self.shadow: Shadow | None = None
        names = protocol()
        self._sample_a, self._raw_a = names["SAMPLE_A"], names["RAW_A"]
        self._time_id = names["TIME"].identifier
        self._setpoint_id = names["SETPOINT"].identifier
        self._samples, self._generation = Samples(), 0
        self._said_texts: set[str] = set()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until stopped() is true, the shadow has found a divergence, or a replayed log has ended."""
        self.sensor.start()
        try:
            while not stopped() and not self._finished():
                try:
                    with Session(self._open(self.board_spec)) as session:
                        session.connect()
                        session.require_match()
                        self.board.opened += 1
                        self.say(f"the board at {self.board_spec} answers")
                        self._said_texts.clear()
                        self.counted.forget()
                        self._serve(session, stopped)
                except LinkError as error:
                    self._say_once(f"the board's side: {error}")
                    self._wait(RECONNECT_INTERVAL_S, stopped)
        finally:
            self.sensor.stop()
        self.sensor.drain()  # raises the error of a wrong name, even if the run was short

    def _finished(self) -> bool:
        found = self.shadow is not None and self.shadow.divergence is not None
        return found or (self.sensor.ended and self.sensor.arrived.empty())

    def _say_once(self, text: str) -> None:
        if text not in self._said_texts:
            self._said_texts.add(text)
            self.say(text)

    def _wait(self, seconds: float, stopped: Callable[[], bool]) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end and not stopped():
            self._idle_drain()
            time.sleep(0.02)

    def _idle_drain(self) -> list[Sample]:
        """Whole samples that arrived while no run is in progress; reports a board that is connected as sensor board."""
        arrived = self._drain()
        identifiers = {frame[0] for _, frame in arrived}
        if self._time_id in identifiers and self._sample_a.identifier not in identifiers:
            self._say_once(
                f"{self.sensor.spec} is an STM32 board, not a sensor board: give the sensor board's BUS first"
            )
            self.sensor.release()  # pty names are reused: this may now be the port of the board
        if self.sensor.trouble:
            self._say_once(f"the sensor board's side: {self.sensor.trouble}")
        samples = self._whole(arrived)
        self.unused += len(samples)
        return samples

    def _drain(self) -> list[tuple[float, Frame]]:
        """The frames of the sensor board since the last call; the tap receives them, too."""
        arrived = self.sensor.drain()
        if arrived:
            self.tap([frame for _, frame in arrived])
        return arrived

    def _whole(self, arrived: list[tuple[float, Frame]]) -> list[Sample]:
        if self._generation != self.sensor.generation:
            self._generation = self.sensor.generation
            self._samples.forget()
        return self._samples.assemble(arrived)

    # ---- one session with the board ----

    def _serve(self, session: Session, stopped: Callable[[], bool]) -> None:
        session.listener = self.tap
        while not stopped() and not self._finished():
            self._idle_drain()
            sample = self._await_sample(session, stopped)
            if sample is not None:
                self._one_run(session, sample, stopped)

    def _await_sample(self, session: Session, stopped: Callable[[], bool]) -> Sample | None:
        begin_s = time.monotonic()
        while not stopped() and not self._finished():
            samples = self._idle_drain()
            if samples:
                return samples[-1]
            if not self.sensor.trouble and time.monotonic() - begin_s > FIRST_SAMPLE_HINT_S:
                self._say_once(f"no sample has come over {self.sensor.spec} yet: is a sensor board there?")
            self._listen(session, 0.02)
        return None

    def _listen(self, session: Session, timeout_s: float) -> None:
        """Receive from the board. Raises LinkError if it is silent for BOARD_TIMEOUT_S: after a reset the board is
        silent until a host opens the link again, and the cable does not show the reset."""
        if session.receive(timeout_s):
            self.counted.note(session.telemetry)
        elif session.listening.silent(BOARD_TIMEOUT_S):
            raise LinkError("it fell silent")

    def _one_run(self, session: Session, sample: Sample, stopped: Callable[[], bool]) -> None:
        params, link = self.params, self.link
        if params is None and self.params_of is not None:
            params, link = self.params_of(session.system)
        if params is None:
            params = ControlParams.from_words(control_part(session.read_parameters()))
        else:
            session.upload(params.words(), **{**params.link_words(), **link})
        named = self.frames or tuple(dict.fromkeys(name for name, _ in dbc.output_frames(params.system).values()))
        run = _Run(self, session, params)
        session.listener = run.forward_answers
        elsewhere = ("samples", "setpoints") if self.direct else ()
        session.begin("REALTIME_INJECTED", frames=(*run.capture.raw_frames, *named), elsewhere=elsewhere)
        self.runs += 1
        self.say(f"run {self.runs}: samples come, the board steps")
        generation = self.sensor.generation
        # Begin with the newest sample that arrived during the upload: older ones would stay as a backlog.
        meanwhile = self._whole(self._drain())
        self.unused += len(meanwhile) - 1
        time_s, frames = (meanwhile or [sample])[-1]
        if self._samples.setpoint is not None and self._samples.setpoint not in frames and self.carries:
            session.send(run.addressed([self._samples.setpoint]))
        pending = [(time_s, frames)]
        while not stopped() and not self._finished():
            run.send_samples(pending)
            self._listen(session, LOOP_INTERVAL_S)
            run.check()
            if generation != self.sensor.generation or self.sensor.quiet_s > PEER_TIMEOUT_S:
                self.say("the sensor board fell silent: the run ends, the outputs are neutral")
                break
            pending = self._whole(self._drain())
        session.listener = self.tap
        run.end()


class _Run:
    """One run of the board: forwards samples to it and its frames to the sensor board, and feeds the shadow."""

    def __init__(self, bridge: Bridge, session: Session, params: ControlParams) -> None:
        self.bridge, self.session = bridge, session
        self.capture = Capture(session, dbc.raw_frames(declarations.system(params.system).inputs))
        self._command_ids = [session.protocol[name].identifier for name in dbc.command_frames(dbc.command_words_most())]
        self._waiting: deque[tuple[float, tuple[int, ...]]] = deque()
        self._standing = self._surplus = self._seen = 0
        self._armed = self._disarmed = False
        self._arm_after = ARM_AFTER_STEPS
        self._used: tuple[int, ...] | None = None
        bridge.board.forget()
        self._arrived = 0
        self._watch = RealTimeWatch(
            "the board behind the bridge", "it does not take every sample in time", bridge.say, time.monotonic
        )
        if bridge.want_shadow:
            bridge.shadow = Shadow(params, bridge.shadow)

    def send_samples(self, samples: list[Sample]) -> None:
        """Send whole samples to the board, each in one write; skips samples while there is a surplus."""
        bridge = self.bridge
        self._arrived += len(samples)
        self._watch.note(self.capture.steps, self._arrived)
        for time_s, frames in samples:
            self._seen += 1
            self._standing = min(self._standing, len(self._waiting))
            if self._seen >= BACKLOG_WINDOW:
                self._surplus, self._seen, self._standing = self._standing, 0, len(self._waiting)
            if self._surplus and bridge.carries:
                self._surplus -= 1
                bridge.skipped += 1
                frames = [frame for frame in frames if frame[0] in (bridge._setpoint_id, *self._command_ids)]
            else:
                self._waiting.append((time_s, tuple(bridge._sample_a.unpack(frames[-1][1])[2:])))
            if frames and bridge.carries:
                self.session.send(self.addressed(frames))
                bridge.down.note(time.monotonic() - time_s)

    def addressed(self, frames: list[Frame]) -> list[Frame]:
        """The frames, with every SETPOINT and its commands in the session's own words: the sensor board knows neither
        the tag of this run nor its steps."""
        known = self.session.protocol
        message = known["SETPOINT"]
        result: list[Frame] = []
        commands: tuple[int, ...] = ()
        for identifier, data in frames:
            if identifier in self._command_ids:
                commands += known.by_identifier[identifier].unpack(data)[2:]
            elif identifier == message.identifier:
                result += self.session.setpoint_frames(message.unpack(data)[3], commands or None)
            else:
                result.append((identifier, data))
        return result

    def forward_answers(self, frames: list[Frame]) -> None:
        """Forward and count the board's frames, including those that arrive while a request waits for its reply."""
        bridge, now_s = self.bridge, time.monotonic()
        bridge.tap(frames)
        if frames and bridge.carries:
            bridge.sensor.send(frames)
            bridge.up.note(time.monotonic() - now_s, len(frames))
        for identifier, data in frames:
            if not bridge.one_bus or identifier not in bridge._sample_ids:
                bridge.board.note(identifier, data)
            if identifier == bridge._raw_a.identifier:
                self._match(tuple(bridge._raw_a.unpack(data)[2:]), now_s)
        before = self.capture.steps
        self.capture.feed(frames)
        bridge.steps += self.capture.steps - before
        self.capture.values.clear()
        self.capture.time_us.clear()
        if bridge.shadow is None:
            self.capture.raw.clear()
            self.capture.digest.clear()

    def check(self) -> None:
        """Compare with the shadow, arm if requested, and report a disarm."""
        bridge, session = self.bridge, self.session
        if bridge.shadow is not None:
            bridge.shadow.follow(self.capture, session.counters.lost + session.frames.rejected)
        if bridge.want_arm and self.capture.steps > self._arm_after:
            bridge.want_arm = False
            try:
                session.arm(ready_wait_s=0.0)  # no wait: samples must continue
                bridge.say("armed")
            except LinkError as error:
                if not isinstance(error, NackError) or (error.reason == "BLOCKED" and not error.detail & ~WAITED_FOR):
                    bridge.want_arm, self._arm_after = True, self.capture.steps + ARM_AFTER_STEPS
                    bridge._say_once(f"not armed yet: {error}")
                else:
                    bridge.say(f"not armed: {error}")
        if self._armed and not self.capture.armed:
            self._disarmed = True
            session.telemetry.pop("EVENTS", None)  # the next EVENTS has the cause
        self._armed = self.capture.armed
        if self._disarmed and "EVENTS" in session.telemetry:
            self._disarmed = False
            cause = session.telemetry["EVENTS"]["disarm_cause"]
            unread, system = session.listening.unread_text, session.parameters.uploaded
            why = disarmed_text(cause, session.telemetry.get("PLAUSIBILITY", {}), system, unread)
            bridge.say(f"the board disarmed: {why}; it stays so until this is started again")

    def _match(self, counts: tuple[int, ...], now_s: float) -> None:
        """A step used these counts: measure the latency of their sample, and drop older samples as lost."""
        if counts == self._used and not (self._waiting and self._waiting[0][1] == counts):
            return  # the step held the last sample
        self._used = counts
        while self._waiting:
            sent_s, sample = self._waiting.popleft()
            if sample == counts:
                self.bridge.sample_to_step.note(now_s - sent_s)
                return

    def end(self) -> None:
        if self.bridge.shadow is not None and self.bridge.shadow.divergence is not None:
            self.bridge.shadow.locate(self.session)
        self.session.end()
