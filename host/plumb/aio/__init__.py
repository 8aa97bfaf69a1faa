"""Boards in asyncio: `plumb.connect` for programs with an event loop.

    async with plumb.aio.connect("serial:/dev/ttyUSB0") as board:
        await board.params.set("pid.kp", 0.05)
        async with board.armed():
            async for sample in board.stream(seconds=5):
                await board.set_setpoint(10.0 if sample.time_s > 2 else 0.0)

A thread for each board talks to it, with the same code as `plumb.connect`; the loop never waits for the link. That
thread keeps nothing alive of its own: every keep-alive of an armed board has to be confirmed by the event loop at that
moment, and the task that armed must not have ended.
"""

from __future__ import annotations

from plumb.aio.board import Board, connect
from plumb.aio.parameters import Parameters
from plumb.aio.samples import Samples

__all__ = ["Board", "Parameters", "Samples", "connect"]
