"""Pack and unpack the messages of the link: layout, CRC-8 and counter, as raw integers.

The DBC (`plumb.spec.dbc`) is the only definition: every position, width and sign used here is read from it through
cantools. A frame is `(identifier, data)` with eight bytes of data. The scales and units of the DBC serve people and
other tools; plumb works with the raw integers, so that nothing is rounded.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.spec import dbc

if TYPE_CHECKING:
    from cantools.database.can import Database

DBC_PATH = Path(__file__).with_name("messages.dbc")
"""The DBC of the systems of this package for other tools, with every flag as a signal: `plumb.spec.tool_dbc`."""
FRAME_DLC = 8
CRC8_POLYNOMIAL = 0x2F

Frame = tuple[int, bytes]


def _crc8_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ _CRC8_MIRRORED if byte & 1 else byte >> 1
    return byte


_CRC8_MIRRORED = int(f"{CRC8_POLYNOMIAL:08b}"[::-1], 2)
CRC8_TABLE = bytes(_crc8_of(byte) for byte in range(256))
"""table[crc ^ byte] is the next CRC, least significant bits first."""


@lru_cache(maxsize=2048)
def crc8_start(identifier: int, dlc: int = FRAME_DLC) -> int:
    """CRC-8 after the identifier (0..0x7FF, two bytes, big-endian) and the length."""
    crc = CRC8_TABLE[0xFF ^ identifier >> 8]
    crc = CRC8_TABLE[crc ^ identifier & 0xFF]
    return CRC8_TABLE[crc ^ dlc]


def crc8(identifier: int, data: bytes) -> int:
    """The CRC-8 that belongs into byte 0. data: all bytes of the frame; byte 0 is ignored.

    The CRC runs over the last byte first, down to byte 1, so that the payload is one code word in the bit order of CAN
    and every burst of up to 8 bits is detected (docs/reference/protocol.md, "A frame").
    """
    crc = crc8_start(identifier, len(data))
    table = CRC8_TABLE
    for byte in data[:0:-1]:
        crc = table[crc ^ byte]
    return crc ^ 0xFF


def check(identifier: int, data: bytes) -> bool:
    """True if the frame has eight bytes and the right CRC."""
    return len(data) == FRAME_DLC and data[0] == crc8(identifier, data)


@dataclass(frozen=True)
class Message:
    """One message: its words in order (bytes 2 to 7) and its flags (high nibble of byte 1: shift, width)."""

    name: str
    identifier: int
    sender: str
    words: tuple[str, ...]
    flags: dict[str, tuple[int, int]]
    layout: struct.Struct
    choices: dict[str, dict[int, str]] = field(default_factory=dict)

    def pack(self, counter: int, flags: int, *words: int) -> bytes:
        """Eight sealed bytes from raw integers; raises struct.error for an integer that does not fit."""
        body = self.layout.pack(0, (counter & 15) | flags << 4, *words)
        return bytes((crc8(self.identifier, body),)) + body[1:]

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """(crc, counter and flags, words...) as raw integers."""
        return self.layout.unpack(data)

    def decode(self, data: bytes) -> dict[str, int]:
        """Name -> raw integer, flags included."""
        _, second, *values = self.layout.unpack(data)
        named = {name: second >> 4 + shift & (1 << width) - 1 for name, (shift, width) in self.flags.items()}
        named.update(zip(self.words, values, strict=True))
        return named

    def choice(self, signal: str, value: int) -> str:
        """The DBC's name for a value; the number as text if it has none."""
        return self.choices.get(signal, {}).get(value, str(value))

    def value(self, signal: str, choice: str) -> int:
        """The value that the DBC gives a name; raises KeyError for an unknown name."""
        for number, name in self.choices.get(signal, {}).items():
            if name == choice:
                return number
        raise KeyError(choice)


def load_database(path: Path | None = None) -> Database:
    """The DBC of a file, or of all systems (path None), as cantools reads it."""
    return database_of(dbc.text() if path is None else path.read_text(encoding="utf-8"))


def database_of(text: str) -> Database:
    """The DBC of this text, as cantools reads it."""
    import cantools

    database = cantools.database.load_string(text, "dbc", strict=True)
    assert isinstance(database, cantools.database.can.Database)
    return database


def message_of(definition: object) -> Message:
    """The layout of one cantools message; raises ValueError if it breaks a rule that all frames follow."""
    from cantools.database.can import Message as Definition

    assert isinstance(definition, Definition)
    name = definition.name
    if definition.length != FRAME_DLC or definition.is_extended_frame or definition.frame_id > 0x7FF:
        raise ValueError(f"{name}: every message has a standard identifier and eight bytes")
    signals = sorted(definition.signals, key=lambda signal: signal.start)
    if any(signal.byte_order != "little_endian" for signal in signals):
        raise ValueError(f"{name}: every signal is in Intel order")
    shape = [(signal.name, signal.start, signal.length, signal.is_signed) for signal in signals]
    if shape[:2] != [("crc8", 0, 8, False), ("counter", 8, 4, False)]:
        raise ValueError(f"{name}: byte 0 is crc8, and the low half of byte 1 the counter")
    flags = {n: (start - 12, length) for n, start, length, _ in shape[2:] if start < 16}
    words = shape[2 + len(flags) :]
    if [(start, length) for _, start, length, _ in words] not in ([(16, 16), (32, 32)], [(16, 16), (32, 16), (48, 16)]):
        raise ValueError(f"{name}: bytes 2 to 7 are one 16-bit and one 32-bit word, or three 16-bit words")
    codes = {(16, False): "H", (16, True): "h", (32, False): "I", (32, True): "i"}
    choices = {s.name: {int(k): str(v) for k, v in s.choices.items()} for s in signals if s.choices}
    return Message(
        name,
        definition.frame_id,
        definition.senders[0],
        tuple(n for n, *_ in words),
        flags,
        struct.Struct("<BB" + "".join(codes[length, signed] for _, _, length, signed in words)),
        choices,
    )


def canonical_text(database: Database) -> str:
    """The text that the DBC hash is taken over: one line for each message, signal and named value, without comments.

    Messages are sorted by identifier, signals by first bit, values by number. Format: docs/reference/protocol.md,
    "Versions".
    """
    lines = [f"version {database.version}"]
    for definition in sorted(database.messages, key=lambda message: message.frame_id):
        lines.append(f"message {definition.frame_id} {definition.name} {definition.length} {definition.senders[0]}")
        for signal in sorted(definition.signals, key=lambda signal: signal.start):
            sign = "signed" if signal.is_signed else "unsigned"
            scale, offset = float(signal.scale), float(signal.offset)
            lines.append(
                f"signal {signal.name} {signal.start} {signal.length} {signal.byte_order} {sign} "
                f"{scale!r} {offset!r} {signal.unit or '-'}"
            )
            for number, name in sorted((signal.choices or {}).items()):
                lines.append(f"value {number} {name}")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Protocol:
    """All messages of the DBC. version: of the protocol; dbc_hash: CRC-32 of canonical_text()."""

    version: int
    dbc_hash: int
    messages: dict[str, Message]
    by_identifier: dict[int, Message]

    def __getitem__(self, name: str) -> Message:
        return self.messages[name]

    def known(self, frames: Iterable[Frame]) -> Iterator[tuple[Message, bytes]]:
        """The message of each of the frames and its eight bytes; frames that it has not are left out."""
        for identifier, data in frames:
            message = self.by_identifier.get(identifier)
            if message is not None:
                yield message, data


def protocol_of(database: Database) -> Protocol:
    messages = [message_of(definition) for definition in database.messages]
    return Protocol(
        int(database.version or 0),
        zlib.crc32(canonical_text(database).encode()),
        {message.name: message for message in messages},
        {message.identifier: message for message in messages},
    )


@lru_cache(maxsize=1)
def protocol() -> Protocol:
    """The protocol of this version of plumb, read at the first call because parsing the DBC is slow."""
    return protocol_of(load_database())
