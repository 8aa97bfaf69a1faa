"""The armed time of a board, from the order of a page to its end.

The board may be armed by the hand of one page alone: the one that holds it and gave the order. When that page falls
silent or gives up the hold, or when any page asks for a stop, consent ends at once: the session then answers no
keep-alive value any more, and the loop disarms the board.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from plumb.cockpit.hold import Hold
from plumb.errors import PlumbError
from plumb.link.identity import NackError
from plumb.link.listening import BoardWait, Listening
from plumb.link.session import BLOCKED_IMPLAUSIBLE, BLOCKED_NOT_READY, READY_WAIT_S, Session

Answer = dict[str, object]
"""The answer to an order of a page: `good`, `text`, and the data that it asked for."""
Reply = Callable[[Answer], None]

AGAIN_S = 0.05
"""Pause between two tries to arm while the board is not ready."""
SEEN_S = 1.0
"""A board that took ARM says so in its steps within this time of listening."""
WAITED_FOR = BLOCKED_NOT_READY | BLOCKED_IMPLAUSIBLE
"""Reasons that pass by themselves when the board is at rest: arming waits for that."""


class Arming:
    """armed: by this program; waiting: for a board that is not ready. say: called with what the pages should know.
    Other threads call `stop` and `consent`; everything else belongs to the loop."""

    def __init__(self, hold: Hold, say: Callable[[str], None]) -> None:
        self.armed = False
        self._hold, self._say = hold, say
        self._stop_asked = threading.Event()
        self._hand: int | None = None
        self._reply: Reply | None = None
        self._seen, self._next_s = False, 0.0
        self._waited = BoardWait({}, lambda: 0.0)
        self._said_so = Listening(lambda: 0.0).timeout(0.0)

    @property
    def waiting(self) -> bool:
        return self._reply is not None

    def stop(self) -> None:
        """Ask for a stop; consent ends with this call."""
        self._stop_asked.set()

    def consent(self) -> bool:
        """Whether the board may be armed, or stay so: by the hand of a page that is alive and holds it. Another page
        that takes the hold does not take over an armed board."""
        return self._hand is not None and self._hold.alive(self._hand) and not self._stop_asked.is_set()

    # ---- the loop's ----

    def begin(self, page: int, reply: Reply, session: Session) -> None:
        """Arm by the hand of a page; `follow` does it, and reply is called with the result."""
        self._hand, self._reply = page, reply
        self._waited, self._next_s = BoardWait(session.telemetry, session.clock), 0.0

    def heed(self, session: Session) -> bool:
        """Disarm without consent. Returns whether a stop was asked for, which is done then."""
        if self._stop_asked.is_set():
            self.drop("stopped")
            self.disarm(session, "disarmed: a page asked for a stop")
            self._stop_asked.clear()
            return True
        if not self.consent():
            self.drop("the page fell silent while it was arming")
            if self.armed:
                self.disarm(session, "disarmed: the page that armed fell silent")
        return False

    def forget_stop(self) -> None:
        """There is no link over which a board could be stopped, and none is armed."""
        self._stop_asked.clear()

    def follow(self, session: Session) -> None:
        """Try to arm, if that is ordered. The wait for a board that is not ready passes in the loop, where a stop
        interrupts it."""
        now_s = session.clock()
        if self._reply is None or now_s < self._next_s:
            return
        self._next_s = now_s + AGAIN_S
        try:
            session.arm(ready_wait_s=0.0)
        except NackError as error:
            waits = error.reason == "BLOCKED" and not error.detail & ~WAITED_FOR
            if not waits or self._waited.over(READY_WAIT_S):
                self.drop(str(error))
        except PlumbError as error:
            self.drop(str(error))
        else:
            reply, self._reply = self._reply, None
            self.armed, self._seen, self._said_so = True, False, session.listening.timeout(SEEN_S)
            self._say("armed by the page")
            reply({"good": True, "text": "armed"})

    def notice(self, session: Session, steps_say_armed: bool) -> None:
        """Notice a board that disarmed itself. steps_say_armed: what its newest step says."""
        if not self.armed:
            return
        if session.holding.another:  # its arming is not this page's to end
            self.armed = False
            self._say(f"not armed any more: {session.holding.over}")
            return
        self._seen = self._seen or steps_say_armed
        if (self._seen and not steps_say_armed) or (not self._seen and self._said_so.over):
            self.disarm(session, f"the board disarmed itself{session.listening.unread_text}; Health says why")

    def disarm(self, session: Session, why: str) -> None:
        """Disarm, whoever armed."""
        self.armed = False
        session.disarm()
        self._say(why)

    def drop(self, why: str) -> None:
        """End the wait of arming."""
        reply, self._reply = self._reply, None
        if reply is not None:
            reply({"good": False, "text": f"not armed: {why}"})

    def over(self, why: str) -> None:
        """The armed time ended with its run or its link."""
        self.armed = False
        self.drop(why)
