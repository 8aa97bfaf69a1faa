"""`--gdb` of the commands that simulate the chip: it stops, and what the command finds is what it finds without."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

import plumb
from plumb.__main__ import main
from plumb.boards import debugging
from plumb.errors import ExitCode
from plumb.flash.image import find_image
from plumb.spec import images
from support.flash_image import image_path
from support.gdb_client import GdbClient

PC = 15
STOPS = 5
DEADLINE_S = 60
SILENT_S = 4.0


def control_step(image: Path) -> int:
    elf = str(image.with_suffix(".elf"))
    lines = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout.splitlines()
    return next(int(line.split()[0], 16) & ~1 for line in lines if line.split()[-1] == "control_step")


def stop_some_times(gdb: GdbClient, image: Path | None = None) -> None:
    place = control_step(image or image_path())
    for _ in range(STOPS):
        assert gdb.ask(f"Z0,{place:x},2") == "OK"
        assert gdb.ask("c") == "T05"
        assert gdb.register(PC) == place
        assert gdb.ask(f"z0,{place:x},2") == "OK"
        assert gdb.ask("s") == "T05"
    gdb.ask("D")


@contextmanager
def debugger(does: Callable[[GdbClient], None] = stop_some_times) -> Iterator[None]:
    """A debugger that comes to the command of this process and does this."""
    failed: list[BaseException] = []

    def come() -> None:
        try:
            end_s = time.monotonic() + DEADLINE_S
            while not debugging._served and time.monotonic() < end_s:
                time.sleep(0.01)
            with GdbClient(debugging._served[-1].port) as gdb:
                does(gdb)
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=come)
    thread.start()
    yield
    thread.join(DEADLINE_S)
    assert not failed, failed
    assert not thread.is_alive()


@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_run_that_was_stopped_says_what_it_says_without(link: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["run", "quad", "--board", "virtual", "--live", "--seconds", "1", "--link", link, "--json"]
    assert main(command) == ExitCode.GOOD
    alone = json.loads(capsys.readouterr().out)
    with debugger():
        assert main([*command, "--gdb", "0"]) == ExitCode.GOOD
    stopped = capsys.readouterr()
    assert json.loads(stopped.out) == alone
    assert alone["metrics"]["target_vs_fixed_mismatches"] == 0
    assert "waits for gdb: gdb-multiarch" in stopped.err


def test_a_fault_that_was_stopped_in_has_the_same_row(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["faults", "host-silent", "--system", "quad", "--phases", "1", "--json"]
    assert main(command) == ExitCode.GOOD
    alone = json.loads(capsys.readouterr().out)
    with debugger():
        assert main([*command, "--gdb", "0"]) == ExitCode.GOOD
    assert json.loads(capsys.readouterr().out) == alone


def test_a_flight_goes_on_after_a_stop_and_is_not_late(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def look(gdb: GdbClient) -> None:
        gdb.ask("?")
        time.sleep(2)
        stop_some_times(gdb, find_image(images.running("quadrotor")))
        os.kill(os.getpid(), signal.SIGINT)  # the flight ends when the debugger has left, however slow the machine

    with debugger(look):
        command = ["fly", "--board", "virtual", "--gdb", "0", "--seconds", "120", "--out", str(tmp_path), "--json"]
        command += ["--system", "quadrotor"]
        assert main(command) == ExitCode.INTERRUPTED
    said = capsys.readouterr()
    assert "gdb may come: gdb-multiarch" in said.err
    assert json.loads(said.out.splitlines()[-1])["board"] == "virtual"


def test_a_client_of_a_served_board_waits_while_it_stands() -> None:
    """For longer than a board may be silent."""
    command = [sys.executable, "-m", "plumb", "virtual-board", "--system", "quad", "--serial", "tcp:0", "--gdb", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        port = int(process.stderr.readline().rsplit(":", 1)[1].strip().strip("'"))
        name = process.stdout.readline().split("use it as ")[1].split(";")[0]
        stood: list[bool] = []

        def stand() -> None:
            with GdbClient(port) as gdb:
                gdb.ask("?")
                time.sleep(SILENT_S)
                gdb.ask("D")
            stood.append(True)

        thread = threading.Thread(target=stand)
        with plumb.connect(name) as board:
            for sample in board.stream():
                if thread.ident is None:
                    first_s = sample.time_s
                    thread.start()
                if stood:
                    break
        thread.join(DEADLINE_S)
        assert stood
        assert sample.time_s - first_s < SILENT_S, "its time stood"
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=DEADLINE_S)


def test_a_taken_port_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert main(["run", "quad", "--board", "virtual", "--gdb", port]) == ExitCode.LINK_TROUBLE
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"plumb: gdb cannot be served at port {port}")
    assert "\n" not in said


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("run quad --board native --gdb 0", "--gdb is for board virtual"),
        ("fly --gdb 0", "--gdb is for board virtual"),
        ("virtual-board --port native --gdb 0", "--gdb and --vcd are for --port f103"),
        ("run quad --board virtual --gdb 70000", "port 70000"),
    ],
)
def test_where_there_is_no_chip_to_stop(command: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command.split()) in (ExitCode.WRONG_USE, ExitCode.LINK_TROUBLE)
    assert said in capsys.readouterr().err


def test_a_test_of_the_plugin_stands_until_gdb_has_come(tmp_path: Path) -> None:
    test = tmp_path / "test_mine.py"
    test.write_text(
        "def test_mine(plumb_board):\n"
        "    result = plumb_board.run('quad', seconds=1)\n"
        "    assert result.verdict == 'pass'\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(test)]
    process = subprocess.Popen(
        [*command, "--plumb-board", "virtual", "--plumb-gdb", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert process.stderr is not None
    line = process.stderr.readline()
    assert "waits for gdb" in line, line
    with GdbClient(int(line.rsplit(":", 1)[1].strip().strip("'"))) as gdb:
        stop_some_times(gdb)
    out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, out + err
