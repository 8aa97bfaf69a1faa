"""A reader of foreign files is ended at its limits, with one sentence, and hands over what it read before."""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.files import reader_process
from plumb.files.bounded_reader import MIB, Limits, pieces_of
from plumb.readers.log_replay import open_log

SMALL = Limits(cpu_s=(60.0, 0.0), memory_bytes=(200 * MIB, 0), output_bytes=(1 * MIB, 0), written_bytes=(4 * MIB, 0))
BRIEF = replace(SMALL, cpu_s=(0.5, 0.0))
"""For the reader that loops: the others must meet their own limit first, however slow the machine."""


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file; the reader's process finds the readers of the tests."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[1]))
    file = tmp_path / "a file"
    file.write_bytes(b"some content")
    return file


def read(reader: str, path: Path) -> list[bytes]:
    limits = BRIEF if reader == "loop" else SMALL
    return list(pieces_of(f"support.endless_readers:{reader}", path, "give another", limits))


def test_pieces_arrive_in_order_and_nothing_that_a_library_prints(path: Path) -> None:
    assert read("content", path) == [b"som", b"e content"]


@pytest.mark.parametrize(
    ("reader", "says"),
    [
        ("loop", "takes longer to read than a file of its size can: it is damaged, or was made to; give another"),
        ("memory", "takes more than 200 MiB of memory to read: it is damaged, or was made to; give another"),
        ("output", "expands to more than a file of its size can hold; give another"),
        ("writes", r"is damaged, or no such file \(OSError\); give another"),
        ("refuses", "is not what it should be; mend it"),
        ("raises", r"\(ZeroDivisionError\); give another"),
        ("recurses", r"\(RecursionError\); give another"),
        ("dies", r"is damaged: its reader failed \(exit code 9\); give another"),
    ],
)
def test_a_reader_ends_at_its_limit_with_one_sentence(reader: str, says: str, path: Path) -> None:
    with pytest.raises(UsageError, match=says) as caught:
        read(reader, path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_the_thread_alone_holds_memory_and_time_where_the_system_does_not(
    path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As on Windows, which has no such limits: a module in the reader's process that takes them away."""
    (tmp_path / "sitecustomize.py").write_text("import resource\nresource.setrlimit = lambda kind, limits: None\n")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}")
    for reader, says in (("loop", "takes longer"), ("memory", "200 MiB of memory")):
        with pytest.raises(UsageError, match=says):
            read(reader, path)


def test_temporary_files_of_a_reader_that_was_ended_are_removed(path: Path) -> None:
    pieces = pieces_of("support.endless_readers:writes", path, "", SMALL)
    folder = Path(next(pieces).decode())
    assert folder.is_dir() and folder != Path(tempfile.gettempdir())
    pieces.close()
    assert not folder.exists()


def test_limits_grow_with_the_file() -> None:
    cpu_s, memory, output, written = Limits().of(400 * MIB)
    assert (cpu_s, memory, output, written) == (2005.0, 912 * MIB, 12816 * MIB, 816 * MIB)
    assert reader_process.HEAD.size == 5


def blf(objects: bytes, *, compressed: bool = True) -> bytes:
    """A BLF file with one container."""
    head = struct.pack("<4sLBBBBBBBBQQLL", b"LOGG", 144, 5, 0, 0, 0, 2, 6, 8, 1, 0, 0, 1, 0)
    times = struct.pack("<16H", *(2024, 1, 1, 1, 0, 0, 0, 0) * 2)
    packed = zlib.compress(objects, 1) if compressed else objects
    body = struct.pack("<H6xL4x", 2 if compressed else 0, len(objects)) + packed
    container = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(body), 10) + body
    return head + times + bytes(144 - len(head + times)) + container + bytes(len(container) % 4)


def frame_object(size: int = 48, version: int = 1) -> bytes:
    """A CAN message of BLF; size, version: of its header, as they are stated."""
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, version, size, 86, 2, 0, 0, 10**9)
    return head + struct.pack("<HBBL8s", 1, 0, 8, 0x100, bytes(8))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objects", "compressed", "says"),
    [
        (frame_object(size=0, version=3), False, "takes longer to read than"),  # the next object is itself
        (frame_object(size=0), True, "expands to more than a file of its size"),  # one frame without end
        (frame_object() * 500_000, True, "expands to more than a file of its size"),
        (bytes(600 * MIB), True, "takes more than"),
    ],
    ids=["a loop", "endless frames", "a bomb of frames", "a bomb of zeros"],
)
def test_a_small_blf_that_would_take_minutes_or_gigabytes(
    objects: bytes, compressed: bool, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a fifth of the time for the loop alone; the output ends at a 32nd, on a slow machine long before it."""
    shipped = Limits.of

    def of(limits: Limits, size: int) -> tuple[float, int, int, int]:
        cpu_s, memory, output, written = shipped(limits, size)
        return (cpu_s if compressed else cpu_s / 5), memory, output // 32, written

    monkeypatch.setattr(Limits, "of", of)
    path = tmp_path / "small.blf"
    path.write_bytes(blf(objects, compressed=compressed))
    with pytest.raises(UsageError, match=says):
        open_log(path)


def test_a_blf_of_this_test_is_good_when_its_sizes_are(tmp_path: Path) -> None:
    path = tmp_path / "good.blf"
    path.write_bytes(blf(frame_object() * 3))
    assert open_log(path).count == 3
