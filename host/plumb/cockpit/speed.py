"""How fast a simulated board runs, as a share of real time: of this process, or served by another one."""

from __future__ import annotations

import time

from plumb.boards import debugging

OVER_S = 1.0
"""Time over which a speed is measured."""
BEHIND_S = 0.1
"""A simulation that is further behind does not try to catch up."""
RESTARTED_S = 60.0
"""A clock of the board that goes on by more from one TIME to the next, which come every 50 ms, began anew."""


class Pace:
    """Holds a simulation back to real time. speed: of the last second, 1 for real time. It does not catch up."""

    def __init__(self, now_s: float) -> None:
        self._begin_s, self._begin_wall_s = now_s, debugging.wall_s()
        self._speed_s, self._speed_wall_s = self._begin_s, self._begin_wall_s
        self.speed = 1.0

    def keep(self, now_s: float, most_s: float) -> None:
        """Sleep for as long as the simulation is ahead, but at most most_s. now_s: its time."""
        wall_s = debugging.wall_s()
        ahead_s = (now_s - self._begin_s) - (wall_s - self._begin_wall_s)
        if ahead_s < -BEHIND_S:
            self._begin_s, self._begin_wall_s = now_s, wall_s
        if wall_s - self._speed_wall_s >= OVER_S:
            self.speed = (now_s - self._speed_s) / (wall_s - self._speed_wall_s)
            self._speed_s, self._speed_wall_s = now_s, wall_s
        time.sleep(min(max(0.0, ahead_s), most_s))


class BoardSpeed:
    """The speed of a board's own clock, by its TIME. speed: over the last second or more, 1 until it is known."""

    def __init__(self) -> None:
        self.speed = 1.0
        self._last_us: int | None = None
        self._since: tuple[float, float] | None = None
        self._board_s = 0.0

    def follow(self, time_us: int | None, now_s: float) -> None:
        """time_us: of the newest TIME, None before the first; now_s: by the clock of this computer."""
        if time_us is None or time_us == self._last_us:
            return
        passed_s = 0.0 if self._last_us is None else (time_us - self._last_us & 0xFFFFFFFF) * 1e-6
        self._last_us, self._board_s = time_us, self._board_s + passed_s
        if self._since is None or passed_s > RESTARTED_S:
            self._since = self._board_s, now_s
        elif now_s - self._since[1] >= OVER_S:
            self.speed = (self._board_s - self._since[0]) / (now_s - self._since[1])
            self._since = self._board_s, now_s
