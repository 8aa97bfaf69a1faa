"""A reader of MAVLink 2 for tests, from mavlink.io's description of the packet and of the messages `common`."""

from __future__ import annotations

import struct
from typing import NamedTuple

MAGIC = 0xFD
HEADER = struct.Struct("<BBBBBBB3s")
"""Magic, length, two bytes of flags, sequence, system, component, number of the message in three bytes."""


class Layout(NamedTuple):
    """Of a payload: fields with their types in the order of the wire, the largest first; then the seed of its CRC."""

    name: str
    fields: tuple[tuple[str, str], ...]
    seed: int


LAYOUTS = {
    0: Layout(
        "HEARTBEAT",
        (("custom_mode", "I"), ("type", "B"), ("autopilot", "B"), ("base_mode", "B"), ("system_status", "B"),
         ("mavlink_version", "B")),
        50,
    ),
    1: Layout(
        "SYS_STATUS",
        (("present", "I"), ("enabled", "I"), ("health", "I"), ("load", "H"), ("voltage_battery", "H"),
         ("current_battery", "h"), ("drop_rate_comm", "H"), ("errors_comm", "H"),
         *((f"errors_count{number}", "H") for number in range(1, 5)), ("battery_remaining", "b")),
        124,
    ),
    30: Layout(
        "ATTITUDE",
        (("time_boot_ms", "I"),
         *((name, "f") for name in ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"))),
        39,
    ),
    36: Layout(
        "SERVO_OUTPUT_RAW",
        (("time_usec", "I"), *((f"servo{number}_raw", "H") for number in range(1, 9)), ("port", "B")),
        222,
    ),
}  # fmt: skip
"""Number -> layout; extensions at its end are not read."""


class Message(NamedTuple):
    """One message with its sender."""

    name: str
    system: int
    component: int
    sequence: int
    fields: dict[str, float]


def crc16(data: bytes) -> int:
    """CRC-16/MCRF4XX: polynomial 0x1021 reflected, from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def message(packet: bytes) -> Message:
    """The message of a datagram that holds one, unsigned. Zeros at the end of a payload need not be sent."""
    magic, length, incompatible, _, sequence, system, component, number = HEADER.unpack_from(packet)
    assert (magic, incompatible, len(packet)) == (MAGIC, 0, HEADER.size + length + 2)
    layout = LAYOUTS[int.from_bytes(number, "little")]
    body, sent = packet[1:-2], int.from_bytes(packet[-2:], "little")
    assert crc16(body + bytes([layout.seed])) == sent, f"the CRC of {layout.name} is wrong"
    form = struct.Struct("<" + "".join(kind for _, kind in layout.fields))
    payload = packet[HEADER.size : -2].ljust(form.size, b"\0")
    names = (name for name, _ in layout.fields)
    return Message(layout.name, system, component, sequence, dict(zip(names, form.unpack_from(payload), strict=True)))
