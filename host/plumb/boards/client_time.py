"""The time of a served board whose client asked it to wait, as `plumb.link.transports.waiting_board` says."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from plumb.f103.core.timeline import TICKS_PER_S
from plumb.link.transports.waiting_board import LEAD_S, MARK, MARK_EVERY_S, PATIENCE_S, READ, SET_UP, WAIT

TURN_MOST_S = 0.01
"""Of the time between two turns of the server, at most this counts as silence of the client: on a machine so busy that
the server itself did not run, the client did not run either."""


class ClientTime:
    """How far the board's time, in ticks, may pass for the client. set_up: sets the plant up anew;
    None: there is none. waits: the client has asked for it."""

    def __init__(self, set_up: Callable[[], object] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._set_up, self._clock = set_up, clock
        self.waits = False
        self._line = b""
        self._marks: deque[int] = deque()
        self._next = 0
        self._silent_s, self._looked_s = 0.0, clock()

    def received(self, data: bytes, now: int) -> bytes:
        """Bytes of the client at this time of the board; returns those for the board, which sees every line."""
        if self.waits and (answers := data.count(READ)):
            data = data.replace(READ, b"")
            self._silent_s = 0.0
            for _ in range(min(answers, len(self._marks))):
                self._marks.popleft()
        *lines, rest = (self._line + data).split(b"\r")
        self._line = rest[-len(SET_UP) - 1 :]
        for line in lines:
            if line == WAIT:
                self.waits, self._next = True, now
            elif line == b"C":
                self.gone()
            elif line == SET_UP and self._set_up is not None:
                self._set_up()
        return data

    def gone(self) -> None:
        """The client has closed."""
        self.waits = False
        self._marks.clear()

    @property
    def _silent(self) -> bool:
        return bool(self._marks) and self._silent_s > PATIENCE_S

    def limit(self, due: int) -> int:
        """The time to which the board may run, when real time would let it run to `due`. Called in every turn."""
        before_s, self._looked_s = self._looked_s, self._clock()
        self._silent_s += min(self._looked_s - before_s, TURN_MOST_S)
        if not self._marks or self._silent:
            return due
        return min(due, self._marks[0] + int(LEAD_S * TICKS_PER_S))

    def mark(self, now: int) -> bytes:
        """What to add to the bytes that the board has sent up to now."""
        if not self.waits or now < self._next or self._silent:
            return b""
        if not self._marks:
            self._silent_s = 0.0
        self._marks.append(now)
        self._next = now + int(MARK_EVERY_S * TICKS_PER_S)
        return MARK
