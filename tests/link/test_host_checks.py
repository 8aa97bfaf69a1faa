"""What on a machine keeps a host from a board, on machines that the tests make up in folders."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

import pytest

from plumb.link import host_checks
from plumb.link.discovery import SerialPort
from plumb.link.findings import Finding
from plumb.link.port_holders import Holder, holders
from plumb.link.transports.byte_stream import open_advice
from plumb.link.usb_adapters import known

needs_proc = pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no /proc")


def process(proc: Path, number: int, program: str, *opened: Path) -> None:
    (proc / str(number) / "fd").mkdir(parents=True)
    (proc / str(number) / "comm").write_text(f"{program}\n")
    for descriptor, path in enumerate(opened):
        (proc / str(number) / "fd" / str(descriptor)).symlink_to(path)


@pytest.fixture
def port(tmp_path: Path) -> SerialPort:
    device = tmp_path / "ttyUSB0"
    device.write_bytes(b"")
    return SerialPort(str(device), "", "10c4:ea60", known(0x10C4, 0xEA60))


def test_modem_manager_and_brltty_are_named_with_what_stops_them(tmp_path: Path) -> None:
    process(tmp_path, 1, "systemd")
    assert list(host_checks.services(tmp_path)) == []
    process(tmp_path, 40, "ModemManager")
    process(tmp_path, 41, "brltty")
    process(tmp_path, 42, "brltty")
    found = list(host_checks.services(tmp_path))
    assert [(one.what, one.good) for one in found] == [("ModemManager", False), ("brltty", False)]
    assert found[0].mend == "sudo systemctl mask --now ModemManager" and "Braille" in found[1].detail


def test_a_busy_port_names_who_has_it(port: SerialPort, tmp_path: Path) -> None:
    proc = tmp_path / "proc"
    process(proc, 7, "bash", Path("/dev/null"))
    assert list(host_checks.ports([port], proc)) == [Finding(port.device, True, False, "CP2102")]
    process(proc, 8, "minicom", Path("/dev/null"), Path(port.device))
    (found,) = host_checks.ports([port], proc)
    assert (found.good, found.detail, found.mend) == (False, "in use by minicom (process 8)", "close it, or: kill 8")
    (proc / "9").mkdir()  # a process of somebody else, whose files are hidden, or that ends while it is looked at
    assert holders(port.device, proc) == [Holder(8, "minicom")]


@needs_proc
def test_a_busy_port_is_named_in_the_error_sentence(tmp_path: Path) -> None:
    device = tmp_path / "port"
    with device.open("w"):
        said = open_advice(str(device), OSError(16, "busy"))
    assert f"(process {os.getpid()}): close the other program" in said
    assert "is in use: close" in open_advice(str(device), OSError(16, "busy"))


@pytest.mark.parametrize(
    ("members", "mend"),
    [
        ("", "sudo usermod -aG {group} $USER, then log in again"),
        ("eve,ann", "log out and in again, or type: newgrp {group} (you are in the group, this session is not)"),
        ("joann", "sudo usermod -aG {group} $USER, then log in again"),
    ],
)
def test_no_permission_names_the_group(
    members: str, mend: str, port: SerialPort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    group = Path(port.device).group()
    (tmp_path / "group").write_text(f"other:x:5:ann\n{group}:x:20:{members}\n")
    monkeypatch.setenv("USER", "ann")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    (found,) = host_checks.ports([port], tmp_path / "none", tmp_path / "group")
    assert (found.good, found.detail, found.mend) == (False, "no permission to open it", mend.format(group=group))


def usb_device(usb: Path, name: str, vendor: int, product: int, driver: bool) -> None:
    (usb / name).mkdir(parents=True)
    (usb / name / "idVendor").write_text(f"{vendor:04x}\n")
    (usb / name / "idProduct").write_text(f"{product:04x}\n")
    (usb / f"{name}:1.0" / ("driver" if driver else "power")).mkdir(parents=True)


def test_an_adapter_without_a_driver_names_the_module(tmp_path: Path) -> None:
    usb, modules = tmp_path / "usb", tmp_path / "modules"
    usb_device(usb, "1-1", 0x1A86, 0x7523, driver=True)
    usb_device(usb, "1-2", 0x1D50, 0x606F, driver=False)
    usb_device(usb, "1-3", 0x0403, 0x6001, driver=False)
    usb_device(usb, "1-4", 0x046D, 0xC52B, driver=False)  # a mouse
    folder = modules / platform.release()
    folder.mkdir(parents=True)
    (folder / "modules.dep").write_text("kernel/drivers/net/can/usb/gs_usb.ko.xz: kernel/drivers/net/can/can-dev.ko\n")
    found = list(host_checks.usb_drivers(usb, modules))
    assert [one.what for one in found] == ["candleLight", "FT232R"]
    assert found[0].mend == "sudo modprobe gs_usb"
    assert found[1].mend == f"sudo apt install linux-modules-extra-{platform.release()}, then: sudo modprobe ftdi_sio"


def test_can_that_the_kernel_has_not_and_an_interface_that_is_down(tmp_path: Path) -> None:
    def refused() -> None:
        raise OSError(97, "Address family not supported by protocol")

    for name, flags in (("can0", "0x80"), ("vcan0", "0x81")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text("280")
        (tmp_path / name / "flags").write_text(flags)
    missing, down, up = host_checks.can(refused, tmp_path, tmp_path)
    assert missing.what == "socketcan" and missing.mend.endswith("sudo modprobe can_raw")
    assert (down.good, down.mend) == (False, "sudo ip link set can0 up type can bitrate 500000")
    assert (up.what, up.good, up.mend) == ("can:socketcan:vcan0", True, "")
    assert [one.what for one in host_checks.can(lambda: None, tmp_path / "nothing")] == []


def test_this_machine_can_be_examined() -> None:
    found = list(host_checks.host_checks())
    assert all(isinstance(one, Finding) and not one.needed for one in found), sys.platform
