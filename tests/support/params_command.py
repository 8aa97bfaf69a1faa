"""`plumb params` as a user types it, on a board that outlives each command, as one on a cable does."""

from __future__ import annotations

import pytest

from plumb import __main__ as front
from plumb.link.session import Session
from plumb.spec import parameters
from support.native_board import UartBoard


def params(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the command on the board of the fixture `board`."""
    code = front.main(["params", *arguments, "--board", "memory"])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def in_use(board: UartBoard) -> dict[str, int]:
    """The board's parameters by name."""
    with Session.open(board) as session:
        return dict(zip((row.name for row in parameters.table()), session.read_parameters(), strict=True))
