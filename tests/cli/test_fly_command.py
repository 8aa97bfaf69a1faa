"""`plumb fly` from the command line: its addresses, its end, and wrong use."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb import systems
from support.declared_systems import lacking

PATIENCE_S = 60.0
STEERED = systems.with_part("fly")
flies = pytest.mark.skipif(not STEERED, reason="no declared system has fly.py")


@flies
def test_the_page_is_served_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "plumb", "fly", "--json", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        said = json.loads(process.stdout.readline())
        with urllib.request.urlopen(said["control"], timeout=PATIENCE_S) as answer:
            assert b"steering.js" in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        assert process.stderr.read() == "plumb: interrupted.\n"
        flown = json.loads(process.stdout.read())
    assert flown["flights"] == 0 and flown["reports"] == [] and not list(tmp_path.iterdir())


@flies
def test_it_ends_by_itself_and_says_how_fast_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["fly", "--seconds", "1", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("fly: http://127.0.0.1:") and "0 flights on the native board" in said


@flies
def test_the_simulated_chip_says_that_it_flies_and_how_fast(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["fly", "--board", "virtual", "--seconds", "0.5", "--json", "--out", str(tmp_path)]
    assert front.main(command) == 0
    flown = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert flown["board"] == "virtual" and flown["flights"] == 0 and flown["speed"] > 0.0


@flies
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--port", "70000"], "--port 70000"),
        (["--seconds", "0"], "--seconds 0"),
        (["--seed", "-1"], "seed is 0 or more"),
        (["--image", "none.elf"], "--image is for board virtual"),
        (["--board", "virtual", "--image", "none.elf"], "none.elf"),
        (["--out", "/dev/null"], "cannot record in /dev/null: /dev/null is no folder"),
        (["--out", "/proc/flights"], "cannot write /proc/flights/flight.plog"),
    ],
)
def test_wrong_use_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["fly", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err and len(captured.err.strip().splitlines()) == 1 and not captured.out


@flies
def test_a_port_that_is_taken_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert front.main(["fly", "--port", str(port)]) == 2
    assert f"port {port} cannot be served" in capsys.readouterr().err


@flies
def test_a_browser_that_is_not_there_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    assert front.main(["fly", "--open", "--seconds", "0.5", "--out", str(tmp_path)]) == 0
    assert "no browser was found" in capsys.readouterr().err


@pytest.mark.parametrize("name", lacking("fly")[:1])
def test_a_system_that_nobody_flies_is_wrong_use(name: str) -> None:
    with pytest.raises(SystemExit) as ended:
        front.main(["fly", "--system", name])
    assert ended.value.code == 2
