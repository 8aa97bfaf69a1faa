"""`plumb virtual-board` as a process of its own: one line says where it is, Ctrl-C is 130, SIGTERM a plain end."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.errors import UsageError
from plumb.f103.image import find_image

pytest.importorskip("unicorn", reason="the virtual board needs the extra plumb[virtual]")
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
        _, complaint = process.communicate(timeout=60)
    assert process.returncode == code
    assert said in complaint and len(complaint.splitlines()) <= 1


@pytest.mark.parametrize("where", ["tcp:99999", "tcp:", "usb", "tcp:4000:1"])
def test_no_way_to_serve_is_wrong_use(where: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--serial", where]) == 2
    assert "pty or tcp:PORT" in capsys.readouterr().err


def test_an_image_that_does_not_boot_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stub = tmp_path / "half.bin"
    stub.write_bytes(IMAGE.read_bytes()[:6000])
    assert front.main(["run", "quad", "--board", "virtual", "--image", str(stub), "--seconds", "2"]) in (2, 3)
    complaint = capsys.readouterr().err
    assert "half.bin" in complaint and "UartStream" not in complaint and len(complaint.splitlines()) == 1
