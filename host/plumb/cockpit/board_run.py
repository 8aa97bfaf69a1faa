"""The run of the board that the cockpit looks at: begun, joined, followed, compared with the model, and noticed to be
over."""

from __future__ import annotations

import queue
import time
from collections import deque
from pathlib import Path
from typing import Protocol

from plumb.boards.link import LinkBoard
from plumb.cockpit.arming import Arming, Reply
from plumb.cockpit.green_light import Comparison
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.recording import Recording
from plumb.cockpit.samples import Samples
from plumb.cockpit.setpoint import StepTest, setpoint_of
from plumb.cockpit.speed import BoardSpeed, Pace
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.link import monitor
from plumb.link.identity import NackError
from plumb.link.realtime import Capture, SetpointReports
from plumb.link.selection import RAW_FRAMES, selectable
from plumb.link.session import Session
from plumb.spec import dbc
from plumb.spec.parameter_file import by_name
from plumb.spec.parameters import control_part, table
from plumb.spec.protocol import Frame

TURN_S = 0.01
"""Longest wait for a frame in one turn of the loop."""
FIRST_STATUS_S = 1.0
"""Longest wait for the first STATUS, which says whether a run is on."""
IDLE_S = 0.5
"""A board that says so for this long has no run on."""
FOREIGN_S = 0.12
"""A board that names another run than the cockpit's for this long has one: TIME comes every 50 ms, and the last one of
the run before may come after the begin of the next."""
FOUND_S = 0.05
"""The board finds the digital sensors of a plant that was set up anew within this time of its own."""
NOTES_KEPT = 50
ORDERS_MAX = 32
"""Orders that wait; the loop does one a turn."""
JOINED = "this run is not the cockpit's: a run that it begins is compared"


class PlantOnBoard(Protocol):
    """Puts a simulated plant on the pins of a board, at the beginning of a run."""

    def attach(self, board: LinkBoard) -> None: ...


class BoardRun:
    """One board and its runs, in the thread of the loop. watch: only listen to the run that is on. samples: of the
    newest run, which other threads read, as they read `notes`."""

    def __init__(
        self, board: LinkBoard, hold: Hold, folder: Path, plant: PlantOnBoard | None, *, watch: bool, command: str
    ) -> None:
        self.board, self.hold, self.watch = board, hold, watch
        self.notes: deque[tuple[float, str]] = deque(maxlen=NOTES_KEPT)
        self.samples: Samples | None = None
        self.recording = Recording(folder, command, self.note)
        self._orders: queue.SimpleQueue[tuple[Order, Reply]] = queue.SimpleQueue()
        self._plant = plant
        self._arming = Arming(hold, self.note)
        self._own_run = False
        self._words: list[int] = []
        self._learnt = 0
        self._test: StepTest | None = None
        self._result: object = None
        self._runs = 0
        self._capture: Capture | None = None
        self._comparison = Comparison(None, "no run is on")
        self._open(board.session)

    @property
    def reports(self) -> list[Path]:
        """The reports of recordings that are written."""
        return self.recording.reports

    def order(self, order: Order, reply: Reply) -> None:
        """Queue an order of a page; reply is called in another thread."""
        if self._orders.qsize() >= ORDERS_MAX:
            reply({"good": False, "text": "too many orders wait: try again"})
            return
        self._orders.put((order, reply))

    def note(self, text: str) -> None:
        """A line in the log of the page."""
        self.notes.append((time.time(), text))

    def _open(self, session: Session) -> None:
        """Take over a session: at the start, and after the board was restarted."""
        self._session = session
        self._idle, self._foreign = session.listening.timeout(IDLE_S), session.listening.timeout(FOREIGN_S)
        self._identity = session.identity or session.connect()
        self.recording.of(self.board)
        session.consent = self._arming.consent
        session.listener = self._feed
        self._monitor = monitor.Monitor(session)
        self._pace, self._speed = Pace(session.clock()), BoardSpeed()

    def _feed(self, frames: list[Frame]) -> None:
        self._monitor.feed(frames)
        if self._capture is not None:
            self._capture.feed(frames)
        self.recording.feed(frames, self._session.clock())

    def _follow(self) -> None:
        """Rows, comparison, step test, and what the steps say about arming."""
        capture, samples, now_s = self._capture, self.samples, self._session.clock()
        if capture is None or samples is None:
            return
        session = self._session
        self._comparison.follow(capture, session.counters.lost + session.frames.rejected, now_s)
        samples.take(capture, self._comparison.words)
        self._learn(capture)
        self._notice_end(session)
        if self._capture is not capture:
            return
        if self.recording.state["on"]:
            capture.ask_for_table()
        if self._arming.armed and self._comparison.differs:
            self._arming.disarm(session, f"disarmed: {self._comparison.light(now_s).text}")
        self._arming.notice(session, capture.armed)
        armed = self._arming.armed
        if self._test is not None and (done := self._test.follow(session, samples, armed)) is not None:
            self._test, self._result = None, done.get("result")
            self.note(str(done["text"]))
        if not self._own_run and samples.is_over(capture):
            self._open_run(self._words, selectable(session.system), samples.period_s, joined=True)

    def _notice_end(self, session: Session) -> None:
        """Notice that the run of the cockpit is over although it was not ended here: the board was restarted, or
        another host ended the run or began one. Nothing begins by itself then."""
        if session.telemetry.get("STATUS", {}).get("mode", 1) != 0:
            self._idle.renew()
        if session.telemetry.get("TIME", {}).get("run_tag", 0) in (0, session.run_tag):
            self._foreign.renew()
        if self._own_run and self._foreign.over:
            self._test = None
            self._arming.over("another host has begun a run")
            self.note("the run ended: another host has begun one")
            self._join()
        elif self._own_run and self._idle.over:
            self._own_run, self._test = False, None
            self._arming.over("the run ended")
            self.note("the run ended: the board was restarted, or another host ended it; New run begins another one")

    def _learn(self, capture: Capture) -> None:
        """Take the table that came into use last, whoever wrote it."""
        changes = capture.tables.changes
        if len(changes) > self._learnt and (words := changes[-1].words) is not None:
            self._learnt = len(changes)
            rows = table()
            self._words = [rows[i].from_word(word) if i < len(rows) else word for i, word in enumerate(words)]

    # ---- beginning and joining ----

    def _begin_or_join(self) -> None:
        """Begin a run on an idle board, else listen to the run that is on."""
        if self._plant is not None:
            self._renew_plant()
            self.begin()
            return
        status = self._session.listening.timeout(FIRST_STATUS_S)
        while "STATUS" not in self._session.telemetry and not status.over:
            self._session.receive(TURN_S)
        mode = self._session.telemetry.get("STATUS", {}).get("mode", 0)
        if not mode and not self.watch:
            try:
                self._renew_plant()
                self.begin()
            except (NackError, UsageError) as error:
                self.note(f"no run was begun: {error}")
        else:
            self._join()
        if self.watch:
            monitor.read_only(self._session)

    def _renew_plant(self) -> None:
        """Put the plant of a simulated board up anew, here or in the process that serves it; the first time, one that
        is simulated here is restarted."""
        if self._plant is not None:
            self._plant.attach(self.board)
            if self.board.session is not self._session:
                self._open(self.board.session)
        elif (served := self._session.fast) is not None and served.set_up_plant():
            found = self._session.listening.timeout(FOUND_S)
            while not found.over:
                self._session.receive(TURN_S)

    def begin(self) -> None:
        """Begin a run in real time on the board's own sensors, disarmed, with the counts and as many signals as the
        link carries."""
        self._arming.over("a new run began")
        self._test = self._result = None
        self._words = words = self._session.read_parameters()
        self.recording.parameters(words)
        period_us = by_name(words)["period_us"]
        frames = self._selection(period_us)
        self._open_run(words, frames, period_us * 1e-6)
        self._session.begin("REALTIME_LIVE", frames=frames)
        self._own_run = True
        self._idle.renew()
        self._foreign.renew()
        self.note(f"run {self._runs} of {self._session.system} began, disarmed")

    def _selection(self, period_us: int) -> tuple[str, ...]:
        return monitor.selection(period_us, self._session.system, raw_first=True)

    def _open_run(self, words: list[int], frames: tuple[str, ...], period_s: float, *, joined: bool = False) -> None:
        raw = tuple(set(RAW_FRAMES).intersection(frames))
        self._note_result()
        self._runs += 1
        why_not = JOINED if joined else ""
        reports = SetpointReports(from_begin=not joined)
        self._capture, self._learnt = Capture(self._session, raw_frames=raw, setpoints=reports), 0
        if not why_not and not raw:
            why_not = "the link has no room for the raw counts at this period: nothing can be compared"
        if not why_not and len(words) != len(table()):
            why_not = "the board has parameters that this version does not know: nothing can be compared"
        params = None if why_not else ControlParams.from_words(control_part(words))
        self._comparison = Comparison(params, why_not)
        setpoint = setpoint_of(self._session.system)
        column = None if setpoint is None else setpoint.column
        computed = () if params is None else dbc.frame_names(self._session.system)
        self.samples = Samples(self._runs, self._session.system, frames, period_s, column, computed)

    def _note_result(self) -> None:
        """Tell the recording what the comparison of the newest run has shown."""
        if self._capture is not None and self._capture.steps:
            self.recording.run_ended(self._comparison.result())

    def _join(self) -> None:
        """Listen to a run that another program, or the arm switch, began."""
        self._words = self._session.read_parameters()
        self._own_run = False
        period_s = by_name(self._words)["period_us"] * 1e-6
        self._open_run(self._words, selectable(self._session.system), period_s, joined=True)
        self.note("the cockpit listens to the runs of others")
