"""Files and ports that users name: bounded before they are read, written whole or not at all."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards.flash_file import SLOTS_BYTES, read_slots
from plumb.errors import UsageError
from plumb.files import input_files, whole_files
from plumb.link.transports import serial_ports
from plumb.readers import recording, recording_files
from plumb.readers.imu_files import tables
from plumb.writers.recorder import FrameLog

FULL = Path("/dev/full")
ENDLESS = Path("/dev/zero")
needs_devices = pytest.mark.skipif(not (FULL.exists() and ENDLESS.exists()), reason="no /dev/full and /dev/zero")


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one sentence on stderr."""
    captured = capsys.readouterr()
    assert captured.err.startswith("plumb: ") and captured.err.count("\n") == 1 and captured.out == ""
    return captured.err


# ---- ports ----

BOARDS = ["serial:{}", "serial:{}@115200", "can:slcan:{}", "can:slcan:{}@115200", "can:robotell:{}", "can:serial:{}"]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("scheme", ["spy", "alt", "loop", "hwgrep", "cp2110", "file", "SPY"])
def test_a_url_that_is_no_port_is_refused_and_no_file_is_touched(
    board: str, scheme: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept"
    kept.write_text("as it was")
    spec = board.format(f"{scheme}:///dev/null?file={kept}")
    assert front.main(["monitor", "--board", spec, "--seconds", "1"]) == 2
    assert "socket://HOST:PORT or rfc2217://HOST:PORT" in said(capsys)
    assert kept.read_text() == "as it was"


@pytest.mark.parametrize(
    "arguments",
    [["flash", "--port", "spy://x"], ["record", "--bus", "serial:spy://x", "--out", "no.asc"]],
)
def test_every_command_that_opens_a_port_refuses_it(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(arguments) == 2
    assert "'spy://x' is not opened" in capsys.readouterr().err
    assert not Path("no.asc").exists()


@pytest.mark.parametrize("port", ["/dev/ttyUSB0", "COM3", "\\\\.\\COM12", "socket://host:1", "rfc2217://host:1", "a:b"])
def test_devices_and_ports_over_a_network_pass(port: str) -> None:
    serial_ports.check_port(port)
    with pytest.raises(UsageError, match="is not opened"):
        serial_ports.check_port(f"spy://{port}")


# ---- reading ----

ADVICE = "give another"


def test_a_regular_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert input_files.read_bytes(path, 5, ADVICE) == b"12345"
    with pytest.raises(UsageError, match=r"file: it has more than 4 bytes; give another$"):
        input_files.read_bytes(path, 4, ADVICE)
    with path.open("wb") as sparse:
        sparse.truncate(1 << 40)
    with pytest.raises(UsageError, match=r"more than 3 MiB"):
        input_files.read_bytes(path, 3 << 20, ADVICE)


def test_a_file_longer_than_it_says_is_not_read_beyond_its_limit(tmp_path: Path) -> None:
    if not Path("/proc/self/maps").exists():
        pytest.skip("no /proc")
    with pytest.raises(UsageError, match="more than 10 bytes"):  # its length is said to be 0
        input_files.read_bytes(Path("/proc/self/maps"), 10, ADVICE)


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe", "device"])
def test_what_is_no_file_is_refused_unopened(kind: str, tmp_path: Path) -> None:
    path = tmp_path / kind
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path = ENDLESS
    with pytest.raises(UsageError, match=r"^cannot read .*; give another$"):
        input_files.read_bytes(path, 100, ADVICE)


READERS: dict[str, list[str]] = {
    **{
        f"replay by {name}": ["replay", "FILE", "--system", name, "--board", "native"]
        for name in systems.with_part("replay")
    },
    "compare": ["compare", "FILE"],
    "params": ["params", "load", "FILE", "--board", "virtual"],
    "image": ["run", "quad", "--board", "virtual", "--image", "FILE", "--seconds", "1"],
    "bus": ["record", "--bus", "file:FILE", "--out", "OUT.asc", "--seconds", "1"],
    "keep": ["virtual-board", "--keep", "FILE"],
}


@needs_devices
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["device", "folder", "pipe"])
def test_no_reader_hangs_on_what_never_ends(
    reader: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for suffix in (".npz", ".csv", ".log", ""):
        path = tmp_path / f"{kind}{suffix}"
        if kind == "device":
            path.symlink_to(ENDLESS)
        elif kind == "folder":
            path.mkdir()
        else:
            os.mkfifo(path)
        arguments = [a.replace("FILE", str(path)).replace("OUT", str(tmp_path / "out")) for a in READERS[reader]]
        assert front.main(arguments) == 2
        said(capsys)


def npz(path: Path, names: dict[str, tuple[int, ...]]) -> None:
    """Arrays of zeros of these shapes, without ever holding them: the headers, then nothing but zeros, compressed."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, shape in names.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                np.lib.format.write_array_header_1_0(member, header)
                left, chunk = 8 * int(np.prod(shape, dtype=np.int64)), bytes(1 << 20)
                while left > 0:
                    member.write(chunk[:left])
                    left -= len(chunk)


@pytest.mark.slow
@pytest.mark.parametrize("wide", ["gyr", "ref_quat", "rate_hz", "movement"])
def test_an_array_of_too_many_samples_is_refused_from_its_header(wide: str, tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    many = (1 << 22, 8) if wide == "gyr" else (1 << 24,)
    npz(path, {"gyr": (1000, 3), "acc": (1000, 3), "rate_hz": ()} | {wide: many})
    assert path.stat().st_size < 2 << 20
    tracemalloc.start()
    with pytest.raises(UsageError, match=r"bomb.npz holds more than 2097152 samples: cut it"):
        recording.load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20


def test_stamps_far_apart_do_not_make_more_steps_than_memory(tmp_path: Path) -> None:
    path, samples = tmp_path / "slow.npz", 20_000
    np.savez(path, gyr=np.zeros((samples, 3)), acc=np.full((samples, 3), 5.0), time_s=np.arange(samples) * 0.9)
    with pytest.raises(UsageError, match=r"slow.npz lasts more than 8388608 steps of 500 us: cut it"):
        recording.pick_axis(recording.load(path), "x", 500)


def test_a_long_table_stops_at_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "MOST_SAMPLES", 100)
    path, header = tmp_path / "long.csv", "time_s,gyr_x_dps,gyr_y_dps,gyr_z_dps,acc_x_g,acc_y_g,acc_z_g\n"
    row = ",0,0,0,0,0,1\n"
    path.write_text(header + "".join(f"{0.01 * at:.2f}{row}" for at in range(100)))
    assert list(recording_files.pieces(path))
    path.write_text(header + "".join(f"{0.01 * at:.2f}{row}" for at in range(101)))
    with pytest.raises(UsageError, match="more than 100 samples"):
        list(recording_files.pieces(path))


# ---- writing ----


def test_files_are_written_together_or_left_as_they_were(tmp_path: Path) -> None:
    whole_files.write_whole({tmp_path / "new/a": "text", tmp_path / "new/b": b"\xff"}, ADVICE)
    assert (tmp_path / "new/a").read_text() == "text" and (tmp_path / "new/b").read_bytes() == b"\xff"
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError, match=r"^cannot write .*folder: .*; give another$"):
        whole_files.write_whole({tmp_path / "c": "text", tmp_path / "folder": "text"}, ADVICE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "new"]


SMALL_DISK = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), resource.RLIM_INFINITY))
from plumb.__main__ import entry
entry()
"""
"""No file may grow beyond a limit: what a full disk does, at any byte."""


@pytest.mark.slow
@pytest.mark.parametrize("room", [0, 1000, 30_000])
def test_a_disk_that_is_full_leaves_nothing_half_written(room: int, tmp_path: Path) -> None:
    if not hasattr(resource, "RLIMIT_FSIZE"):
        pytest.skip("no limit of file size")
    out = tmp_path / "out"
    arguments = ["run", "quad", "--board", "native", "--open-loop", "--seconds", "1", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", SMALL_DISK, str(room), *arguments],
        capture_output=True, text=True, timeout=120, check=False, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1 and "cannot write" in done.stderr
    assert list(out.iterdir()) == []


WRITERS: dict[str, Callable[[Path], list[str]]] = {
    "report": lambda path: ["run", "quad", "--board", "native", "--seconds", "1", "--open-loop", "--out", str(path)],
    "record": lambda path: ["record", "--board", "virtual", "--seconds", "0.1", "--out", str(path)],
    "params": lambda path: ["params", "dump", str(path / "file"), "--board", "virtual"],
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_place_that_takes_no_files_is_a_sentence(
    writer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert front.main(WRITERS[writer](tmp_path / "file" / "deeper")) == 2
    said(capsys)


@needs_devices
def test_params_to_a_full_device_are_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["params", "dump", str(FULL), "--board", "virtual"]) == 2
    assert "No space left on device" in said(capsys)


def test_a_log_whose_folder_was_deleted_is_no_success(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "frames.asc"
    log = FrameLog(path)
    log.add_message(can.Message(arbitration_id=1, is_extended_id=False, dlc=0))
    path.unlink()
    path.parent.rmdir()
    with pytest.raises(UsageError, match=r"frames.asc .*deleted"):
        log.close()


def test_a_served_boards_file_has_one_size(tmp_path: Path) -> None:
    path = tmp_path / "board.flash"
    assert read_slots(path) == b""
    path.write_bytes(bytes(SLOTS_BYTES))
    assert read_slots(path) == bytes(SLOTS_BYTES)
    for size in (SLOTS_BYTES - 1, SLOTS_BYTES + 1):
        path.write_bytes(bytes(size))
        with pytest.raises(UsageError, match="choose another file"):
            read_slots(path)
