"""A simulated board that waits for its client: its time passes only while the client reads its link.

A process that serves a simulated board on a pty or a TCP port lets its time pass in real time. On a busy machine a
client may not run for longer than a keep-alive lives, and an armed board disarms although nothing is wrong. So a client
of plumb asks the server to wait, by the line WAIT after it opened the link. From then on the server puts the byte MARK
into what the board sends, every MARK_EVERY_S of the board's time, and the client answers each with the byte READ once
it has read, and answered, everything before it. The board's time stands still at LEAD_S after the oldest mark without
an answer. It passes in real time again when the client closes or closes the link (C), and while the client has
answered no mark for PATIENCE_S of wall time.

While a debugger has stopped the board, the server puts the byte STANDS into the line instead, several times a second.
The client's clock stands from then on until the board sends again, so that nothing of it is late meanwhile.

A board that is not simulated answers WAIT with BEL, as any unknown command, and no mark ever comes. Neither byte can be
part of a line. A client asks on TCP and on pseudo-terminals alone: no board behind a serial port sees the line.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable

from plumb.link.transports.byte_stream import SerialStream, SocketStream, Stream

WAIT, SET_UP = b"WAIT", b"SETUP"
"""Lines of a client: wait for it; set the plant up anew."""
MARK, READ = b"\x05", b"\x06"
"""ENQ and ACK of ASCII."""
STANDS = b"\x16"
"""SYN of ASCII."""
MARK_EVERY_S = 0.004
"""The board's time between two marks: a fifth of LEAD_S, so that a round trip does not stop the board."""
LEAD_S = 0.02
"""The most that the board's time passes beyond what the client has read: a keep-alive value lives 40 ms."""
PATIENCE_S = 1.0
"""A client that answers no mark for this long is not waited for: it hangs, and the board must notice."""
STANDS_FOR_S = 5.0
"""A board that stands says so again before this has passed; else its server hangs, and time passes."""
TERMINAL = re.compile(r"/dev/(pts/|ttys)\d+")
"""A pseudo-terminal, as Linux and macOS name it."""


def is_perhaps_served(stream: Stream) -> bool:
    """Whether a process may serve a simulated board at the other end."""
    terminal = isinstance(stream, SerialStream) and TERMINAL.fullmatch(os.path.realpath(stream.name)) is not None
    return terminal or isinstance(stream, SocketStream)


def is_wall_clock(clock: Callable[[], float]) -> bool:
    """True for the clock of a line to another process, which may stand at times; False for simulated time."""
    owner = getattr(clock, "__self__", None)
    return is_wall_clock(owner.line_clock) if isinstance(owner, AnsweringStream) else clock is time.monotonic


class AnsweringStream:
    """The client's side of a stream: takes the marks out of what is read, and answers them with the next read.

    marked: a mark has come: the board is simulated, and waits."""

    def __init__(self, stream: Stream) -> None:
        self._stream, self.name = stream, stream.name
        self.clock: Callable[[], float] = self._time
        self._marks, self.marked = 0, False
        self._stood_s, self._since_s, self._told_s = 0.0, 0.0, 0.0
        self._stands = False

    @property
    def line_clock(self) -> Callable[[], float]:
        """The clock of the line, which never stands."""
        return self._stream.clock

    def _time(self) -> float:
        """Time of the stream in seconds, without that for which the board stood."""
        if self._stands and self._stream.clock() - self._told_s > STANDS_FOR_S:
            self._goes_on(self._told_s)
        return (self._since_s if self._stands else self._stream.clock()) - self._stood_s

    def _goes_on(self, now_s: float) -> None:
        self._stands, self._stood_s = False, self._stood_s + now_s - self._since_s

    def _without_stands(self, data: bytes) -> bytes:
        """What the board sent; notes whether it stands behind that."""
        now_s = self._stream.clock()
        if data.endswith(STANDS):
            self._since_s, self._told_s = (self._since_s if self._stands else now_s), now_s
            self._stands = True
        elif data and self._stands:
            self._goes_on(now_s)
        return data.replace(STANDS, b"")

    def read(self, timeout_s: float) -> bytes:
        end_s = self.clock() + timeout_s
        while True:
            if self._marks:
                self._stream.write(READ * self._marks)
            data = self._without_stands(self._stream.read(max(0.0, end_s - self.clock())))
            self._marks = data.count(MARK)
            if self._marks:
                self.marked, data = True, data.replace(MARK, b"")
            if data or self.clock() >= end_s:
                return data

    def write(self, data: bytes) -> None:
        self._stream.write(data)

    def close(self) -> None:
        self._stream.close()
