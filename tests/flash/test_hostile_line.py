"""`plumb flash` and `plumb link-test` on a line with no board behind it: one sentence, exit code 3, no hang."""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumb.__main__ import main
from plumb.flash import rom_loader
from support.made_image import made_image

pty = pytest.importorskip("pty", reason="the line is a pseudo-terminal")
tty = pytest.importorskip("tty", reason="the line is a pseudo-terminal")
pytest.importorskip("stm32loader", reason="stm32loader is not installed: the extra flash")

PIECE_EVERY_S = 0.005
NOISE = random.Random(19)
LINES: dict[str, Callable[[int], bytes]] = {
    "silence": lambda n: b"",
    "noise": lambda n: NOISE.randbytes(64),
    "always yes": lambda n: b"\x79" * 64,
    "always no": lambda n: b"\x1f" * 64,
    "frames in a flood": lambda n: b"t1008AABBCCDDEEFF0011\r" * 50,
    "half answers": lambda n: b"\r\x79t2A1",
}
"""What comes at the n-th time."""


@pytest.fixture(params=LINES)
def port(request: pytest.FixtureRequest) -> Iterator[str]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    ended = threading.Event()

    def speak() -> None:
        for number in itertools.count():
            if ended.wait(PIECE_EVERY_S):
                return
            with contextlib.suppress(OSError):
                os.read(master, 4096)
            with contextlib.suppress(OSError):
                os.write(master, LINES[request.param](number))

    thread = threading.Thread(target=speak)
    thread.start()
    yield os.ttyname(slave)
    ended.set()
    thread.join()
    os.close(slave)
    os.close(master)


def complaint(capsys: pytest.CaptureFixture[str]) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("plumb: ")]
    assert len(lines) == 1 and len(lines[0]) < 300
    return lines[0]


@pytest.mark.slow
def test_flash_writes_nothing_and_says_so(
    port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rom_loader, "REPLY_S", 0.5)
    monkeypatch.setattr(rom_loader, "SYNC_S", 0.15)
    image = tmp_path / "small.bin"
    image.write_bytes(made_image(2100))
    assert main(["flash", "--port", port, "--image", str(image), "--wait", "1"]) == 3
    assert "incomplete" not in complaint(capsys)


@pytest.mark.slow
def test_link_test_finds_no_board(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["link-test", "--board", f"serial:{port}", "--steps", "100"]) == 3
    assert "the board does not answer" in complaint(capsys)
