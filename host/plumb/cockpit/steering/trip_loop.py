"""The loop of a trip: board, vehicle and receiver in simulated time, held back to real time.

A trip begins on the ground, is recorded from its beginning once it is armed, and is over when the vehicle stands still
again, disarmed or without anybody who steers it. Then its record and the report are written, and another one may begin.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from plumb import systems
from plumb.boards import debugging
from plumb.boards.link import LinkBoard
from plumb.cockpit.board_run import BoardRun
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.speed import Pace
from plumb.cockpit.steering.arming import in_the_way, why_disarmed
from plumb.cockpit.steering.rivals import Rivals
from plumb.cockpit.steering.steered_boards import NATIVE, SteeredBoard, steered_board
from plumb.cockpit.steering.transmitter import Sticks, Transmitter
from plumb.contract.parameters import quantise
from plumb.errors import PlumbError, UsageError
from plumb.link.selection import raw_frames_of
from plumb.link.session import Session
from plumb.readers.log_file import TRUE_PLACE
from plumb.spec import declarations
from plumb.systems.steered import Event, Quaternion, Steered, SteeredVehicle, part_of, steered

TURN_US = 5000
MOST_SLEEP_S = 0.01
STATE_EVERY_S = 0.1
REST_S = 1.5
"""The trip is over when the vehicle has stood still for this long."""
WAIT_S = 120.0
"""A trip that has not been armed for this long begins anew, so that its record does not begin with hours of rest."""
LOST, LOST_S = "lost", 3.0
LOST_EVENT = Event("Receiver lost", f"the receiver gets no signal for {LOST_S:g} s", LOST_S)
NEW, HAPPEN = "run", "happen"
CHIP_HZ = 72e6
PICTURE_S = 1.0
"""Sticks of a page whose newest picture is older than this are ignored: its user does not see what he steers."""


class _Vehicles:
    """Puts the vehicle of each trip on the pins of the board."""

    def __init__(self, steered: Steered, seed: int, on: SteeredBoard) -> None:
        self._steered, self._seed, self._on = steered, seed, on
        self.vehicle = self._drawn()

    def _drawn(self) -> SteeredVehicle:
        return self._steered.vehicle(self._seed, period_us=self._on.period_us)

    def attach(self, _board: LinkBoard) -> None:
        self.vehicle = self._drawn()
        self._on.attach(self.vehicle)


class TripLoop(BoardRun):
    """Trips of one system. Other threads call `accept_sticks`, `order` and `stop`; they read `scene`, `state`, `notes`.

    board: native, or virtual with this flash image. paced: hold the trip back to real time; without it, it is as fast
    as the machine. trips: that have been armed.
    """

    def __init__(
        self,
        system: str,
        seed: int,
        hold: Hold,
        *,
        folder: Path,
        command: str = "",
        paced: bool = True,
        board: str = NATIVE,
        image: Path | None = None,
    ) -> None:
        self._steered = steered(system)
        self.transmitter = Transmitter()
        self._steered_board = steered_board(board, system, self.transmitter.frames, image)
        self._vehicles = _Vehicles(self._steered, seed, self._steered_board)
        self.scene: dict[str, object] = {}
        self.state: dict[str, object] = {}
        self.trips = 0
        self._passed_s = self._took_s = 0.0
        self._paced = paced
        self._begun_s = self._stated_s = 0.0
        self._rests_s: float | None = None
        self._went = self._over = self._closed = False
        self._was_armed = self._disarmed = False  # by itself, while the switch has been on
        self._period_us = self._steered_board.period_us
        params = quantise(replace(self._steered.TUNING, period_us=self._period_us))
        self._estimated = 0
        self._attitude: Quaternion | None = None
        self._begin_estimates()
        try:
            self._steered_board.configure(
                params,
                **params.link_words(),
                **systems.load(system).LINK,
                period_us=self._period_us,
                receiver=1,
                calibrated=1,  # the simulated sensors are those of the tuning
                arm_hold_ms=0,  # the simulated motors need no arming pulse
            )
        except PlumbError:
            self._steered_board.board.close()
            raise
        super().__init__(self._steered_board.board, hold, folder, self._vehicles, watch=False, command=command)

    # ---- called by other threads ----

    def accept_sticks(self, page: int, sticks: Sticks) -> None:
        """Take stick positions from a page. Ignored unless it controls the vehicle and its pictures are fresh."""
        if self.hold.alive(page):
            self.transmitter.accept_sticks(sticks)

    def stop(self) -> None:
        """The switch of the motors goes off, and stays so until the page that holds the vehicle has it off, too."""
        self.transmitter.off = True

    # ---- the loop ----

    def run(self, stopped: Callable[[], bool]) -> None:
        """Go on until stopped() is true; the record of a trip that is on is written then."""
        try:
            self._begin_or_join()
            while not stopped():
                self.turn()
        finally:
            self.close()

    def close(self) -> None:
        """End the trip that is on, write its record and its report, and close the board."""
        if self._closed:
            return
        self._closed = True
        if self._own_run:
            self._finish()
        self.recording.wait()
        self._session.listener = None
        self.board.close()

    @property
    def noun(self) -> str:
        """The noun for a trip."""
        return self._steered.CONTROLS.trip

    @property
    def speed(self) -> float:
        """Speed of all trips so far, as a share of real time."""
        return self._passed_s / self._took_s if self._took_s else 1.0

    def turn(self) -> None:
        begin_s, wall_s = self._session.clock(), debugging.wall_s()
        settled = begin_s - self._begun_s > self._steered.SETTLED_S
        self._obey()
        # In one piece: a wait for the first frame would look at the line every 100 us.
        self._steered_board.pass_us(TURN_US)
        self._session.receive(0.0)
        if self._over:  # the board's idle time is nobody's run
            self.transmitter.off = True
        else:
            self._follow()
            self._judge()
        now_s = self._session.clock()
        if self.samples is not None:
            rows, self._estimated = self.samples.since(self._estimated, self._steered.ESTIMATED)
            self._attitude = self._estimate.follow(rows)
            self._rivals.follow(self.samples, self._vehicles.vehicle, moves=self._armed)
        self._look()
        if now_s - self._stated_s >= STATE_EVERY_S or not self.state:
            self._stated_s = now_s
            self.state = self._describe()
        if not settled:
            self._pace = Pace(now_s)  # real time begins here: the sensors settle as fast as the machine lets them
            return
        if self._paced:
            self._pace.keep(now_s, MOST_SLEEP_S)
        self._passed_s, self._took_s = self._passed_s + now_s - begin_s, self._took_s + debugging.wall_s() - wall_s

    def begin(self) -> None:
        self.transmitter.begin()
        super().begin()
        self._rests_s = None
        self._begin_estimates()
        self._went = self._over = self._was_armed = self._disarmed = False
        self._begun_s = self._session.clock()
        self._pace = Pace(self._begun_s)

    def _begin_estimates(self) -> None:
        self._rivals = Rivals(self._steered, self._period_us)
        self._estimate = self._steered.estimate(self._period_us * 1e-6)
        self._estimated, self._attitude = 0, None

    def _selection(self, period_us: int) -> tuple[str, ...]:
        return (*raw_frames_of(self._session.system), *self._steered.FRAMES)

    def _open(self, session: Session) -> None:
        super()._open(session)
        session.consent = lambda: True  # the receiver and its switch decide, in the board

    @property
    def _armed(self) -> bool:
        return self._capture is not None and self._capture.armed

    def _judge(self) -> None:
        """The beginning of a record, and the end of a trip."""
        now_s, armed = self._session.clock(), self._armed
        self._disarmed = self.transmitter.sticks.on and (self._disarmed or (self._was_armed and not armed))
        self._was_armed = armed
        if armed and not self._went:
            self._went = True
            self.trips += 1
            self.recording.start(self.board, self._words)
        if not self._went and now_s - self._begun_s > WAIT_S:
            self._renew_plant()
            self.begin()
            return
        steered = self.transmitter.receiving or self.transmitter.silenced
        over = self._went and self._vehicles.vehicle.at_rest() and not (self._armed and steered)
        self._rests_s = (self._rests_s or now_s) if over else None
        if self._rests_s is not None and now_s - self._rests_s > REST_S:
            self._finish()

    def _finish(self) -> None:
        """End the trip, and write its record."""
        if self._over:
            return
        self._over = True
        compared = self._comparison.ended()
        if self._armed:
            self._session.disarm()
        elif self._went:
            self.note(f"disarmed: {why_disarmed(self._session)}")
        self._session.end()
        self._own_run = False
        if self._went:
            self.note(f"{self.noun} {self.trips} is over")
        self.recording.run_ended(compared)
        self.recording.stop()

    # ---- orders ----

    def _obey(self) -> None:
        try:
            order, reply = self._orders.get_nowait()
        except queue.Empty:
            return
        try:
            self._do(order)
        except PlumbError as error:
            reply({"good": False, "text": str(error)})
        else:
            reply({"good": True, "text": ""})

    def _do(self, order: Order) -> None:
        if not self.hold.held_by(order.page):
            raise UsageError("this page does not hold the vehicle")
        if order.verb == NEW:
            self._finish()
            self._renew_plant()
            self.begin()
        elif self._over:
            raise UsageError(f"the {self.noun} is over: begin a new one")
        elif order.name == LOST:
            self.transmitter.silence(LOST_EVENT.seconds)
            self.note(LOST_EVENT.text)
        else:
            self._vehicles.vehicle.happen(order.name)
            self.note(self._steered.EVENTS[order.name].text)

    # ---- what the pages see ----

    @property
    def events(self) -> list[dict[str, object]]:
        """Events that have a button on the page."""
        own = self._steered.EVENTS.items()
        return [{"name": name, "label": event.label, "text": event.text} for name, event in (*own, (LOST, LOST_EVENT))]

    def _look(self) -> None:
        seen, sticks = self._vehicles.vehicle.seen(), self.transmitter.sticks
        if not self._over:
            place = dict(zip(TRUE_PLACE, seen.position_m, strict=True))
            self.recording.truth(place, self._session.clock())
        self.scene = {
            "time_s": round(self._session.clock() - self._begun_s, 3),
            "position": _rounded(seen.position_m, 4),
            "velocity": _rounded(seen.velocity_mps, 3),
            "attitude": _rounded(seen.attitude, 5),
            "estimate": None if self._attitude is None else _rounded(self._attitude, 5),
            "wind": None if seen.wind_mps is None else _rounded(seen.wind_mps, 2),
            "motors": _rounded(seen.motors, 3),
            "turned": _rounded(seen.turned_rad, 3),
            "readings": _rounded(seen.readings, 3),
            "armed": self._armed,
            "happening": list(self._vehicles.vehicle.happening()),
            "rivals": self._rivals.verticals,
            "sticks": [sticks.roll, sticks.pitch, sticks.yaw, sticks.throttle],
        }

    @property
    def _why(self) -> str:
        """Why the switch does not turn the motors on; "" while it is off, or they are on."""
        if not self.transmitter.sticks.on or self._armed:
            return ""
        return f"disarmed: {why_disarmed(self._session)}" if self._disarmed else in_the_way(self._session)

    def _describe(self) -> dict[str, object]:
        light = self._comparison.light(self._session.clock())
        newest = {} if self.samples is None else self.samples.newest()
        on = list(self._vehicles.vehicle.happening())
        return {
            "board": self.board.name,
            "system": self._session.system + ("" if self.board.name == NATIVE else f" on {self.board.name}"),
            "light": {"colour": light.colour, "text": light.text},
            "armed": self._armed,
            "why": self._why,
            "settled": self._session.clock() - self._begun_s >= self._steered.SETTLED_S,
            "said": self._steered.said(newest, self.transmitter.receiving),
            "receiving": self.transmitter.receiving,
            "on": self.transmitter.sticks.on,
            "rate": self.transmitter.sticks.rate,
            "speed": round(self._pace.speed, 2),
            "over": self._over,
            "run": self._runs,
            "happening": [*on, *([LOST] if self.transmitter.silenced else [])],
            "recording": self.recording.state,
            "reports": [path.name for path in self.recording.reports],
        }

    @property
    def _chip_share(self) -> float | None:
        """Share of the chip that the system's step takes at most; None without a budget."""
        cycles = declarations.system(self._session.system).cycles
        return None if cycles is None else cycles / (CHIP_HZ * self._period_us * 1e-6)

    def drawing(self) -> dict[str, object]:
        """Data that a page needs once: the drawing of the vehicle, and its events."""
        drawing, controls = self._steered.DRAWING, self._steered.CONTROLS
        return {
            "command": part_of(self._session.system).name,
            "title": declarations.system(self._session.system).title,
            "shapes": [shape.__dict__ for shape in drawing.shapes],
            "motors": drawing.motors,
            "readings": [reading._asdict() for reading in drawing.readings],
            "estimate": drawing.estimate,
            "away_m": drawing.away_m,
            "controls": controls.__dict__,
            "events": self.events,
            "chip_share": self._chip_share,
        }


def _rounded(values: tuple[float, ...], digits: int) -> list[float]:
    return [round(value, digits) for value in values]
