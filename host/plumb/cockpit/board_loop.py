"""The loop that owns the link to the board: receives, compares, records, and obeys the orders of the pages.

It runs in one thread, and nothing else touches the session. Safety stands on three legs: the session answers the
keep-alive values of an armed board only while `consent` says so, that is, while the page that holds the board is alive
and nobody asked for a stop; the loop disarms the board as soon as consent is gone; and when the loop itself hangs, no
keep-alive is answered at all. In each case the outputs are neutral within 50 ms.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from plumb.boards.link import LinkBoard
from plumb.cockpit import parameter_orders
from plumb.cockpit.green_light import Comparison
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.recording import Recording
from plumb.cockpit.samples import Samples
from plumb.cockpit.setpoint import StepTest, setpoint_of
from plumb.errors import LinkError, PlumbError, UsageError
from plumb.link import monitor
from plumb.link.identity import NackError
from plumb.link.realtime import Capture
from plumb.link.session import BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY, RAW_FRAMES, READY_WAIT_S, Session, selectable
from plumb.spec import declarations
from plumb.spec.parameter_file import by_name
from plumb.spec.parameters import control_part, table
from plumb.spec.protocol import Frame
from plumb.tuning.quantise import ControlParams

TURN_S = 0.01
"""Longest wait for a frame in one turn of the loop."""
STATE_EVERY_S = 0.1
FIRST_STATUS_S = 1.0
"""Longest wait for the first STATUS, which says whether a run is on."""
SPEED_OVER_S = 1.0
ARM_AGAIN_S = 0.05
"""Pause between two tries to arm while the board is not ready."""
NOTES_KEPT = 50
SEEN_ARMED_S = 1.0
"""A board that took ARM says so in its steps within this time."""
WAITED_FOR = BLOCKED_NOT_READY | BLOCKED_IMPLAUSIBLE

Answer = dict[str, object]
"""What a page hears of its order: `good`, `text`, and what it asked for."""
Reply = Callable[[Answer], None]


class PlantOnBoard(Protocol):
    """Puts a simulated plant on the pins of a board, at the beginning of a run."""

    def attach(self, board: LinkBoard) -> None: ...


class Pace:
    """Holds a simulation back to real time. speed: of the last second, 1 for real time. It does not catch up."""

    def __init__(self, now_s: float) -> None:
        self._begin_s, self._begin_wall_s = now_s, time.monotonic()
        self._speed_s, self._speed_wall_s = self._begin_s, self._begin_wall_s
        self.speed = 1.0

    def keep(self, now_s: float) -> None:
        """Sleep for as long as the simulation is ahead, at most for one turn of the loop. now_s: its time."""
        wall_s = time.monotonic()
        ahead_s = (now_s - self._begin_s) - (wall_s - self._begin_wall_s)
        if ahead_s < -STATE_EVERY_S:
            self._begin_s, self._begin_wall_s = now_s, wall_s
        if wall_s - self._speed_wall_s >= SPEED_OVER_S:
            self.speed = (now_s - self._speed_s) / (wall_s - self._speed_wall_s)
            self._speed_s, self._speed_wall_s = now_s, wall_s
        time.sleep(min(max(0.0, ahead_s), TURN_S))


class BoardLoop:
    """One board. watch: only listen to the run that is on. paced: hold a board that is simulated in this process back
    to real time. Other threads call `order` and `stop`, and read `samples`, `state` and `notes`."""

    def __init__(
        self,
        board: LinkBoard,
        hold: Hold,
        *,
        folder: Path,
        plant: PlantOnBoard | None = None,
        watch: bool = False,
        paced: bool = False,
        command: str = "",
    ) -> None:
        self.board, self.hold, self.watch = board, hold, watch
        self.notes: deque[tuple[float, str]] = deque(maxlen=NOTES_KEPT)
        self.samples: Samples | None = None
        self.state: dict[str, object] = {}
        self.recording = Recording(board, folder, command, self.note)
        self._plant, self._paced = plant, paced
        self._orders: queue.SimpleQueue[tuple[Order, Reply]] = queue.SimpleQueue()
        self._stop_asked = threading.Event()
        self._armed = self._seen_armed = self._own_run = False
        self._armed_s = self._arm_until_s = self._arm_next_s = 0.0
        self._arming: tuple[Order, Reply] | None = None
        self._test: StepTest | None = None
        self._runs, self._stated_s = 0, 0.0
        self._capture: Capture | None = None
        self._comparison = Comparison(None, "no run is on")
        self._identity = board.session.identity or board.session.connect()
        self._open(board.session)

    # ---- called by other threads ----

    def order(self, order: Order, reply: Reply) -> None:
        """Queue an order of a page; reply is called in the loop's thread."""
        self._orders.put((order, reply))

    def stop(self) -> None:
        """Disarm at once. Keep-alives cease with this call, whatever the loop does."""
        self._stop_asked.set()

    def consent(self) -> bool:
        """Whether the board may stay armed by this program."""
        return self.hold.alive() and not self._stop_asked.is_set()

    def note(self, text: str) -> None:
        """A line in the log of the page."""
        self.notes.append((time.time(), text))

    # ---- the loop ----

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve the board until stopped() is true; leaves it disarmed, and ends the run that it began.

        Raises LinkError when the board falls silent.
        """
        try:
            self._begin_or_join()
            while not stopped():
                self.turn()
        finally:
            self._close()

    def turn(self) -> None:
        """One turn: safety, one order, frames, comparison, state."""
        self._heed()
        self._obey()
        self._session.receive(TURN_S)
        self._follow()
        now_s = self._session.clock()
        if now_s - self._monitor.heard_s > monitor.SILENCE_S:
            raise LinkError("the board fell silent: check cable and power, then start again")
        if now_s - self._stated_s >= STATE_EVERY_S or not self.state:
            self._stated_s = now_s
            self.state = self._describe()
        if self._paced:
            self._pace.keep(now_s)

    def _open(self, session: Session) -> None:
        """Take over a session: at the start, and after the board was restarted."""
        self._session = session
        session.consent = self.consent
        session.listener = self._feed
        self._monitor = monitor.Monitor(session)
        self._pace, self._stated_s = Pace(session.clock()), 0.0

    def _close(self) -> None:
        self.recording.stop()
        self._session.listener = None
        if self._armed:
            self._session.disarm()
        if self._own_run:
            self._session.end()

    def _feed(self, frames: list[Frame]) -> None:
        self._monitor.feed(frames)
        if self._capture is not None:
            self._capture.feed(frames)
        self.recording.feed(frames)

    def _follow(self) -> None:
        """Rows, comparison, step test, and what the steps say about arming."""
        capture, samples, now_s = self._capture, self.samples, self._session.clock()
        if capture is None or samples is None:
            return
        samples.take(capture)
        session = self._session
        self._comparison.follow(capture, session.counters.lost + session.frames.rejected, now_s)
        if self._armed:
            self._check_armed(capture, now_s)
        if self._test is not None and (done := self._test.follow(session, samples, self._armed)) is not None:
            self._test = None
            self.note(str(done["text"]))

    def _check_armed(self, capture: Capture, now_s: float) -> None:
        """Disarm a board that differs from the model, and notice one that disarmed itself."""
        if self._comparison.differs:
            self._disarm(f"disarmed: {self._comparison.light(now_s).text}")
            return
        self._seen_armed = self._seen_armed or capture.armed
        if (self._seen_armed and not capture.armed) or (not self._seen_armed and now_s - self._armed_s > SEEN_ARMED_S):
            self._session.disarm()  # ends the answers to keep-alive values, too
            self._armed = False
            self.note("the board disarmed itself; Health says why")

    # ---- runs ----

    def _begin_or_join(self) -> None:
        """Begin a run on an idle board, else listen to the run that is on."""
        if self._plant is not None:
            self._renew_plant()
            self.begin()
            return
        end_s = self._session.clock() + FIRST_STATUS_S
        while "STATUS" not in self._session.telemetry and self._session.clock() < end_s:
            self._session.receive(TURN_S)
        mode = self._session.telemetry.get("STATUS", {}).get("mode", 0)
        if not mode and not self.watch:
            try:
                self.begin()
            except (NackError, UsageError) as error:
                self.note(f"no run was begun: {error}")
        elif mode:
            self._join()
        if self.watch:
            monitor.read_only(self._session)

    def _renew_plant(self) -> None:
        """Put the plant of a simulated board up anew; the first time, the board is restarted."""
        if self._plant is not None:
            self._plant.attach(self.board)
            if self.board.session is not self._session:
                self._open(self.board.session)

    def begin(self) -> None:
        """Begin a run in real time on the board's own sensors, disarmed, with the counts and as many signals as the
        link carries."""
        self._armed, self._arming, self._test = False, None, None
        words = self._session.read_parameters()
        period_us = by_name(words)["period_us"]
        frames = monitor.selection(period_us, self._session.system, raw_first=True)
        self._open_run(words, frames, period_us * 1e-6)
        self._session.begin("REALTIME_LIVE", frames=frames)
        self._own_run = True
        self.note(f"run {self._runs} of {self._session.system} began, disarmed")

    def _open_run(self, words: list[int], frames: tuple[str, ...], period_s: float, why_not: str = "") -> None:
        raw = tuple(set(RAW_FRAMES).intersection(frames))
        self._runs += 1
        self._capture = Capture(self._session, raw_frames=raw)
        if not why_not and not raw:
            why_not = "the link has no room for the raw counts at this period: nothing can be compared"
        if not why_not and len(words) != len(table()):
            why_not = "the board has parameters that this version does not know: nothing can be compared"
        params = None if why_not else ControlParams.from_words(control_part(words))
        self._comparison = Comparison(params, why_not)
        self.samples = Samples(self._runs, self._session.system, frames, period_s)

    def _join(self) -> None:
        """Listen to a run that another program, or the arm switch, began."""
        words = self._session.read_parameters()
        frames = selectable(self._session.system)
        self._own_run = False
        why_not = "this run began before the cockpit: a new run is compared"
        self._open_run(words, frames, by_name(words)["period_us"] * 1e-6, why_not)
        self.note("a run was on: the cockpit listens to it")

    # ---- orders ----

    def _heed(self) -> None:
        """Disarm when a stop was asked for, or when the page that holds the board fell silent."""
        if self._stop_asked.is_set():
            while not self._orders.empty():
                _, reply = self._orders.get()
                reply({"good": False, "text": "stopped"})
            self._drop_arming("stopped")
            self._disarm("disarmed: a page asked for a stop")
            self._stop_asked.clear()
        elif self._armed and not self.hold.alive():
            self._disarm("disarmed: the page that armed fell silent")
        elif self._arming is not None and not self.hold.alive():
            self._drop_arming("the page fell silent while it was arming")

    def _disarm(self, why: str) -> None:
        self._armed, self._test = False, None
        self._session.disarm()
        self.note(why)

    def _drop_arming(self, why: str) -> None:
        if self._arming is not None:
            self._arming[1]({"good": False, "text": f"not armed: {why}"})
            self._arming = None

    def _obey(self) -> None:
        if self._arming is not None:
            self._try_to_arm(*self._arming)
        try:
            order, reply = self._orders.get_nowait()
        except queue.Empty:
            return
        if not self.hold.held_by(order.page):
            reply({"good": False, "text": "this page does not hold the board"})
            return
        try:
            self._do(order, reply)
        except PlumbError as error:
            reply({"good": False, "text": str(error)})

    def _do(self, order: Order, reply: Reply) -> None:
        if order.verb == "arm":
            self._begin_arming(order, reply)
            return
        if order.verb == "record":
            self._record(order.on)
        elif order.verb in ("setpoint", "step_test"):
            self._move(order)
        else:
            self._require_disarmed()
            self._do_disarmed(order, reply)
            return
        reply({"good": True, "text": ""})

    def _do_disarmed(self, order: Order, reply: Reply) -> None:
        """Orders that a disarmed board alone takes: they end the run, or keep the loop busy for a while."""
        if self.watch:
            raise UsageError("this cockpit only watches: start it without --watch")
        answer: Answer = {}
        if order.verb in ("parameters", "describe"):
            answer = parameter_orders.read(self._session, order)
        elif order.verb in ("set", "save"):
            self.note(parameter_orders.write(self._session, order))
            self._own_run = False
            self.begin()
        else:
            self._renew_plant()
            self.begin()
        reply({"good": True, "text": "", **answer})

    def _require_disarmed(self) -> None:
        if self._armed or self._arming is not None:
            raise UsageError("the board is armed: stop it first")
        if self.state.get("armed"):
            raise UsageError("the board is armed by another program or by the arm switch: this page only watches it")

    def _begin_arming(self, order: Order, reply: Reply) -> None:
        self._require_disarmed()
        if self.watch or not self._own_run:
            raise UsageError("the run is not this page's: begin a new run, then arm")
        if self._comparison.differs:
            raise UsageError("the board differs from the model: a board that does is not armed")
        self._arm_until_s = self._session.clock() + READY_WAIT_S
        self._arm_next_s = 0.0
        self._arming = order, reply

    def _try_to_arm(self, order: Order, reply: Reply) -> None:
        """One try. The wait for a system that is not ready passes in the loop, where a stop interrupts it."""
        now_s = self._session.clock()
        if now_s < self._arm_next_s:
            return
        self._arm_next_s = now_s + ARM_AGAIN_S
        try:
            if not self.hold.held_by(order.page) or not self.consent():
                raise UsageError("the page fell silent")
            self._session.arm(ready_wait_s=0.0)
        except NackError as error:
            waiting = error.reason == "BLOCKED" and not error.detail & ~WAITED_FOR
            if not waiting or now_s >= self._arm_until_s:
                self._drop_arming(str(error))
        except PlumbError as error:
            self._drop_arming(str(error))
        else:
            self._arming, self._armed, self._seen_armed, self._armed_s = None, True, False, self._session.clock()
            self.note("armed by the page")
            reply({"good": True, "text": "armed"})

    def _move(self, order: Order) -> None:
        """A setpoint, or a step test."""
        if not self._armed or self.samples is None:
            raise UsageError("the setpoint acts on an armed board: arm it first")
        setpoint = setpoint_of(self._session.system)
        if setpoint is None:
            raise UsageError(f"{self._session.system} has no setpoint")
        if order.verb == "setpoint":
            self._test = None
            self._session.set_setpoint(setpoint.raw(order.value))
        else:
            self._test = StepTest(setpoint, order.value, order.seconds)
            self._test.begin(self._session, self.samples)

    def _record(self, on: bool) -> None:
        if on:
            self.recording.start(self._session)
        else:
            self.recording.stop()

    # ---- what the pages see ----

    def _describe(self) -> dict[str, object]:
        seen = self._monitor.snapshot()
        samples, light = self.samples, self._comparison.light(self._session.clock())
        setpoint = setpoint_of(self._session.system) if samples is not None else None
        if seen["mode"] in (None, "IDLE") and not self._comparison.differs:
            light = type(light)("off", "no run is on")
        return {
            "board": self.board.name,
            "image": self._identity.git_hash,
            "unique_id": self._identity.unique_id,
            "mismatch": self._identity.mismatch or "",
            "watch": self.watch,
            "light": {"colour": light.colour, "text": light.text},
            "armed": bool(seen["armed"]),
            "armed_here": self._armed,
            "arming": self._arming is not None,
            "own_run": self._own_run,
            "speed": round(self._pace.speed, 2),
            "run": None if samples is None else {
                "number": samples.number,
                "system": samples.system,
                "period_s": samples.period_s,
                "columns": [{"name": column.name, "unit": column.unit} for column in samples.columns],
            },
            "tilt_about": None if samples is None else tilt_axis(samples.system),
            "setpoint": None if setpoint is None else {
                "unit": setpoint.unit, "most": setpoint.most, "signal": setpoint.follows
            },
            "test": None if self._test is None else self._test.state,
            "recording": self.recording.state,
            "health": {name: seen[name] for name in HEALTH},
        }  # fmt: skip


def tilt_axis(system: str) -> str:
    """The body axis, x, y or z, that the tilt of a system turns about: that of its first gyro; "" without one."""
    axes = (channel.axis for channel in declarations.system(system).channels)
    return next((axis[-1] for axis in axes if "gyr_" in axis), "")


HEALTH = (
    "time_s", "mode", "live", "step", "steps_per_s", "blocked", "faults", "disarm_cause", "saturated_steps",
    "starved_steps", "board_rejected", "board_lost", "board_dropped", "host_rejected", "host_lost", "host_lost_steps",
    "can_off_bus", "can_transmit_errors", "can_receive_errors", "can_bus_offs", "attitude",
)  # fmt: skip
"""What a page shows of a snapshot of plumb.link.monitor."""
