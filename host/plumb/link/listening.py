"""How long a host listened to a link, and for how long the link has brought nothing.

Silence means that the link brings nothing, not that this process does not read: on a busy computer, or behind slow
work, a second may pass between two reads of a link on which everything waits. So time passes here only while a read
waits, and of a read at most the wait that was asked for. A board that is simulated on a busy computer is slow, not
silent: while its frames come, a time-out passes in the board's own time, which TIME carries. Every time-out of a host
for frames that a board should send is measured here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

LATEST = 20
"""A time-out is over after this many times its length by the clock: a host that never catches up with its link, so that
no read ever waits, is not let wait for ever."""
UNREAD_S = 0.03
"""A link that was left unread for longer may have cost an armed board its keep-alive: of its values, which live 40 ms
from their issue and come every 10 ms, the answers are late then."""
RESTARTED_S = 60.0
"""A clock of the board that goes on by more from one TIME to the next, which come every 50 ms, began anew."""
SHORTEST_S = 1e-6
"""Less than this is nothing: it may vanish in the rounding of a sum."""
TIME_EVERY_S = 0.05
"""The board sends TIME this often, by its own clock."""
JITTER_S = 0.005
"""Two TIMEs may be this much nearer to each other: the board sends each between two turns of its loop."""
NEWEST_TIMES = 8
"""Number of TIMEs over which the newest slowness is measured: a board may become slow long after its link was
opened."""


class Listening:
    """The time spent on reads of one link. clock: of the link, simulated for a simulated board. total_s: waited so
    far; quiet_s: of that, since the last read that brought something of the board. unread_s: the longest time for which
    this process did not read when it should have, between two reads or because one ended late; whoever measures it sets
    it to 0. board_s: the time that has passed for the board, by its TIMEs; None before the first of them."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.total_s = self.quiet_s = self.unread_s = 0.0
        self._end_s = clock()
        self.board_s: float | None = None
        self._last_us = 0
        self._since: deque[tuple[float, float]] = deque(maxlen=NEWEST_TIMES)
        self._first = self._newest = 0.0, 0.0

    def note(self, asked_s: float, begin_s: float, brought: bool) -> None:
        """A read has ended. asked_s: the longest wait that was asked for; begin_s: when it began; brought: whether it
        brought something."""
        before_s, self._end_s = self._end_s, self.clock()
        self.unread_s = max(self.unread_s, begin_s - before_s, self._end_s - begin_s - asked_s)
        waited_s = max(0.0, min(self._end_s - begin_s, asked_s))
        self.total_s += waited_s
        self.quiet_s = 0.0 if brought else self.quiet_s + waited_s

    def board_says(self, time_us: int) -> None:
        """TIME has come: the board's clock is at this count."""
        passed_s = (time_us - self._last_us & 0xFFFFFFFF) * 1e-6
        restarted = self.board_s is None or passed_s > RESTARTED_S
        self.board_s = (self.board_s or 0.0) + (0.0 if restarted else passed_s)
        self._last_us, self._newest = time_us, (self.total_s, self.board_s)
        if restarted:
            self._first = self._newest
            self._since.clear()
        self._since.append(self._newest)

    @property
    def slowness(self) -> float:
        """How many seconds of listening a second of the board takes, 1 to LATEST: the larger of the mean since its
        first TIME and of the mean over the newest of them. A board that is simulated at a tenth of real time sends
        nothing for ten times as long, and is not silent."""
        listened_s, board_s = self._newest
        since = (self._first, *self._since)[:2]
        slow = [(listened_s - begin_s) / (board_s - at_s) for begin_s, at_s in since if board_s > at_s]
        return min(max([1.0, *slow]), LATEST)

    def silent(self, seconds: float) -> bool:
        """Whether the link has brought nothing of the board for so long, as the board's time passes."""
        return self.quiet_s >= seconds * self.slowness

    @property
    def unread_text(self) -> str:
        """A possible cause for the end of an arming, to follow the board's reason; "" when the link was read."""
        return f", as this computer left the link unread for {self.unread_s:.2f} s" if self.unread_s > UNREAD_S else ""

    def timeout(self, seconds: float) -> Timeout:
        """A time-out that begins now."""
        return Timeout(self, seconds)


class Timeout:
    """A time-out of so many seconds of listening and, while the board's frames come, of the board's own time."""

    def __init__(self, listening: Listening, seconds: float) -> None:
        self._listening, self._seconds = listening, seconds
        self.renew()

    def renew(self, seconds: float | None = None) -> None:
        """Begin again, for as long as before or for so many seconds."""
        listening = self._listening
        self._seconds = self._seconds if seconds is None else seconds
        self._begin_s, self._latest_s = listening.total_s, listening.clock() + LATEST * self._seconds
        self._board_begin_s = listening.board_s

    @property
    def left_s(self) -> float:
        """Remaining time; for a board that is behind its time, until it sends TIME again. 0 when it is over."""
        listening = self._listening
        if listening.clock() >= self._latest_s:
            return 0.0
        left_s = self._seconds - (listening.total_s - self._begin_s)
        if left_s > SHORTEST_S:
            return left_s
        return TIME_EVERY_S if self._board_is_behind else 0.0

    @property
    def _board_is_behind(self) -> bool:
        """Less time than this has passed for a board that is not silent."""
        listening = self._listening
        if listening.board_s is None or listening.silent(self._seconds):
            return False
        passed_s = listening.board_s - (self._board_begin_s or 0.0)
        return passed_s < self._seconds - JITTER_S

    @property
    def over(self) -> bool:
        return self.left_s == 0.0


class BoardWait:
    """A wait for seconds of the board's own time: one that is simulated at a tenth of real time is ready ten times
    later. telemetry: a session's, with TIME; clock: of its link. The wait also ends after LATEST times its length by
    the clock, and when the board was restarted."""

    def __init__(self, telemetry: Mapping[str, Mapping[str, int]], clock: Callable[[], float]) -> None:
        self._telemetry, self._clock = telemetry, clock
        self._begin_us, self._begin_s = self._now_us(), clock()

    def _now_us(self) -> int | None:
        said = self._telemetry.get("TIME")
        return None if said is None else said["time"]

    def over(self, seconds: float) -> bool:
        """Whether so many seconds have passed since it began."""
        now_us = self._now_us()
        if self._begin_us is None or now_us is None:
            self._begin_us = now_us
            return seconds <= 0.0 or self._clock() - self._begin_s >= LATEST * seconds
        passed_s = (now_us - self._begin_us & 0xFFFFFFFF) * 1e-6
        return passed_s >= seconds or self._clock() - self._begin_s >= LATEST * seconds
