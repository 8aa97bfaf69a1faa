"""The board of tests of commands: it outlives each command, as one on a cable does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from plumb.boards.link import LinkBoard
from plumb.link.session import Session
from support.native_board import UartBoard


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> UartBoard:
    """The board that every --board names, and folders of its own for what plumb keeps."""
    memory = UartBoard()

    def opened(_spec: str, **_options: Any) -> LinkBoard:
        return LinkBoard("memory", Session.open(memory))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    kept: Path = tmp_path_factory.mktemp("kept")
    for place in ("CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{place}_HOME", str(kept / place))
    return memory
