"""CRSF frames of a radio receiver, as it sends them to the board: docs/reference/receiver.md.

A frame is 0xC8, the number of bytes that follow, a type, a payload, and a CRC-8 over type and payload.
"""

from __future__ import annotations

from collections.abc import Sequence

SYNC, STICKS, STATISTICS = 0xC8, 0x16, 0x14
CHANNELS, CHANNEL_BITS = 16, 11
LENGTHS = {STICKS: 26, STATISTICS: 14}
"""Bytes of a whole frame."""
MIN_BYTES, MAX_BYTES = 4, 64
"""Bytes of a frame of any type."""
LOW, MIDDLE, HIGH = 172, 992, 1811
"""Values of a channel at the ends and in the middle of a stick."""
FULL = 32767
"""A stick at its end, as an input of a step."""
NUMBER, LOST = 255, 256
"""Of the command `receiver`: the number of the newest frame, and the bit of a transmitter that is lost."""
SWITCHES_AT, NUMBER_AT = 3, 4
"""Places of the commands `switches` and `receiver` among those of a step."""
MOTORS_ON = 1
"""Of the command `switches`: the motors are on."""
IN_USE = 1
"""Parameter `receiver` of a board that hears CRSF."""
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


def of_inputs(throttle_q15: int, roll_q15: int, pitch_q15: int, yaw_q15: int, switches: int) -> bytes:
    """A frame of channels by the setpoint and the first commands of a step; switches: bit 0 the rotors, bit 1 the mode
    rate. An input comes back to within the resolution of a channel."""
    return sticks(
        roll=roll_q15 / FULL, pitch=pitch_q15 / FULL, throttle=max(throttle_q15, 0) / FULL, yaw=yaw_q15 / FULL,
        on=bool(switches & 1), rate=bool(switches & 2),
    )  # fmt: skip


def statistics(link_quality: int) -> bytes:
    """A frame of link statistics: quality of the link to the receiver in percent; the rest is what a receiver close to
    its transmitter says."""
    return frame(STATISTICS, bytes([40, 40, link_quality, 10, 0, 2, 3, 45, 100, 8]))


def values(payload: bytes) -> list[int]:
    """The channels of a frame of channels, 0 to 2047."""
    bits = int.from_bytes(payload, "little")
    return [bits >> CHANNEL_BITS * place & (1 << CHANNEL_BITS) - 1 for place in range(CHANNELS)]


def link_quality(payload: bytes) -> int:
    """Of a frame of link statistics, in percent."""
    return payload[2]


class Reader:
    """Finds the frames of the two types that the board knows in a stream of bytes, as the board does."""

    def __init__(self) -> None:
        self._waiting = b""

    def push(self, data: bytes) -> list[tuple[int, bytes]]:
        """Type and payload of each frame that these bytes complete. A frame of another type is passed over whole."""
        found: list[tuple[int, bytes]] = []
        self._waiting += data
        while self._waiting:
            size = self._waiting[1] + 2 if len(self._waiting) > 1 else MIN_BYTES
            if self._waiting[0] != SYNC or not MIN_BYTES <= size <= MAX_BYTES:
                self._waiting = self._waiting[1:]
                continue
            if len(self._waiting) < size:
                break
            whole = self._waiting[:size]
            agrees = crc8(whole[2:-1]) == whole[-1]
            if agrees and LENGTHS.get(whole[2]) == size:
                found.append((whole[2], whole[3:-1]))
            self._waiting = self._waiting[size if agrees else 1 :]
        return found


class Pilot:
    """The frames that a receiver would send for the inputs of a run, step by step: one of channels for each new number
    of a frame, and link statistics when the transmitter is lost or found again."""

    def __init__(self) -> None:
        self._number, self._lost = 0, False

    def frames(self, setpoint: int, commands: Sequence[int]) -> bytes:
        """What is sent before the step with these inputs; commands: its words, the receiver's fifth."""
        roll, pitch, yaw, switches, receiver = commands[:5]
        number, lost = receiver & NUMBER, bool(receiver & LOST)
        sent = b"" if number == self._number else of_inputs(setpoint, roll, pitch, yaw, switches)
        if lost != self._lost:
            sent += statistics(0 if lost else 100)
        self._number, self._lost = number, lost
        return sent
