"""A board of this process behind a cable that a test cuts, plugs in again, and puts another board behind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import can
import pytest

from plumb.api import connection, reconnection
from plumb.boards.link import LinkBoard
from plumb.boards.native.mcu import NativeCanBus
from plumb.link.session import Session
from plumb.link.transports.byte_stream import ClosedError
from plumb.spec.protocol import Frame
from support.native_board import UartBoard


class CutBus(NativeCanBus):
    """A CAN bus whose interface is unplugged while `cable` is cut."""

    def __init__(self, cable: Cable) -> None:
        super().__init__(cable.board.mcu)
        self._cable = cable

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        self._cable.check()
        return super().read_frames(timeout_s)

    def write_frames(self, frames: Sequence[Frame]) -> None:
        self._cable.check()
        super().write_frames(frames)


class Cable:
    """The cable to a board of this process: what a host opens, and a test cuts."""

    def __init__(self, link: str) -> None:
        self.link, self.cut, self.opened = link, False, 0
        self.board = UartBoard()
        self.board.sensors()

    def check(self) -> None:
        if self.cut:
            raise ClosedError("the cable is out: plug it in")

    def open(self, *_: object, **__: object) -> LinkBoard:
        self.check()
        self.opened += 1
        over: can.BusABC
        if self.link == "can":
            over = CutBus(self)
            return LinkBoard("memory", Session.over(over))
        return LinkBoard("memory", Session.open(self))

    # ---- the UART ----

    def clock_s(self) -> float:
        return self.board.clock_s()

    def read(self, size: int) -> bytes:
        self.check()
        return self.board.read(size)

    def write(self, data: bytes) -> int:
        self.check()
        return self.board.write(data)

    def plug_in_again(self, after_us: int = 300_000) -> None:
        """Time in which the board receives nothing, then the cable is whole."""
        self.board.received()
        self.board.run_us(after_us)
        self.board.received()
        self.board.mcu.can_receive()
        self.cut = False

    def another_board(self) -> None:
        self.board = UartBoard(seed=2)
        self.board.sensors()
        self.cut = False

    def laid(self, monkeypatch: pytest.MonkeyPatch) -> Self:
        """Every name of a board is this one, and no attempt to reach it again has to wait."""
        monkeypatch.setattr(connection, "open_board", self.open)
        monkeypatch.setattr(connection, "open_link_board", self.open)
        monkeypatch.setattr(reconnection, "RECONNECT_INTERVAL_S", 0.001)
        return self
