"""The loop that owns the link to the board: receives, compares, records, and obeys the orders of the pages.

It runs in one thread, and nothing else touches the session. Safety stands on three legs: the session answers the
keep-alive values of an armed board only while `consent` says so, that is, while the page that holds the board is alive
and nobody asked for a stop; the loop disarms the board as soon as consent is gone; and when the loop itself hangs, no
keep-alive is answered at all. In each case the outputs are neutral within 50 ms.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable
from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.cockpit import parameter_orders
from plumb.cockpit.arming import Reply
from plumb.cockpit.board_run import TURN_S, BoardRun, PlantOnBoard
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.questions import Questions
from plumb.cockpit.samples import Samples
from plumb.cockpit.setpoint import StepTest, setpoint_of
from plumb.errors import LinkError, PlumbError, UsageError
from plumb.link import monitor, parameter_table
from plumb.link.session import Session
from plumb.spec import declarations
from plumb.spec.parameter_file import by_name
from plumb.spec.signals import output_columns

STATE_EVERY_S = 0.1
REOPEN_S = 1.0
"""Pause between two tries to open a board whose link was lost."""


class BoardLoop(BoardRun):
    """Turns of one board and the orders of its pages. paced: hold a board that is simulated in this process back to
    real time. reopen: opens the board again after its link was lost; None: a lost link ends the loop. Other threads
    call `order` and `stop`, and read `samples`, `state` and `notes`."""

    _stated_s: float

    def __init__(
        self,
        board: LinkBoard,
        hold: Hold,
        *,
        folder: Path,
        plant: PlantOnBoard | None = None,
        watch: bool = False,
        paced: bool = False,
        reopen: Callable[[], LinkBoard] | None = None,
        command: str = "",
    ) -> None:
        super().__init__(board, hold, folder, plant, watch=watch, command=command)
        self.state: dict[str, object] = {}
        self._paced, self._reopen = paced, reopen
        self._questions = Questions()

    # ---- called by other threads ----

    def stop(self) -> None:
        """Disarm at once. Keep-alives cease with this call, whatever the loop does."""
        self._arming.stop()

    # ---- the loop ----

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve the board until stopped() is true; leaves it disarmed, and ends the run that it began.

        Raises LinkError when the board falls silent and cannot be opened again.
        """
        try:
            while not stopped():
                try:
                    self._begin_or_join()
                    while not stopped():
                        self.turn()
                except LinkError as error:
                    if self._reopen is None:
                        raise
                    self._open_again(self._reopen, str(error), stopped)
        finally:
            self._close()

    def _open_again(self, reopen: Callable[[], LinkBoard], why: str, stopped: Callable[[], bool]) -> None:
        """Close the link that was lost, and try to open the board until that succeeds. What was armed is disarmed by
        the board itself."""
        self._stop_recording()
        self._own_run, self._test, self._capture = False, None, None
        self._arming.over("the link was lost")
        self.note(f"the link was lost: {why}")
        light = {"colour": "off", "text": "no link to the board"}
        self.state = {**self.state, "lost": why, "light": light, "armed": False, "armed_here": False, "arming": False}
        with contextlib.suppress(PlumbError):
            self.board.close()
        while not stopped():
            end_s = time.monotonic() + REOPEN_S
            while time.monotonic() < end_s and not stopped():
                self._refuse_orders("there is no link to the board")
                self._arming.forget_stop()
                time.sleep(TURN_S)
            with contextlib.suppress(LinkError):
                self.board = reopen()
                self._open(self.board.session)
                self.note("the board answers again")
                return

    def turn(self) -> None:
        """One turn: safety and one order, frames, comparison, state."""
        self._obey()
        self._session.receive(TURN_S)
        self._follow()
        now_s = self._session.clock()
        monitor.require_frames(self._session)
        if now_s - self._stated_s >= STATE_EVERY_S or not self.state:
            self._stated_s = now_s
            self.state = self._describe()
        self._speed.follow(self._session.telemetry.get("TIME", {}).get("time"), now_s)
        if self._paced:
            self._pace.keep(now_s, TURN_S)

    def _open(self, session: Session) -> None:
        super()._open(session)
        self._stated_s = 0.0

    def _close(self) -> None:
        self._questions.end()
        self._stop_recording()
        self._session.listener = None
        try:
            if self._arming.armed:
                self._session.disarm()
            if self._own_run:
                self._session.end()
        finally:
            self.board.close()

    # ---- orders ----

    def _refuse_orders(self, why: str) -> None:
        while not self._orders.empty():
            _, reply = self._orders.get()
            reply({"good": False, "text": why})

    def _obey(self) -> None:
        if self._arming.heed(self._session):
            self._refuse_orders("stopped")
        self._arming.follow(self._session)
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
            self._require_armable()
            self._arming.begin(order.page, reply, self._session)
            return
        if order.verb in ("parameters", "describe"):
            armed = self._arming.armed
            words = self._words
            first = self._session.parameters.at_arming if armed else None
            self._questions.ask(lambda: parameter_orders.answer(order, words, armed, first), reply)
            return
        if order.verb == "record":
            self._record(order.on)
        elif order.verb in ("setpoint", "step_test"):
            self._move(order)
        elif order.verb == "set":
            self._set(order)
        else:
            self._require_disarmed()
            self._begin_anew(save=order.verb == "save")
        reply({"good": True, "text": ""})

    def _set(self, order: Order) -> None:
        """Write a parameter. The run goes on when only live gains change; another write ends it, and begins a new
        one."""
        self._require_writable()
        if not self._arming.armed:
            self._require_disarmed()
            self._words = self._session.read_parameters()  # another program may have written, too
        wanted = parameter_orders.write(order, self._words)
        if self._arming.armed:
            parameter_orders.require_armed_change(wanted, self._words, self._session.parameters.at_arming)
        parameter_table.commit(self._session, wanted.values, by_name(self._words))
        self.note(wanted.said)
        if not wanted.live:
            self._own_run = False
            self.begin()

    def _begin_anew(self, save: bool) -> None:
        self._require_writable()
        if save:
            self._session.execute_idle("SAVE")
            self.note("the parameters in use are saved to the board's flash")
            self._own_run = False
        else:
            self._renew_plant()
        self.begin()

    def _require_writable(self) -> None:
        if self.watch:
            raise UsageError("this cockpit only watches: start it without --watch")

    def _require_disarmed(self) -> None:
        if self._arming.armed or self._arming.waiting:
            raise UsageError("the board is armed: stop it first")
        if self.state.get("armed"):
            raise UsageError("the board is armed by another program or by the arm switch: this page only watches it")

    def _require_armable(self) -> None:
        self._require_disarmed()
        if self.watch or not self._own_run:
            raise UsageError("the run is not this page's: begin a new run, then arm")
        if self._comparison.differs:
            raise UsageError("the board differs from the model: a board that does is not armed")

    def _move(self, order: Order) -> None:
        """A setpoint, or a step test."""
        if not self._arming.armed or self.samples is None:
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
            self.recording.start(self.board, self._words)
        else:
            self._stop_recording()

    def _stop_recording(self) -> None:
        self._note_result()
        self.recording.stop()

    # ---- what the pages see ----

    def _setpoint_used(self, scale: float, *, idle: bool) -> float | None:
        """The setpoint that the board's newest step used, as it says itself; None while that is not known."""
        if self._capture is None:
            return None
        used = 0 if idle else self._capture.setpoints.newest
        return None if used is None else used * scale

    def _declared_words(self, samples: Samples) -> dict[str, object]:
        """Choices and flags of the newest step in words, where the model has computed it."""
        words, system = samples.words, samples.system
        return (
            {"choices": monitor.choices_of(words, system), "flags_set": monitor.flags_set(words, system)}
            if words
            else {}
        )

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
            "armed_here": self._arming.armed,
            "arming": self._arming.waiting,
            "own_run": self._own_run,
            "speed": round(self._pace.speed if self._paced else self._speed.speed, 2),
            "run": None if samples is None else {
                "number": samples.number,
                "system": samples.system,
                "period_s": samples.period_s,
                "columns": _columns(samples),
            },
            "tilt_about": None if samples is None else tilt_axis(samples.system),
            "setpoint": None if setpoint is None else {
                "unit": setpoint.unit, "most": setpoint.most, "signal": setpoint.follows,
                "used": self._setpoint_used(setpoint.scale, idle=seen["mode"] == "IDLE"),
            },
            "why_no_setpoint": "" if samples is None or setpoint is not None else why_no_setpoint(samples.system),
            "test": None if self._test is None else self._test.state,
            "result": self._result,
            "recording": self.recording.state,
            "health": {name: seen[name] for name in HEALTH} | (self._declared_words(samples) if samples else {}),
        }  # fmt: skip


def _columns(samples: Samples) -> list[dict[str, object]]:
    """The columns as the page gets them. drives: it moves something while the board is armed."""
    drives = output_columns(samples.system)
    return [{"name": column.name, "unit": column.unit, "drives": column.name in drives} for column in samples.columns]


def why_no_setpoint(system: str) -> str:
    """Why a page cannot arm this system."""
    declared = declarations.system(system)
    if not declared.output:
        return f"{system} drives nothing"
    return f"{system} takes more than a slider: its pilot's switch arms it, or a program (plumb.connect)"


def tilt_axis(system: str) -> str:
    """The body axis, x, y or z, that the tilt of a system turns about: that of its first gyro; "" without one."""
    axes = (channel.axis for channel in declarations.system(system).channels)
    return next((axis[-1] for axis in axes if "gyr_" in axis), "")


HEALTH = (
    "time_s", "mode", "live", "step", "steps_per_s", "blocked", "faults", "disarm_cause", "saturated_steps",
    "starved_steps", "board_rejected", "board_lost", "board_dropped", "host_rejected", "host_lost", "host_lost_steps",
    "battery_v", "battery_a", "battery_trouble", "choices", "flags_set",
    "can_off_bus", "can_transmit_errors", "can_receive_errors", "can_bus_offs", "attitude",
)  # fmt: skip
"""Entries of a snapshot of plumb.link.monitor that a page shows."""
