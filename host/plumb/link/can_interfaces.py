"""CAN interfaces of this machine: the network interfaces of Linux, and what python-can's drivers detect."""

from __future__ import annotations

import contextlib
import json
import logging
import subprocess
from dataclasses import dataclass
from pathlib import Path

NETWORK = Path("/sys/class/net")
ARPHRD_CAN = "280"
IFF_UP = 1
DETECTED = ("pcan", "kvaser", "vector", "ixxat", "neovi", "canalystii", "nican", "usb2can")
"""Interfaces of python-can that find their adapters without opening them."""


@dataclass(frozen=True)
class CanInterface:
    """name: the bus as BUS takes it. kbit: its bit rate where it is known. state: up, down, or the driver's name."""

    name: str
    state: str
    kbit: int | None = None


def network_interfaces(folder: Path = NETWORK) -> list[CanInterface]:
    """The CAN network interfaces of Linux, up or down; [] on other systems."""
    found = []
    for device in sorted(folder.glob("*")):
        with contextlib.suppress(OSError, ValueError):
            if (device / "type").read_text().strip() == ARPHRD_CAN:
                up = int((device / "flags").read_text(), 16) & IFF_UP
                kbit = _kbit(device.name) if up else None
                found.append(CanInterface(f"can:socketcan:{device.name}", "up" if up else "down", kbit))
    return found


def _kbit(name: str) -> int | None:
    """Bit rate in kbit/s of a network interface, from `ip`; None for a virtual one."""
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, subprocess.SubprocessError):
        command = ["ip", "-details", "-json", "link", "show", "dev", name]
        said = json.loads(subprocess.run(command, capture_output=True, timeout=5, check=True).stdout)
        return int(said[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"]) // 1000
    return None


def detected_interfaces() -> list[CanInterface]:
    """The adapters that drivers outside the kernel know, through python-can."""
    import can

    log = logging.getLogger("can")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)  # each driver that is not installed says so
    try:
        configurations = can.detect_available_configs([one for one in DETECTED if one in can.VALID_INTERFACES])
    finally:
        log.setLevel(before)
    return [
        CanInterface(f"can:{found['interface']}:{found['channel']}", str(found["interface"]))
        for found in configurations
    ]


def can_interfaces() -> list[CanInterface]:
    return network_interfaces() + detected_interfaces()
