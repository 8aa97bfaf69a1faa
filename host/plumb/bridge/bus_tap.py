"""Show the frames of a bridge on a bus of its own, for loggers and analysers. They only listen: what they send is
discarded and counted, so that no tool can move what the bridge has armed."""

from __future__ import annotations

import time
from collections.abc import Callable

import can

from plumb.errors import LinkError
from plumb.spec.protocol import Frame

MOST_DISCARDED = 100
"""Frames of the listeners that one call discards: a talkative one must not hold up the bridge."""


class BusTap:
    """Sends frames to `bus`; a bus that fails is given up. discarded: number of frames that listeners have sent."""

    def __init__(self, bus: can.BusABC, say: Callable[[str], None] = lambda text: None) -> None:
        self.discarded = 0
        self._bus: can.BusABC | None = bus
        self._say = say

    def send(self, frames: list[Frame]) -> None:
        """Send frames as they passed the bridge."""
        now_s = time.time()

        def pass_on(bus: can.BusABC) -> None:
            for identifier, data in frames:
                message = can.Message(timestamp=now_s, arbitration_id=identifier, data=data, is_extended_id=False)
                bus.send(message, timeout=0.0)

        self._do(pass_on)

    def serve(self) -> None:
        """Let listeners come and go; call it often."""
        for _ in range(MOST_DISCARDED):
            before = self.discarded
            self._do(self._discard)
            if self.discarded == before:
                return

    def _discard(self, bus: can.BusABC) -> None:
        self.discarded += bus.recv(0) is not None

    def _do(self, action: Callable[[can.BusABC], None]) -> None:
        if self._bus is None:
            return
        try:
            action(self._bus)
        except (LinkError, can.CanError, OSError, ValueError) as error:
            self._say(f"the frames are no longer served: {str(error).partition(chr(10))[0]}")
            self._bus = None
