"""A board that runs plumb is flashed without a hand on it: asked over its own link, through the bootloader of its ROM,
to another image, with its parameters kept. The simulated part does all of it, served as a terminal."""

from __future__ import annotations

import json
import struct
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
pytest.importorskip("pty", reason="the served board needs a pseudo-terminal")
pytest.importorskip("stm32loader", reason="stm32loader is not installed: the extra flash")

from plumb.__main__ import main
from plumb.boards.serve import run_paced
from plumb.boards.strap import set_strap
from plumb.boards.virtual_machine import open_machine
from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.flash import rom_loader
from plumb.link.session import Session
from plumb.link.transports.server_endpoint import PtyEndpoint
from plumb.spec import parameters
from support.flash_image import image_path
from support.pins import at_rest

CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
HEADER_HASH = 0x130 + 12


@pytest.fixture(scope="module")
def image() -> bytes:
    return image_path().read_bytes()


@pytest.fixture
def other(image: bytes, tmp_path: Path) -> Path:
    """Another commit in its header, and another answer to V."""
    assert image.count(b"V0103\r") == 1
    body = bytearray(image[:-4].replace(b"V0103\r", b"V0203\r"))
    struct.pack_into("<II", body, HEADER_HASH, 0x01234567, 0x89ABCDEF)
    path = tmp_path / "other.bin"
    path.write_bytes(bytes(body) + struct.pack("<I", zlib.crc32(body)))
    return path


@contextmanager
def served(machine: Machine) -> Iterator[str]:
    """The terminal behind which it runs."""
    line, done = PtyEndpoint(), threading.Event()
    thread = threading.Thread(target=run_paced, args=(machine, line, done.is_set))
    thread.start()
    try:
        yield line.address
    finally:
        done.set()
        thread.join(10)
        line.close()


def save(machine: Machine, **values: int) -> None:
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, **values)
        session.execute("SAVE")


def version(machine: Machine) -> bytes:
    """What it answers to V, behind what it still had to say to the host before."""
    machine.uart.write(b"\rC\rV\r")
    machine.advance_us(20_000)
    said = [line for line in machine.uart.read(4096).split(b"\r") if line.startswith(b"V")]
    return said[-1] if said else b"nothing"


def test_a_running_board_goes_there_itself_and_keeps_its_parameters(
    other: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = open_machine()
    save(machine, period_us=3000)
    with served(machine) as port:
        assert main(["flash", "--port", port, "--image", str(other), "--json"]) == 0
        with Session.open(port) as session:
            identity = session.require_match()
            values = session.read_parameters()
    report = json.loads(capsys.readouterr().out)
    assert report["asked"] is True and report["started"] is True and report["git_hash"] == "0123456789abcdef"
    assert version(machine) == b"V0203" and identity["FAULTS"] & 0xFF == 0
    assert identity.parameter_source == "saved in flash, number 1" and identity.reset_cause == "software"
    assert values == parameters.whole_table(CONTROL, period_us=3000)
    assert bytes(machine.cpu.flash[: other.stat().st_size]) == other.read_bytes()
    assert machine.warnings == [] and machine.reset_count == 2


@pytest.fixture
def renamed(image: bytes, tmp_path: Path) -> Path:
    """An image whose table has another parameter in the place of period_us: the id of its name is another."""
    packed = struct.pack(f"<{len(parameters.table())}H", *(row.id for row in parameters.table()))
    assert image.count(packed) == 1
    body = bytearray(image[:-4])
    body[image.index(packed) + 2 * [row.name for row in parameters.table()].index("period_us")] ^= 1
    path = tmp_path / "renamed.bin"
    path.write_bytes(bytes(body) + struct.pack("<I", zlib.crc32(body)))
    return path


@pytest.mark.slow
def test_saved_parameters_survive_an_image_with_another_table(image: bytes, renamed: Path, tmp_path: Path) -> None:
    machine = open_machine()
    save(machine, period_us=3000, arm_hold_ms=7)
    before = tmp_path / "before.bin"
    before.write_bytes(image)
    default = next(row.default for row in parameters.table() if row.name == "period_us")
    for file, period_us, source in (
        (renamed, default, "saved in flash, number 1, 1 unknown to this image, 1 missing, at defaults"),
        (before, 3000, "saved in flash, number 1"),
    ):
        with served(machine) as port:
            assert main(["flash", "--port", port, "--image", str(file), "--json"]) == 0
            with Session.open(port) as session:
                assert session.connect().parameter_source == source
                assert session.read_parameters() == parameters.whole_table(CONTROL, period_us=period_us, arm_hold_ms=7)
    assert machine.warnings == []


def test_a_board_in_a_run_is_left_alone(other: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = open_machine()
    before = bytes(machine.cpu.flash)
    with Session.open(machine.uart) as session:
        session.begin("LOCKSTEP")
    with served(machine) as port:
        assert main(["flash", "--port", port, "--image", str(other)]) == 3
    assert "a run is on: end the run, open the arm switch, and try again" in capsys.readouterr().err
    assert bytes(machine.cpu.flash) == before and machine.rom is None


def test_pins_that_are_no_uart_need_the_jumper(other: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the bridge's pins the UART is elsewhere, and the bootloader would drive the bridge: the board says no."""
    machine = open_machine()
    save(machine, pins=1)
    set_strap(machine, "bridge")
    machine.reset()
    machine.advance_us(30_000)
    with Session.open(machine.uart) as session, pytest.raises(LinkError, match="cannot do that"):
        session.execute("BOOTLOADER")
    with served(machine) as port:
        assert main(["flash", "--port", port, "--image", str(other), "--wait", "0.5"]) == 3
    complaint = capsys.readouterr().err
    assert "the bridge's pins" in complaint and "set BOOT0 to 1" in complaint and "waiting" not in complaint
    assert machine.rom is None


def test_with_the_jumper_set_nobody_is_asked(other: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = open_machine()
    machine.boot0 = True
    machine.reset()
    machine.boot0 = False
    with served(machine) as port:
        assert main(["flash", "--port", port, "--image", str(other), "--json"]) == 0
    assert version(machine) == b"V0203"
    assert json.loads(capsys.readouterr().out)["asked"] is False
    assert machine.warnings == []


def test_a_request_counts_once_and_only_with_its_reset(image: bytes) -> None:
    machine = open_machine()
    with Session.open(machine.uart) as session:
        session.execute("BOOTLOADER")
    machine.advance_us(150_000)
    assert machine.rom is not None
    machine.reset()
    machine.advance_us(30_000)
    assert machine.rom is None, "the next reset starts the image again"
    # The word is written and power fails before the reset: the next start does not find its way into the ROM.
    machine.bkp.dr1 = 0xB007
    machine.brown_out()
    machine.advance_us(30_000)
    assert machine.rom is None
    with Session.open(machine.uart) as session:
        assert session.require_match().reset_cause == "power"


def test_a_board_that_ran_since_the_request_does_not_reset_when_disarmed() -> None:
    machine = open_machine()
    at_rest(machine)
    with Session.open(machine.uart) as session:
        session.upload(CONTROL, arm_hold_ms=0)
        session.execute("BOOTLOADER")
        session.begin("REALTIME_LIVE")
        session.arm()
        for _turn in range(30):
            session.receive(0.005)
        session.disarm()
        session.end()
        session.receive(0.2)
    assert machine.rom is None and machine.reset_count == 1


def test_the_watchdog_does_not_follow_into_the_bootloader() -> None:
    machine = open_machine()
    with Session.open(machine.uart) as session:
        session.execute("BOOTLOADER")
    machine.advance_us(2_000_000)
    assert machine.rom is not None and machine.reset_count == 2


def test_a_silent_port_is_no_board() -> None:
    import os
    import pty

    master, slave = pty.openpty()
    try:
        assert rom_loader.ask_running_board(os.ttyname(slave)) is False
    finally:
        os.close(master)
        os.close(slave)
