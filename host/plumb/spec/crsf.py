"""CRSF frames of a radio receiver, as it sends them to the board: docs/reference/receiver.md.

A frame is 0xC8, the number of bytes that follow, a type, a payload, and a CRC-8 over type and payload.
"""

from __future__ import annotations

from collections.abc import Sequence

SYNC, STICKS, STATISTICS = 0xC8, 0x16, 0x14
CHANNELS, CHANNEL_BITS = 16, 11
LOW, MIDDLE, HIGH = 172, 992, 1811
"""Values of a channel at the ends and in the middle of a stick."""
POLYNOMIAL = 0xD5
BAUD = 420_000


def crc8(data: bytes) -> int:
    """Polynomial 0xD5, initial value 0, highest bit first."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ (POLYNOMIAL if crc & 0x80 else 0)) & 0xFF
    return crc


def frame(kind: int, payload: bytes) -> bytes:
    """A whole frame of that type."""
    body = bytes([kind]) + payload
    return bytes([SYNC, len(body) + 1]) + body + bytes([crc8(body)])


def channels(values: Sequence[int]) -> bytes:
    """A frame of channels, 0 to 2047 each; those that are not given are in the middle."""
    whole = [*values, *(MIDDLE,) * (CHANNELS - len(values))]
    packed = sum(value << CHANNEL_BITS * place for place, value in enumerate(whole))
    return frame(STICKS, packed.to_bytes(CHANNELS * CHANNEL_BITS // 8, "little"))


def sticks(
    *, roll: float = 0.0, pitch: float = 0.0, throttle: float = 0.0, yaw: float = 0.0, on: bool = False,
    rate: bool = False,
) -> bytes:  # fmt: skip
    """A frame of channels by what the system's commands mean. roll, pitch, yaw: -1 to 1, right side down, nose down, to
    the left; throttle: 0 to 1; on: the rotors; rate: the mode."""

    def stick(share: float) -> int:
        return round(MIDDLE + (HIGH - MIDDLE) * share)

    up = round(LOW + (HIGH - LOW) * throttle)
    return channels([stick(roll), stick(pitch), up, stick(-yaw), *(HIGH if switch else LOW for switch in (on, rate))])


def statistics(link_quality: int) -> bytes:
    """A frame of link statistics: quality of the link to the receiver in percent; the rest is what a receiver close to
    its transmitter says."""
    return frame(STATISTICS, bytes([40, 40, link_quality, 10, 0, 2, 3, 45, 100, 8]))
