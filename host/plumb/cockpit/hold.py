"""Permission to write to the board: the page that holds it has it, for as long as that page is alive and sees the
present.

The server gives every message to a page a tick. The holder sends a heartbeat every 100 ms with the newest tick that it
has drawn, and counts as alive from the time at which the server made that tick. So a page that was closed, that hangs,
or that sees a picture of the past loses an armed board after TIMEOUT_S. Two threads use a Hold.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

TIMEOUT_S = 0.3
"""An armed board is disarmed when its holder was silent for this long."""
TAKEN_OVER_AFTER_S = 3.0
"""Another page may take the hold from a holder that was silent for this long."""
TICKS_KEPT = 1024


class Hold:
    """The hold of one board. holder: number of the page, None while nobody holds it."""

    def __init__(self, timeout_s: float = TIMEOUT_S, clock: Callable[[], float] = time.monotonic) -> None:
        self.timeout_s, self._clock = timeout_s, clock
        self._lock = threading.Lock()
        self._holder: int | None = None
        self._seen_s = 0.0
        self._tick, self._ticks_s = 0, dict[int, float]()

    @property
    def holder(self) -> int | None:
        return self._holder

    def next_tick(self) -> int:
        """The tick for a message that is sent now."""
        with self._lock:
            self._tick = self._tick + 1 & 0xFFFFFFFF
            self._ticks_s[self._tick] = self._clock()
            self._ticks_s.pop(self._tick - TICKS_KEPT & 0xFFFFFFFF, None)
            return self._tick

    def take(self, page: int) -> bool:
        """Give the hold to this page, if it is free or its holder has been silent for long; whether it has it now."""
        with self._lock:
            now_s = self._clock()
            if self._holder not in (None, page) and now_s - self._seen_s < TAKEN_OVER_AFTER_S:
                return False
            if self._holder != page:
                self._holder, self._seen_s = page, now_s
            return True

    def release(self, page: int) -> None:
        """End the hold of this page, if it has it."""
        with self._lock:
            if self._holder == page:
                self._holder = None

    def beat(self, page: int, tick: int) -> None:
        """A heartbeat of a page; one that is not the holder's, or whose tick is not known any more, counts nothing."""
        with self._lock:
            made_s = self._ticks_s.get(tick)
            if page == self._holder and made_s is not None:
                self._seen_s = max(self._seen_s, made_s)

    def held_by(self, page: int) -> bool:
        return self._holder == page

    def alive(self, page: int) -> bool:
        """Whether this page holds the board and sent a heartbeat within the time-out."""
        with self._lock:
            return self._holder == page and self._clock() - self._seen_s <= self.timeout_s
