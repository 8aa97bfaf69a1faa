"""Handle SIGINT and SIGTERM: raise them at once, or defer them until links and runs are closed."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import NoReturn


class Terminated(KeyboardInterrupt):
    """SIGTERM: ends a command as Ctrl-C does, in good order, with an exit code of its own."""


raised: list[KeyboardInterrupt] = []
"""Exceptions that signals have raised so far. A library may replace one: numpy raises ImportError instead."""


def ending_of(number: int) -> KeyboardInterrupt:
    """The exception that SIGINT or SIGTERM is raised as, noted in `raised`."""
    raised.append(Terminated() if number == signal.SIGTERM else KeyboardInterrupt())
    return raised[-1]


def raise_at_once(number: int, _frame: FrameType | None) -> None:
    """The handler of SIGINT and SIGTERM while a command runs."""
    raise ending_of(number)


def raise_ending(caught: Sequence[int]) -> NoReturn:
    """Raise the first deferred signal, after everything is closed."""
    raise ending_of(caught[0] if caught else signal.SIGINT)


@contextlib.contextmanager
def endings() -> Iterator[list[int]]:
    """Defer SIGINT and SIGTERM inside the `with` block; gives the list of those received, in order."""
    caught: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    old = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
