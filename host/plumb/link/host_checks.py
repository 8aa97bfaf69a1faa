"""Obstacles on this machine between a host and a board: programs that take ports, missing rights, drivers, CAN in the
kernel.

Services, rights of groups and kernel modules are those of Linux; elsewhere there is nothing to find. Every function
reads only, and takes the folders that it reads from, so that tests can make a machine up.
"""

from __future__ import annotations

import contextlib
import os
import platform
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

from plumb.link.can_interfaces import NETWORK, network_interfaces
from plumb.link.discovery import SerialPort, serial_ports
from plumb.link.findings import Finding
from plumb.link.port_holders import PROC, holders, running
from plumb.link.usb_adapters import UsbAdapter, known

USB_DEVICES = Path("/sys/bus/usb/devices")
MODULES = Path("/lib/modules")
GROUPS = Path("/etc/group")
TAKERS = {
    "ModemManager": (
        "it sends AT commands to every new serial port, which is busy for some seconds",
        "sudo systemctl mask --now ModemManager",
    ),
    "brltty": ("it takes CH340 and CP210x adapters for Braille displays", "sudo apt remove brltty"),
}
"""Programs that open serial ports by themselves: what they do, and what stops them."""


def services(proc: Path = PROC) -> Iterator[Finding]:
    """ModemManager and brltty, where they run."""
    for name in dict.fromkeys(one.program for one in running(set(TAKERS), proc)):
        does, mend = TAKERS[name]
        yield Finding(name, False, False, f"it runs, and {does}", mend)


def ports(found: list[SerialPort] | None = None, proc: Path = PROC, groups: Path = GROUPS) -> Iterator[Finding]:
    """Every serial port: may this user open it, and has another program done so."""
    for port in serial_ports() if found is None else found:
        path = Path(port.device)
        about = port.adapter.name if port.adapter else port.description or "it can be opened"
        if not path.exists():
            if os.name != "posix":  # COM3
                yield Finding(port.device, True, False, about)
            continue
        holding = [one for one in holders(port.device, proc) if one.process != os.getpid()]
        if not os.access(path, os.R_OK | os.W_OK):
            yield Finding(port.device, False, False, "no permission to open it", _join_group(path, groups))
        elif holding:
            who = ", ".join(map(str, holding))
            mend = "close it, or: kill " + " ".join(str(one.process) for one in holding)
            yield Finding(port.device, False, False, f"in use by {who}", mend)
        else:
            yield Finding(port.device, True, False, about)


def _join_group(path: Path, groups: Path) -> str:
    """How this user gets the right to open the device."""
    group = path.group()
    with contextlib.suppress(OSError):
        for line in groups.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, members = line.partition(":")
            if name == group and os.environ.get("USER", "") in members.rpartition(":")[2].split(","):
                return f"log out and in again, or type: newgrp {group} (you are in the group, this session is not)"
    return f"sudo usermod -aG {group} $USER, then log in again"


def usb_drivers(usb: Path = USB_DEVICES, modules: Path = MODULES) -> Iterator[Finding]:
    """Adapters that are plugged in and have no driver."""
    for device in sorted(usb.glob("*")):
        adapter = _adapter_at(device)
        if adapter is None or any((one / "driver").exists() for one in usb.glob(f"{device.name}:*")):
            continue
        yield Finding(adapter.name, False, False, "plugged in, without a driver", _load(adapter.module, modules))


def _adapter_at(device: Path) -> UsbAdapter | None:
    with contextlib.suppress(OSError, ValueError):
        return known(
            int((device / "idVendor").read_text(), 16),
            int((device / "idProduct").read_text(), 16),
        )
    return None


def _load(module: str, modules: Path) -> str:
    """How a kernel module is loaded, or installed first where this kernel has it not."""
    release = platform.release()
    for index in ("modules.dep", "modules.builtin"):
        with contextlib.suppress(OSError):
            names = (modules / release / index).read_text(errors="replace")
            if f"/{module}.ko" in names or f"/{module.replace('_', '-')}.ko" in names:
                return f"sudo modprobe {module}"
    return f"sudo apt install linux-modules-extra-{release}, then: sudo modprobe {module}"


def _open_can_socket() -> None:
    if hasattr(socket, "AF_CAN"):
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()


def can(
    opens: Callable[[], None] = _open_can_socket, network: Path = NETWORK, modules: Path = MODULES
) -> Iterator[Finding]:
    """CAN in the kernel, and its interfaces."""
    try:
        opens()
    except OSError:
        detail = "the kernel has no CAN, so that can:socketcan:... does not work"
        yield Finding("socketcan", False, False, detail, _load("can_raw", modules))
    for bus in network_interfaces(network):
        device = bus.name.rpartition(":")[2]
        rate = f", {bus.kbit} kbit/s" if bus.kbit else ""
        mend = "" if bus.state == "up" else f"sudo ip link set {device} up type can bitrate 500000"
        yield Finding(bus.name, bus.state == "up", False, bus.state + rate, mend)


def host_checks() -> Iterator[Finding]:
    """All of these on this machine."""
    yield from ports()
    if platform.system() == "Linux":
        yield from services()
        yield from usb_drivers()
        yield from can()
