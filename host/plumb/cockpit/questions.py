"""Questions of pages that take a while, answered in a thread of their own.

The loop goes on meanwhile, and with it the keep-alives of an armed board.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from plumb.cockpit.arming import Answer, Reply
from plumb.errors import PlumbError

WAITING_MAX = 8


class Questions:
    """At most WAITING_MAX at a time, one after the other."""

    def __init__(self) -> None:
        self._worker = ThreadPoolExecutor(1, "questions")
        self._room = threading.Semaphore(WAITING_MAX)

    def ask(self, question: Callable[[], Answer], reply: Reply) -> None:
        """Call reply with what the question returns, or with why there is no answer."""
        if not self._room.acquire(blocking=False):
            reply({"good": False, "text": "too many questions wait: try again"})
            return

        def answer() -> None:
            try:
                reply({"good": True, "text": "", **question()})
            except PlumbError as error:
                reply({"good": False, "text": str(error)})
            finally:
                self._room.release()

        self._worker.submit(answer)

    def end(self) -> None:
        """Drop what waits."""
        self._worker.shutdown(wait=False, cancel_futures=True)
