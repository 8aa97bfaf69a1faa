"""Notice that work which has to keep up with real time does not, and say so once, and once when it does again."""

from __future__ import annotations

from collections.abc import Callable

WINDOW_S = 3.0
"""Time over which the speed is measured: a short stall is no news."""
SLOW, WELL = 0.95, 0.99
"""Below SLOW the work counts as slower than real time, above WELL as keeping up again."""


class RealTimeWatch:
    """Call `note` with the work done and the work due so far, in any unit; `say` gets a sentence when that changes."""

    def __init__(self, what: str, remedy: str, say: Callable[[str], None], clock: Callable[[], float]):
        """what: subject of the sentence ("the virtual board"). remedy: what the user can do about it."""
        self._what, self._remedy, self._say, self._clock = what, remedy, say, clock
        self._since: tuple[float, float, float] | None = None
        self.slow = False

    def note(self, done: float, due: float) -> None:
        now_s = self._clock()
        if self._since is None:
            self._since = now_s, done, due
        begin_s, done_then, due_then = self._since
        if now_s - begin_s < WINDOW_S or due <= due_then:
            return
        share = (done - done_then) / (due - due_then)
        self._since = now_s, done, due
        if share < SLOW and not self.slow:
            self.slow = True
            self._say(f"{self._what} runs at {100 * share:.0f} % of real time: {self._remedy}")
        elif share > WELL and self.slow:
            self.slow = False
            self._say(f"{self._what} runs in real time again")
