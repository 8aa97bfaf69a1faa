"""Checks of boards before any is opened: their names, and the programs and files that they need."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from plumb.errors import UsageError
from plumb.link.endpoint_names import LocalBoard, ProgramName, parse_board


def require_boards(names: Sequence[str], image: Path | None = None) -> None:
    """Refuse boards that cannot be opened, so that a long check does not find out at its end.

    A port or a bus is not tried: only opening it shows whether a board answers.

    Args:
        names: Boards as the command line names them.
        image: Flash image of board `virtual`.

    Raises:
        UsageError: A name is unknown, the image is missing, damaged, or for no board that was named, or a
            program cannot be run.
    """
    boards = [parse_board(name) for name in names]
    virtual = any(isinstance(board, LocalBoard) and board.kind == "virtual" for board in boards)
    if image is not None and not virtual:
        raise UsageError(f"image {image} is for board virtual: name virtual among the boards, or leave the image out")
    for board in boards:
        if isinstance(board, ProgramName):
            _require_program(board.command[0])
        elif isinstance(board, LocalBoard) and board.kind == "qemu":
            from plumb.boards.qemu import QemuBoard

            QemuBoard(board.core)  # looks for program and image; starts nothing
    if virtual:
        from plumb.boards.virtual_machine import require_simulator
        from plumb.flash.image import find_image, load_own_image

        load_own_image(find_image(image))
        require_simulator()


def _require_program(command: str) -> None:
    if shutil.which(command) is None:
        raise UsageError(f"cannot run {command}: there is no such program; name one as in program:./port")
