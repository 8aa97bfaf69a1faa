"""The transmitter and the receiver on the board: sticks of a page become frames of CRSF on the receiver's line.

The receiver gets 150 frames a second, all with the newest sticks. A page that has sent none for LOST_S is a lost
receiver: nothing is sent until it speaks again. A browser that was closed, is hidden or hangs is such a page.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from plumb.spec import crsf

FRAME_S = 1.0 / 150.0
LOST_S = 0.1
"""After this long without a message from the page, by the clock of this machine, the receiver gets no frames."""


@dataclass(frozen=True)
class Sticks:
    """roll, pitch, yaw: -1 to 1, right side down, nose down, to the left; throttle: 0 to 1; on: the motors'
    switch; rate: the switch of the mode."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    throttle: float = 0.0
    on: bool = False
    rate: bool = False


class Transmitter:
    """One thread says what the sticks are, another one takes the frames. sticks: as they were sent last; off: the
    switch of the motors counts as off until the page itself says so, at the beginning and after a stop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.sticks, self.off = Sticks(), True
        self._clock = clock
        self._said = Sticks(), float("-inf")
        self._next_s = self._silent_s = 0.0
        self._time_s = 0.0

    def accept_sticks(self, sticks: Sticks) -> None:
        """Take the stick positions that the next frames send."""
        self._said = sticks, self._clock()
        self.off = self.off and sticks.on

    def begin(self) -> None:
        """Another trip, whose time begins at 0."""
        self.sticks, self.off = Sticks(), True
        self._next_s = self._silent_s = self._time_s = 0.0

    def silence(self, seconds: float) -> None:
        """Send nothing for so long, in time of the trip."""
        self._silent_s = self._time_s + seconds

    @property
    def silenced(self) -> bool:
        return self._time_s < self._silent_s

    @property
    def receiving(self) -> bool:
        """Whether the receiver gets frames."""
        return not self.silenced and self._clock() - self._said[1] <= LOST_S

    def frames(self, time_s: float) -> bytes:
        """The bytes that the receiver sends to the board at this time of the trip."""
        self._time_s = time_s
        if time_s < self._next_s or not self.receiving:
            return b""
        self._next_s = max(self._next_s + FRAME_S, time_s)
        said = self._said[0]
        self.sticks = sticks = replace(said, on=False) if self.off else said
        return crsf.sticks(
            roll=sticks.roll, pitch=sticks.pitch, throttle=sticks.throttle, yaw=sticks.yaw, on=sticks.on,
            rate=sticks.rate,
        )  # fmt: skip
