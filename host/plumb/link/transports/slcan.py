"""SLCAN codec: text to frames and back, many at a time.

The grammar is that of firmware/link/slcan.c; a test compares the two. A line ends at CR. BEL also ends a line and makes
it invalid. A frame is 't', three hex digits of identifier (at most 7FF), one of length (0 to 8), two for each byte, and
nothing else. Frames with a wrong CRC are discarded. No input raises an exception.

The usual case (every line is a whole frame) is handled for all lines at once: one split, one unhexlify, and the CRC of
all frames column by column, with `bytes.translate` as the table and big integers for the exclusive or.
"""

from __future__ import annotations

import struct
from binascii import Error as HexError
from binascii import hexlify, unhexlify
from collections import deque
from collections.abc import Iterable, Sequence

from plumb.spec.protocol import CRC8_TABLE, Frame, check

LINE_MAX = 26
"""Longest line without CR; a longer one is discarded."""
_FRAME_CHARS = 21
_FEW = 4
_ENTRY = struct.Struct(">H8s")

# CRC-8 of identifier and length 8, from the first two bytes of "iii8", which are iii shifted left by four plus 8.
# The CRC is linear, so the contribution of each byte has a table of its own.
_AFTER_HIGH = bytes(CRC8_TABLE[CRC8_TABLE[CRC8_TABLE[0xFF ^ byte >> 4] ^ (byte & 15) << 4] ^ 8] for byte in range(256))
_AFTER_LOW = bytes(CRC8_TABLE[CRC8_TABLE[byte >> 4]] for byte in range(256))


def crc8_columns(raw: bytes) -> bytes:
    """CRC-8 of every ten-byte entry (two bytes of identifier and length, eight of data), one byte for each."""
    count = len(raw) // 10

    def xor(a: bytes, b: bytes) -> bytes:
        return (int.from_bytes(a, "little") ^ int.from_bytes(b, "little")).to_bytes(count, "little")

    crc = xor(raw[0::10].translate(_AFTER_HIGH), raw[1::10].translate(_AFTER_LOW))
    for column in range(9, 2, -1):  # bytes 7 to 1
        crc = xor(crc, raw[column::10]).translate(CRC8_TABLE)
    return xor(crc, b"\xff" * count)


class SlcanParser:
    """Converts received bytes to frames with a right CRC, and counts the rest.

    bad: lines that are neither a frame nor a reply. rejected: well-formed frames with a wrong CRC or length. accepted,
    refused: replies to commands of the host (CR, BEL). answers: the last text replies (V, N).
    """

    def __init__(self) -> None:
        self.bad = 0
        self.rejected = 0
        self.accepted = 0
        self.refused = 0
        self.answers: deque[bytes] = deque(maxlen=16)
        self._pending = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Feed received bytes, split anywhere; returns the frames that they complete, in order."""
        if 7 in data:
            return self._feed_with_bells(data)
        text = self._pending + data
        lines = text.split(b"\r")
        self._pending = self._limit(lines.pop())
        return self._frames_of(lines)

    def _feed_with_bells(self, data: bytes) -> list[Frame]:
        frames: list[Frame] = []
        *parts, last = data.split(b"\a")
        for part in parts:
            frames += self.feed(part)
            self.refused += 1
            self.bad += bool(self._pending)
            self._pending = b""
        return frames + self.feed(last)

    @staticmethod
    def _limit(pending: bytes) -> bytes:
        """Limit an unfinished line to one character more than LINE_MAX, which marks it as too long."""
        return pending if len(pending) <= LINE_MAX else pending[: LINE_MAX + 1]

    def _frames_of(self, lines: list[bytes]) -> list[Frame]:
        whole = [line for line in lines if len(line) == _FRAME_CHARS]
        if len(whole) != len(lines):
            empty = lines.count(b"")
            self.accepted += empty
            if len(whole) + empty != len(lines):
                return self._slow(lines)
        if len(whole) <= _FEW:
            return self._slow(whole)
        text = b"".join(whole)
        if text[::_FRAME_CHARS].strip(b"t") or text[4::_FRAME_CHARS].strip(b"8"):
            return self._slow(whole)
        try:
            raw = unhexlify(text.translate(None, b"t"))
        except HexError:
            return self._slow(whole)
        if len(raw) != 10 * len(whole) or max(raw[0::10]) > 0x7F:
            return self._slow(whole)
        if crc8_columns(raw) != raw[2::10]:
            return self._slow(whole)
        return [(key >> 4, body) for key, body in _ENTRY.iter_unpack(raw)]

    def _slow(self, lines: Iterable[bytes]) -> list[Frame]:
        """Parse line by line, for a batch in which at least one line is not a whole frame. Empty lines were counted."""
        frames = []
        for line in lines:
            if not line:
                continue
            if line[0] != ord("t") or len(line) > LINE_MAX:
                if len(line) <= LINE_MAX and all(0x20 <= byte <= 0x7E for byte in line):
                    self.answers.append(line)
                else:
                    self.bad += 1
                continue
            frame = frame_of_line(line)
            if frame is None:
                self.bad += 1
            elif not check(*frame):
                self.rejected += 1
            else:
                frames.append(frame)
        return frames


def frame_of_line(line: bytes) -> Frame | None:
    """(identifier, data) of a line without its CR; None if it is not a frame. The CRC is not checked."""
    try:
        if line[:1] != b"t" or len(line) < 5:
            return None
        identifier, length = int.from_bytes(unhexlify(b"0" + line[1:4]), "big"), line[4] - ord("0")
        if identifier > 0x7FF or not 0 <= length <= 8 or len(line) != 5 + 2 * length:
            return None
        return identifier, unhexlify(line[5:])
    except HexError:
        return None


def text_of_frames(frames: Sequence[Frame]) -> bytes:
    """SLCAN text of the frames, upper-case, each line with its CR."""
    return b"".join(b"t%03X%d%b\r" % (i, len(data), hexlify(data).upper()) for i, data in frames)
