"""`plumb virtual-board --port native`: a board as a process of its own, with neither Unicorn nor an image."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.link.session import Session
from plumb.spec import declarations
from support.sessions import listen

WITHOUT_UNICORN = "import sys; sys.modules['unicorn'] = None; from plumb.__main__ import main; sys.exit(main())"


@contextlib.contextmanager
def served(*arguments: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The name of the board's UART, and the process."""
    command = [sys.executable, "-c", WITHOUT_UNICORN, "virtual-board", "--port", "native", "--serial", "tcp:0"]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"at (socket://127.0.0.1:\d+)", process.stdout.readline())
        assert found, process.stderr and process.stderr.read()
        try:
            yield found[1], process
        finally:
            process.kill()


def test_golden_vectors_pass_and_ctrl_c_ends_it(capsys: pytest.CaptureFixture[str]) -> None:
    with served() as (address, process):
        assert front.main(["golden", "check", "--board", f"serial:{address}", "--system", "turntable"]) == 0
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
    capsys.readouterr()


@pytest.mark.parametrize("name", [name for name, declared in declarations.systems().items() if declared.is_driven])
def test_it_comes_up_as_a_system_with_its_plant_on_the_sensors(name: str) -> None:
    with served("--system", name) as (address, _), Session.open(address) as session:
        assert "saved in flash" in session.connect().parameter_source
        counts: set[bytes] = set()
        raw = session.protocol["RAW_A"].identifier
        session.listener = lambda frames: counts.update(data for identifier, data in frames if identifier == raw)
        session.begin("REALTIME_LIVE", frames=("RAW_A",))
        listen(session, 0.5)
        assert len(counts) > 3
        session.end()


def test_what_is_saved_is_there_the_next_time(tmp_path: Path) -> None:
    kept = tmp_path / "board.flash"
    for source in ("factory defaults", "saved in flash, number 1"):
        with served("--keep", str(kept)) as (address, process):
            with Session.open(address) as session:
                assert session.connect().parameter_source == source
                if source == "factory defaults":
                    session.execute("SAVE")
                    listen(session, 0.2)
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=60) == 0


@pytest.mark.parametrize("option", ["--image", "--part", "--vcd"])
def test_what_belongs_to_the_chip_is_wrong_use(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--port", "native", option, "stm32f103cb"]) == 2
    assert "--image, --offset, --part, --gdb and --vcd are for --port f103" in capsys.readouterr().err
