"""`plumb virtual-board` as a process of its own: one line says where it is, Ctrl-C is 130, SIGTERM a plain end."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link import parameter_table
from plumb.link.identity import FAULT_STRAP
from plumb.link.session import Session
from plumb.spec import images, parameter_file
from support.slow_time import slow_down

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")
from plumb.boards import plant_on_pins
from plumb.boards.virtual_machine import open_machine
from plumb.contract.scenario import sensor_words
from plumb.f103 import Machine

try:
    IMAGE = find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


@pytest.mark.parametrize(("number", "code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 0, "")])
def test_how_it_ends(number: signal.Signals, code: int, said: str) -> None:
    command = [sys.executable, "-m", "plumb", "virtual-board", "--serial", "tcp:0", "--system", "quad"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "socket://127.0.0.1:" in process.stdout.readline()
        process.send_signal(number)
        _, complaint = process.communicate()
    assert process.returncode == code
    assert said in complaint and len(complaint.splitlines()) <= 1


@pytest.mark.parametrize("where", ["tcp:99999", "tcp:", "usb", "tcp:4000:1"])
def test_no_way_to_serve_is_wrong_use(where: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--serial", where]) == 2
    assert "pty or tcp:PORT" in capsys.readouterr().err


@pytest.mark.parametrize("chip", ["f103", "native"])
def test_a_battery_below_0_v_is_wrong_use(chip: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--port", chip, "--battery", "-1", "--serial", "nowhere"]) == 2
    assert "--battery -1: give 0 V or more" in capsys.readouterr().err


def test_a_scenario_without_a_system_is_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--scenario", "hold", "--serial", "nowhere"]) == 2
    complaint = capsys.readouterr().err
    assert "--system" in complaint and len(complaint.splitlines()) == 1


def test_an_image_that_does_not_boot_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stub = tmp_path / "half.bin"
    stub.write_bytes(IMAGE.read_bytes()[:6000])
    assert front.main(["run", "quad", "--board", "virtual", "--image", str(stub), "--seconds", "2"]) in (2, 3)
    complaint = capsys.readouterr().err
    assert "half.bin" in complaint and "UartStream" not in complaint and len(complaint.splitlines()) == 1


def test_a_damaged_image_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = bytearray(IMAGE.read_bytes())
    bad[9000] ^= 1
    (tmp_path / "bad.bin").write_bytes(bad)
    assert front.main(["monitor", "--board", "virtual", "--seconds", "0.2", "--image", str(tmp_path / "bad.bin")]) == 2
    assert "bad.bin is damaged" in capsys.readouterr().err


def test_what_is_saved_outlives_the_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed the hard way after the save was answered and written down, as a board that loses its supply."""
    slow_down(monkeypatch)
    kept, port = tmp_path / "board.flash", tmp_path / "port"
    command = [sys.executable, "-m", "plumb", "virtual-board", "--symlink", str(port), "--keep", str(kept)]
    command += ["--strap", "bridge"]

    def asked(*arguments: str) -> str:
        front.main([*arguments, "--board", f"serial:{port}"])
        return capsys.readouterr().out

    for source in ("factory defaults", "saved in flash"):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None and "serving" in process.stdout.readline()
            assert f"parameters: {source}" in asked("doctor")
            asked("params", "set", "period_us=12000", "pins=1", "--save")
            while not kept.exists():
                assert process.poll() is None
                time.sleep(0.01)
            assert "12000" in asked("params", "get", "period_us")
        finally:
            process.kill()
            process.communicate()
    assert kept.stat().st_size == 4096


def test_the_plant_is_on_the_pins_before_the_power_comes_on() -> None:
    """Or a board with the bridge's pins starts with a break and no Hall sensor."""
    from plumb.boards import plant_on_pins
    from plumb.boards.virtual import VirtualBoard
    from plumb.boards.virtual_machine import open_machine
    from plumb.contract.parameters import quantise
    from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS
    from plumb.link.session import Session
    from plumb.systems.balancer import scenarios as balancer

    with VirtualBoard() as board:
        plant_on_pins.configure_as(board, quantise(balancer.TUNED), period_us=balancer.PERIOD_US, **balancer.LINK)
        slots = bytes(board.machine.cpu.flash[PARAMETER_SLOTS - FLASH_BASE :])
    machine = open_machine(
        slots=slots,
        strap="bridge",
        couple=plant_on_pins.coupler("balancer", balancer.plant(balancer.scenario("rough", 1))),
    )
    with Session.open(machine.uart) as session:
        identity = session.connect()
        assert (identity["PINS"], identity["FAULTS"]) == (1, 0)


@pytest.mark.parametrize("text", ["short", None])
def test_another_file_is_not_taken_for_kept_parameters(
    text: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    if text is None:
        other.mkdir()
    else:
        other.write_text(text)
    assert front.main(["virtual-board", "--keep", str(other)]) == 2
    complaint = capsys.readouterr().err
    assert "other" in complaint and len(complaint.splitlines()) == 1
    assert text is None or other.read_text() == text


@pytest.mark.parametrize(
    ("name", "tuning", "pins"),
    [("quad", "hold", 0), ("balancer", "tuned", 1), ("turntable", "analog", 0), ("quadrotor", "hummingbird", 2)],
)
def test_with_a_system_it_comes_up_as_that_one(name: str, tuning: str, pins: int) -> None:
    """Saved and started again: a balancer that is armed later is armed on the pins of the bridge, or not at all."""
    system = systems.load(name)
    machine = open_machine(images.running(name))
    plant_on_pins.boot_configured_as(machine, name)
    with Session.open(machine.uart) as session:
        identity = session.connect()
        found = parameter_file.by_name(parameter_table.read_table(session))
    assert identity["PINS"] == pins and identity.parameter_source.startswith("saved")
    settings = system.TUNINGS[tuning]
    wanted = {**quantise(settings).values, "period_us": settings.period_us, **system.LINK}
    wanted |= sensor_words(system, tuning)
    assert {key: found[key] for key in wanted} == wanted


def test_the_served_one_is_that_system(monkeypatch: pytest.MonkeyPatch) -> None:
    slow_down(monkeypatch)
    command = [sys.executable, "-m", "plumb", "virtual-board", "--serial", "tcp:0", "--system", "balancer"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"socket://[\d.:]+", process.stdout.readline())
        assert address is not None
        try:
            with Session.open(address[0]) as session:
                pins = session.connect()["PINS"]
        finally:
            process.terminate()
    assert pins == 1


def test_kept_parameters_are_nobodys_to_replace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A board whose file holds a set comes up with that one, whatever system its plant is of."""
    kept = tmp_path / "board.flash"
    starts = []

    def look(machine: Machine, where: str, stopped: object, **ends: Any) -> None:
        with Session.open(machine.uart) as session:
            identity = session.connect()
            starts.append((session.read_parameters()[0], identity["PINS"], identity["FAULTS"] >> FAULT_STRAP & 1))
            if not kept.exists():
                session.upload(quantise(systems.load("quad").TUNINGS["adaptive"]).words(), period_us=20_000)
                session.execute_idle("SAVE")
        ends["kept"].write()

    monkeypatch.setattr("plumb.boards.serve.serve", look)
    command = ["virtual-board", "--keep", str(kept)]
    assert front.main(command) == 0 and kept.exists()
    assert front.main([*command, "--system", "balancer"]) == 0
    kept.unlink()
    assert front.main([*command, "--system", "balancer"]) == 0
    assert front.main([*command, "--strap", "bridge"]) == 0
    quad, balancer = 0, 1
    assert starts == [(quad, 0, 0), (quad, 1, 1), (balancer, 1, 0), (quad, 1, 0)]
    assert front.main([*command, "--strap", "PB5"]) == 2
