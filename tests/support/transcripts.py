"""Frames as text for a board in memory, and its answers by name."""

from __future__ import annotations

from plumb.link.board_frames import PERIODIC
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.spec.protocol import Frame, protocol
from support.native_board import UartBoard


def frame(name: str, *words: int, counter: int = 0, flags: int = 0) -> bytes:
    message = protocol()[name]
    return text_of_frames([(message.identifier, message.pack(counter, flags, *words))])


def said(text: bytes) -> list[tuple[str, dict[str, int]]]:
    """The frames in an answer, by name and raw integers, without the periodic ones."""
    messages = protocol().by_identifier
    frames: list[Frame] = SlcanParser().feed(text)
    named = [(messages[identifier].name, messages[identifier].decode(data)) for identifier, data in frames]
    return [entry for entry in named if entry[0] not in PERIODIC]


def begin(board: UartBoard, run: str) -> None:
    number = protocol()["RUN_BEGIN"].value("run", run)
    nonce = said(board.say(frame("CHALLENGE", number, 0)))[0][1]["nonce"]
    assert said(board.say(frame("RUN_BEGIN", number, nonce)))[0][0] == "ACK"
