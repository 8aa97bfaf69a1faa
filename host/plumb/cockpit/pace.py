"""How fast time passes on the board: a simulation is held back to real time, and the speed is measured by TIME."""

from __future__ import annotations

import time
from collections.abc import Callable

from plumb.boards.link import LinkBoard
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.session import Session

LAG_S = 0.1
"""A simulation that lags by more than this does not catch up."""
LONGEST_S = 0.01
"""Longest sleep in one turn of the loop."""
SPEED_OVER_S = 3.0
LINK_SPEED_OVER_S = 10.0
"""Over a link TIME is read late by as long as this machine is busy: a longer time of measurement forgives 0.2 s."""
ANEW_S, ANEW = 1.0, 2.0
"""A board whose clock advances by this much more than the time outside was restarted: its clock is 32 bits of us."""


class Pace:
    """Holds a simulation back to real time. It does not catch up."""

    def __init__(self, now_s: float) -> None:
        self._begin_s, self._begin_wall_s = now_s, time.monotonic()

    def keep(self, now_s: float) -> None:
        """Sleep for as long as the simulation is ahead, at most for LONGEST_S. now_s: its time."""
        wall_s = time.monotonic()
        ahead_s = (now_s - self._begin_s) - (wall_s - self._begin_wall_s)
        if ahead_s < -LAG_S:
            self._begin_s, self._begin_wall_s = now_s, wall_s
        time.sleep(min(max(0.0, ahead_s), LONGEST_S))


class BoardSpeed:
    """The speed of a board's time: that of its TIME against the clock of this machine. say: called with a sentence when
    it is measured first, falls below real time, or reaches it again."""

    def __init__(self, board: LinkBoard, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic):
        self._what, self._remedy = board.runs_on or f"the board at {board.name}", board.slow_remedy
        self._over_s = SPEED_OVER_S if board.runs_on else LINK_SPEED_OVER_S
        self._say, self._clock = say, clock
        self._begin()

    def _begin(self) -> None:
        self._watch = RealTimeWatch(self._what, self._remedy, self._say, self._clock, self._over_s)
        self._time_us: int | None = None
        self._board_s = self._wall_s = 0.0

    @property
    def share(self) -> float | None:
        """Of real time; None until it is measured."""
        return self._watch.share

    @property
    def hint(self) -> str:
        """What to do about a slow board; "" for one that keeps up."""
        return self._remedy if self._watch.slow else ""

    def follow(self, session: Session) -> None:
        """Take the newest TIME; to be called in every turn of the loop."""
        said = session.telemetry.get("TIME")
        if said is None or said["time"] == self._time_us:
            return
        wall_s, before_us, before_s = self._clock(), self._time_us, self._wall_s
        self._time_us, self._wall_s = said["time"], wall_s
        if before_us is None:
            return  # nobody knows how old it is
        ahead_s = (said["time"] - before_us & 0xFFFFFFFF) * 1e-6
        if ahead_s > ANEW * (wall_s - before_s) + ANEW_S:
            self._begin()
            return
        self._board_s += ahead_s
        unknown = self._watch.share is None
        self._watch.note(self._board_s, wall_s)
        if unknown and self._watch.share is not None and not self._watch.slow:
            self._say(f"{self._what} runs at {100 * self._watch.share:.0f} % of real time")
