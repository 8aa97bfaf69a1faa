"""Keys that a person presses while a command runs: read one by one, without Enter and without waiting."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Iterator
from typing import Any

ESCAPE = "\x1b"


class Keyboard:
    """The terminal at stdin. `pressed` gives the keys since the last call, none where stdin is no terminal."""

    def __init__(self) -> None:
        self._descriptor: int | None = None
        self._before: list[Any] | None = None  # Any: what termios.tcgetattr returns

    def __enter__(self) -> Keyboard:
        """Switch line editing and echo off. Ctrl-C stays a signal; Ctrl-Z is off, as it leaves a half-drawn screen."""
        with contextlib.suppress(ImportError, OSError, ValueError, AttributeError):
            import termios  # absent on Windows: no keys there
            import tty

            descriptor = sys.stdin.fileno()
            if not os.isatty(descriptor) or _in_background(descriptor):
                return self
            self._before = termios.tcgetattr(descriptor)
            tty.setcbreak(descriptor)
            now = termios.tcgetattr(descriptor)
            now[6][termios.VSUSP] = b"\0"
            termios.tcsetattr(descriptor, termios.TCSADRAIN, now)
            self._descriptor = descriptor
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            import termios

            with contextlib.suppress(OSError, termios.error):  # the terminal may be gone
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._before)
        self._before = self._descriptor = None

    def pressed(self) -> Iterator[str]:
        """One character for each key, ESCAPE for Esc; cursor and function keys are left out."""
        while self._descriptor is not None and select.select([self._descriptor], [], [], 0)[0]:
            try:
                data = os.read(self._descriptor, 64)
            except OSError:
                data = b""
            if not data:  # the terminal has closed
                self._descriptor = None
            text = data.decode(errors="ignore")
            if text == ESCAPE or not text.startswith(ESCAPE):
                yield from text


def _in_background(descriptor: int) -> bool:
    """Whether another job has the terminal: changing its modes would then stop this process."""
    try:
        return os.tcgetpgrp(descriptor) != os.getpgrp()
    except OSError:  # not the terminal that controls this process
        return False
