"""The parser of CRSF and what the receiver makes of its frames, a second time, from docs/reference/receiver.md; and the
same by the firmware's C."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from plumb.spec.crsf import LOW, MIDDLE, STATISTICS, STICKS, SYNC, crc8
from support import link_functions

LENGTHS = {STICKS: 26, STATISTICS: 14}
"""Bytes of the frames that count."""
SPAN = 819
SWITCH_OFF, SWITCH_ON, EQUAL = 792, 1192, 3


@dataclass
class Row:
    """What the receiver has made of a stream up to a frame that ends at byte `end`. words: throttle, roll, pitch, yaw,
    switches, number of the newest frame that counts."""

    end: int
    kind: int
    words: tuple[int, ...]
    channels: tuple[int, ...] = ()
    link_quality: int = 0


class _Row(ctypes.Structure):
    _fields_ = [
        ("end", ctypes.c_int32), ("kind", ctypes.c_int32), ("words", ctypes.c_int32 * 6),
        ("channels", ctypes.c_int32 * 16), ("link_quality", ctypes.c_int32),
    ]  # fmt: skip


def by_firmware(stream: bytes) -> list[Row]:
    """A row for each frame that the firmware finds."""
    rows = (_Row * (len(stream) // min(LENGTHS.values()) + 1))()
    count = link_functions.library().receiver_follow(stream, ctypes.c_size_t(len(stream)), rows)
    kinds = (0, STICKS, STATISTICS)
    return [
        Row(row.end, kinds[row.kind], tuple(row.words), tuple(row.channels) if row.kind == 1 else (), row.link_quality)
        for row in rows[:count]
    ]


def frames_in(stream: bytes) -> list[tuple[int, bytes]]:
    """End and bytes of each frame in a stream. From the first byte on: behind a whole frame, of whatever type, the
    search goes on; else it goes on with the next byte. It waits where a frame is not whole yet."""
    found, at = [], 0
    while at < len(stream):
        head = stream[at : at + 2]
        size = head[1] + 2 if len(head) == 2 else 0
        begins = head[0] == SYNC and (len(head) < 2 or 4 <= size <= 64)
        if begins and (len(head) < 2 or at + size > len(stream)):
            break
        if begins and crc8(stream[at + 2 : at + size - 1]) == stream[at + size - 1]:
            at += size
            if LENGTHS.get(stream[at - size + 2]) == size:
                found.append((at, stream[at - size : at]))
        else:
            at += 1
    return found


def _toward_zero(number: int, by: int) -> int:
    return abs(number) // by * (1 if number >= 0 else -1)


def pulses_by_firmware(edges_us: Sequence[int], turn_us: int = 1000) -> list[Row]:
    """A row for each frame that the firmware finds in a pulse train; kind 0."""
    rows = (_Row * (len(edges_us) // 9 + 1))()
    stamps = (ctypes.c_uint32 * len(edges_us))(*edges_us)
    count = link_functions.library().pulses_follow(
        stamps, ctypes.c_size_t(len(edges_us)), ctypes.c_uint32(turn_us), rows
    )
    return [Row(row.end, 0, tuple(row.words), tuple(row.channels)[:8]) for row in rows[:count]]


def pulses_by_twin(edges_us: Sequence[int]) -> list[Row]:
    """The same rows, by this module. Edges with less than 3 ms between them are one frame; more than 5 ms are a pause,
    and what is between the two depends on the loop."""
    pilot, rows, begin = _Pilot(), [], 0
    for end in range(1, len(edges_us) + 1):
        if end < len(edges_us) and edges_us[end] - edges_us[end - 1] < 3000:
            continue
        widths = [later - sooner for sooner, later in pairwise(edges_us[begin:end])]
        begin = end
        if len(widths) != 8 or not all(750 <= width <= 2250 for width in widths):
            continue
        if widths[2] >= 950:
            pilot.number = pilot.number % 255 + 1
            pilot.take(tuple(width * 8 // 5 - 1408 for width in widths))
        rows.append(Row(end, 0, pilot.words(), tuple(widths)))
    return rows


class _Pilot:
    """Sticks and switches after the frames so far."""

    def __init__(self) -> None:
        self.throttle, self.sticks, self.switches = 0, (0, 0, 0), [False, False]
        self.asked = [0, 0]
        self.number = 0

    def take(self, channels: tuple[int, ...]) -> None:
        def stick(value: int) -> int:
            return _toward_zero(max(min(value - MIDDLE, SPAN), -SPAN) * 32767, SPAN)

        self.sticks = stick(channels[0]), stick(channels[1]), -stick(channels[3])
        self.throttle = max(min(channels[2] - LOW, 1639), 0) * 32767 // 1639
        for place, value in enumerate(channels[4:6]):
            other = value < SWITCH_OFF if self.switches[place] else value > SWITCH_ON
            self.asked[place] = self.asked[place] + 1 if other else 0
            if self.asked[place] == EQUAL:
                self.asked[place], self.switches[place] = 0, not self.switches[place]

    def words(self) -> tuple[int, ...]:
        switches = sum(on << place for place, on in enumerate(self.switches))
        return self.throttle, *self.sticks, switches, self.number


def by_twin(stream: bytes) -> list[Row]:
    """The same rows, by this module."""
    pilot, rows, lost = _Pilot(), [], False
    for end, frame in frames_in(stream):
        kind, payload = frame[2], frame[3:-1]
        if kind == STATISTICS:
            lost = payload[2] == 0
            rows.append(Row(end, kind, pilot.words(), (), payload[2]))
            continue
        bits = int.from_bytes(payload, "little")
        channels = tuple(bits >> 11 * place & 2047 for place in range(16))
        if not lost:
            pilot.number = pilot.number % 255 + 1
            pilot.take(channels)
        rows.append(Row(end, kind, pilot.words(), channels))
    return rows
