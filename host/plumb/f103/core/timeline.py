"""Simulated time in integer ticks, and the events planned in it.

A tick is 1/40320 us: 560 ticks are one cycle at 72 MHz, 630 at 64 MHz, 5040 at 8 MHz. The cycle of every PLL setting
with an 8 MHz crystal, except x11 and x13, is a whole number of ticks, so that rounding lets no clock drift against
another.
"""

from __future__ import annotations

from collections.abc import Callable

TICKS_PER_US = 40320
TICKS_PER_S = TICKS_PER_US * 1_000_000
NEVER = 1 << 62


class Timeline:
    """Planned events by name, a few at a time. An event function gets the time at which it was due, which may be up to
    one instruction or one exception entry before the processor's present time."""

    def __init__(self, sooner: Callable[[int], None]) -> None:
        """sooner(time) is called when a new event becomes the next one, so that a running slice ends by then."""
        self._due: dict[str, tuple[int, Callable[[int], None]]] = {}
        self._sooner = sooner
        self.next = NEVER

    def at(self, name: str, time: int, event: Callable[[int], None]) -> None:
        """Plan `event` at `time`; replaces an event of the same name."""
        old = self._due.get(name)
        self._due[name] = (time, event)
        if time < self.next:
            self.next = time
            self._sooner(time)
        elif old is not None and old[0] == self.next:
            self._find_next()

    def cancel(self, name: str) -> None:
        old = self._due.pop(name, None)
        if old is not None and old[0] == self.next:
            self._find_next()

    def clear(self) -> None:
        self._due.clear()
        self.next = NEVER

    def run_due(self, now: int) -> None:
        """Run all events due by `now` in order of time; those of equal time in the order they were planned."""
        while self.next <= now:
            time = self.next
            name = next(name for name, entry in self._due.items() if entry[0] == time)
            event = self._due.pop(name)[1]
            self._find_next()
            event(time)

    def _find_next(self) -> None:
        self.next = min([entry[0] for entry in self._due.values()], default=NEVER)
