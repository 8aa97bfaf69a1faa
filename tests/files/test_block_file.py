"""A file of blocks is good up to its last whole block, wherever it was cut; damage costs the blocks that it hits."""

from __future__ import annotations

import errno
import os
import stat
import threading
import time
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.files import block_file
from plumb.files.block_file import CRC_BYTES, HEADER, MARKER, Block, BlockWriter, Damage, read_blocks, sealed

MAGIC = "a format 1"
PAYLOADS = (b"", b"first", MARKER, MARKER + bytes(12), bytes(range(256)), b"last")
"""With the marker inside a payload, as the frames of a recording may have it."""


def written(path: Path) -> bytes:
    with BlockWriter(path, MAGIC) as blocks:
        for payload in PAYLOADS:
            blocks.append("DATA", payload)
    return path.read_bytes()


def ends() -> list[int]:
    """Offsets at which a whole block ends, the first being that of the magic line."""
    found = [len(MAGIC) + 1]
    for payload in PAYLOADS:
        found.append(found[-1] + HEADER.size + len(payload) + CRC_BYTES)
    return found


def read(path: Path) -> tuple[list[Block], list[Damage]]:
    found = list(read_blocks(path, MAGIC, "give another"))
    return [one for one in found if isinstance(one, Block)], [one for one in found if isinstance(one, Damage)]


def test_what_is_written_is_read(tmp_path: Path) -> None:
    written(tmp_path / "file")
    blocks, damages = read(tmp_path / "file")
    assert [(block.number, block.kind, block.payload) for block in blocks] == [
        (number, "DATA", payload) for number, payload in enumerate(PAYLOADS)
    ]
    assert damages == [] and [block.offset for block in blocks] == ends()[:-1]


def test_a_file_cut_at_any_byte_is_read_up_to_its_last_whole_block(tmp_path: Path) -> None:
    whole, path = written(tmp_path / "whole"), tmp_path / "cut"
    for size in range(len(whole) + 1):
        path.write_bytes(whole[:size])
        if size < ends()[0]:
            with pytest.raises(UsageError, match="does not begin with 'a format 1'; give another"):
                read(path)
            continue
        blocks, damages = read(path)
        kept = [end for end in ends()[1:] if end <= size]
        assert [block.payload for block in blocks] == list(PAYLOADS[: len(kept)])
        last = [ends()[0], *kept][-1]
        assert damages == ([] if size == last else [Damage(last, size, at_end=True)])


def test_a_flipped_bit_costs_its_block_alone(tmp_path: Path) -> None:
    whole, path = written(tmp_path / "whole"), tmp_path / "flipped"
    for place in range(ends()[0], len(whole)):
        hit = next(number for number, end in enumerate(ends()[1:]) if place < end)
        for bit in range(8):
            data = bytearray(whole)
            data[place] ^= 1 << bit
            path.write_bytes(data)
            blocks, damages = read(path)
            assert [block.number for block in blocks] == [n for n in range(len(PAYLOADS)) if n != hit], (place, bit)
            assert damages == [Damage(ends()[hit], ends()[hit + 1], at_end=hit == len(PAYLOADS) - 1)]


def test_a_file_that_exists_is_kept_unless_it_is_to_be_replaced(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"of value")
    with pytest.raises(UsageError, match=r"file exists: choose another name, or give --force to replace it"):
        BlockWriter(path, MAGIC)
    assert path.read_bytes() == b"of value"
    BlockWriter(path, MAGIC, replace=True).close()
    assert read(path) == ([], [])


def test_a_disk_that_becomes_full_leaves_whole_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last write takes some bytes before it fails, as on a disk with a few left."""
    path = tmp_path / "file"
    blocks = BlockWriter(path, MAGIC)
    blocks.append("DATA", b"kept")

    class Full:
        def __init__(self) -> None:
            self.file, self.room = blocks._file, 10

        def write(self, data: memoryview) -> int:
            if not self.room:
                raise OSError(errno.ENOSPC, "No space left on device")
            size, self.room = self.file.write(data[: self.room]) or 0, 0
            return size

        def truncate(self, size: int) -> int:
            return self.file.truncate(size)

    monkeypatch.setattr(blocks, "_file", Full())
    with pytest.raises(UsageError, match="cannot be written: No space left on device; what was written before is kept"):
        blocks.append("DATA", b"lost")
    found, damages = read(path)
    assert [block.payload for block in found] == [b"kept"] and damages == []


def test_what_was_written_goes_through_to_the_disk_while_the_file_grows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once for everything that was appended, never for nothing, and in a thread of its own."""
    synced: list[tuple[int, str]] = []
    done, path = threading.Event(), tmp_path / "file"

    def noted(descriptor: int) -> None:
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            synced.append((path.stat().st_size, threading.current_thread().name))
            done.set()

    monkeypatch.setattr(os, "fsync", noted)
    with BlockWriter(path, MAGIC, sync_every_s=0.001) as writer:
        for number in range(3):
            assert done.wait(20.0) or not number
            done.clear()
            writer.append("DATA", bytes(100))
            size = path.stat().st_size
            assert done.wait(20.0) and synced[-1] == (size, "sync")
        time.sleep(0.02)
        assert len(synced) <= 4, "the first line, and each block"
    assert synced[-1][1] == "MainThread"


def test_a_disk_that_fails_behind_the_recorder_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failed = threading.Event()

    def fails(descriptor: int) -> None:
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            failed.set()
            raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fails)
    writer = BlockWriter(tmp_path / "file", MAGIC, sync_every_s=0.001)
    assert failed.wait(20.0)
    writer._syncing.join()
    with pytest.raises(UsageError, match=r"file cannot be written: Input/output error"):
        writer.append("DATA", b"")
    with pytest.raises(UsageError, match=r"file cannot be written: Input/output error"):
        writer.close()


def test_a_file_that_was_deleted_while_it_was_written_is_no_success(tmp_path: Path) -> None:
    blocks = BlockWriter(tmp_path / "file", MAGIC)
    (tmp_path / "file").unlink()
    with pytest.raises(UsageError, match="was deleted while it was written"):
        blocks.close()


def test_a_claim_of_a_giant_block_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "file"
    written(path)
    with path.open("ab") as file:
        file.write(
            HEADER.pack(MARKER, block_file.MAX_PAYLOAD_BYTES + 1, 6, b"DATA") + b"x" * 100 + sealed(7, "DATA", b"")
        )
    blocks, damages = read(path)
    assert [block.number for block in blocks] == [0, 1, 2, 3, 4, 5, 7] and len(damages) == 1


def test_a_file_made_of_markers_is_given_up_soon(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(MAGIC.encode() + b"\n" + HEADER.pack(MARKER, 1000, 0, b"DATA") * 5000)
    with pytest.raises(UsageError, match="damaged in more than 1000 places; give another"):
        read(path)


@pytest.mark.parametrize("made", ["folder", "missing", "pipe"])
def test_no_regular_file_is_one_sentence(tmp_path: Path, made: str) -> None:
    import os

    path = tmp_path / "file"
    if made == "folder":
        path.mkdir()
    elif made == "pipe":
        os.mkfifo(path)
    with pytest.raises(UsageError, match=r"cannot read .*; give another"):
        read(path)
