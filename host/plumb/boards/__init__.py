"""Boards: everything that can run the control step, with one interface.

`fixed` is the integer model in Python, `native` the C core in this process, `qemu` the C core as Cortex-M code,
`virtual` the whole flash image on the simulated STM32F103. `serial:PORT[@BAUD]` and `can:INTERFACE:CHANNEL[@KBIT]` are
the same image on silicon, or on a virtual board that another process serves. `program:COMMAND` is a program of the
user's, which runs whole vectors. Their interface is `contract.StepBoard`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.link.endpoint_names import REMOTE_BOARDS, CanName, LocalBoard, ProgramName, SerialName, parse_board

if TYPE_CHECKING:
    from plumb.boards.contract import StepBoard
    from plumb.boards.link import LinkBoard


def open_board(spec: str, *, link: str = "serial", image: Path | None = None) -> StepBoard:
    """The board that `spec` names. link: serial or can, of `virtual`. image: of `virtual`; None: this checkout's build.

    Raises UsageError for an invalid name, LinkError when the board does not answer.
    """
    name = parse_board(spec)
    if isinstance(name, SerialName):
        from plumb.boards.link import SerialBoard

        return SerialBoard(name)
    if isinstance(name, CanName):
        from plumb.boards.link import CanBoard

        return CanBoard(name)
    if isinstance(name, ProgramName):
        from plumb.boards.program import ProgramBoard

        return ProgramBoard(name.command)
    if name.kind == "fixed":
        from plumb.boards.fixed import FixedBoard

        return FixedBoard()
    if name.kind == "native":
        from plumb.boards.native.board import NativeBoard

        return NativeBoard()
    if name.kind == "qemu":
        from plumb.boards.qemu import QemuBoard

        return QemuBoard(name.core)
    from plumb.boards.virtual import VirtualBoard

    return VirtualBoard(image, link)


def open_link_board(spec: str, *, link: str = "serial", image: Path | None = None) -> LinkBoard:
    """The board that `spec` names; raises UsageError for a board without a link."""
    from plumb.boards.link import LinkBoard

    name = parse_board(spec)
    if isinstance(name, ProgramName) or (isinstance(name, LocalBoard) and name.kind != "virtual"):
        raise UsageError(f"'{spec}' is no board with a link; use virtual, {REMOTE_BOARDS}")
    board = open_board(spec, link=link, image=image)
    assert isinstance(board, LinkBoard)
    return board
