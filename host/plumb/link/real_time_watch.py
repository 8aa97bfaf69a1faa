"""Notice that work which has to keep up with real time does not, and say so once, and once when it does again."""

from __future__ import annotations

from collections.abc import Callable

WINDOW_S = 3.0
"""Time over which the speed is measured: a short stall is no news."""
SLOW, WELL = 0.95, 0.99
"""Below SLOW the work counts as slower than real time, above WELL as keeping up again."""


class RealTimeWatch:
    """Call `note` with the work done and the work due so far, in any unit; `say` gets a sentence when that changes."""

    def __init__(
        self,
        what: str,
        remedy: str,
        say: Callable[[str], None],
        clock: Callable[[], float],
        window_s: float = WINDOW_S,
    ):
        """what: subject of the sentence ("the virtual board"). remedy: what the user can do about it. share: of the
        work due, what was done in the window that ended last; None before the first."""
        self._what, self._remedy, self._say, self._clock, self._window_s = what, remedy, say, clock, window_s
        self._since: tuple[float, float, float] | None = None
        self.slow = False
        self.share: float | None = None

    def note(self, done: float, due: float) -> None:
        now_s = self._clock()
        if self._since is None:
            self._since = now_s, done, due
        begin_s, done_then, due_then = self._since
        if now_s - begin_s < self._window_s or due <= due_then:
            return
        self.share = share = (done - done_then) / (due - due_then)
        self._since = now_s, done, due
        if share < SLOW and not self.slow:
            self.slow = True
            self._say(f"{self._what} runs at {100 * share:.0f} % of real time: {self._remedy}")
        elif share > WELL and self.slow:
            self.slow = False
            self._say(f"{self._what} runs in real time again")
