"""Arms the board when the pilot switches the rotors on, and disarms it when they are switched off.

This is the one place that asks for arming. It is done over the link, by the host that begins the run.
"""

from __future__ import annotations

from plumb.errors import PlumbError
from plumb.link.session import READY_WAIT_S, Session

AGAIN_S = 0.05
"""Pause between two tries to arm while the board is not ready."""


class ArmingBySwitch:
    """why: what the board says against it; "" when nothing is asked for, or it is armed."""

    def __init__(self) -> None:
        self.why = ""
        self._on, self._asked = False, False
        self._next_s = self._until_s = 0.0

    def follow(self, session: Session, on: bool, armed: bool) -> None:
        """on: the pilot's switch; armed: what the board says."""
        now_s = session.clock()
        if on and not self._on:
            self._asked, self._next_s, self._until_s = True, now_s, now_s + READY_WAIT_S
        elif self._on and not on:
            self._asked, self.why = False, ""
            if armed:
                session.disarm()
        self._on = on
        if not self._asked or now_s < self._next_s:
            return
        self._next_s = now_s + AGAIN_S
        try:
            session.arm(ready_wait_s=0.0)
        except PlumbError as error:
            self.why, self._asked = str(error), now_s < self._until_s
        else:
            self.why, self._asked = "", False
