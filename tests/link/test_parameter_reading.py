"""Reading the parameter table from a board that answers a request in part."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from plumb.errors import LinkError
from plumb.link.parameter_transfer import Conversation, ParameterTransfer
from plumb.spec import parameters
from plumb.spec.protocol import Frame, protocol

COUNT = len(parameters.table())


class Part:
    """A board whose link carries so many values for each request; after `most` of them nothing comes."""

    def __init__(self, values: int, most: int = COUNT) -> None:
        self.protocol = protocol()
        self.identity = {"PARAMETER_COUNT": COUNT}
        self.counters = SimpleNamespace(repeated_requests=0)
        self.listening = SimpleNamespace(timeout=self.timeout)
        self._values, self._most, self._next, self._left = values, most, 0, 0

    def timeout(self, _seconds: float) -> Any:
        board = self

        class Timeout:
            @property
            def over(self) -> bool:
                return not board._left

            def renew(self) -> None:
                """As long as values come."""

        return Timeout()

    def frame(self, name: str, *words: int, flags: int = 0) -> Frame:
        message = self.protocol[name]
        return message.identifier, message.pack(0, flags, *words)

    def send(self, frames: Sequence[Frame]) -> None:
        assert len(frames) == 1
        self._left = min(self._values, self._most - self._next)

    def receive(self, timeout_s: float) -> list[Frame]:
        self._left -= 1
        self._next += 1
        row = parameters.table()[self._next - 1]
        return [self.frame("PARAM_VALUE", self._next - 1, row.default & 0xFFFFFFFF)]


def read(board: Part) -> list[int]:
    return ParameterTransfer(cast(Conversation, board)).read()


def test_requests_that_bring_a_part_are_repeated_until_the_table_is_whole() -> None:
    board = Part(7)
    assert read(board) == [row.default for row in parameters.table()]
    assert board.counters.repeated_requests == -(-COUNT // 7) - 1


def test_requests_that_bring_nothing_new_end_in_a_sentence() -> None:
    with pytest.raises(LinkError, match=rf"only 20 of {COUNT} parameters came back: check the cable"):
        read(Part(7, most=20))
