"""A file of blocks that only grows: each block has its length, a number and a CRC-32, so that a cut file is good up to
its last whole block, and damage costs the blocks that it hits.

    first line   the magic text of the format and a newline
    then blocks, little endian, without gaps:
        4 bytes   MARKER
        uint32    bytes of the payload, at most MAX_PAYLOAD_BYTES
        uint32    number of the block: 0, 1, 2, ...
        4 bytes   kind, ASCII letters
        payload
        uint32    CRC-32 of all of the block before it

The format of the payloads belongs to who uses the file (docs/reference/log.md).
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
import threading
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Self

from plumb.errors import UsageError
from plumb.files import input_files

MARKER = b"\xf5PLB"
"""Begins a block. 0xF5 is no byte of UTF-8 text, so that no payload of text holds it."""
HEADER = struct.Struct("<4sII4s")
CRC_BYTES = 4
MAX_PAYLOAD_BYTES = 1 << 20
MAX_TRIES = 1000
"""Places that look like a block, tried after damage, before a file is given up: each costs reading a block."""
_SEARCH_BYTES = 1 << 20


@dataclass(frozen=True)
class Block:
    """One whole block. kind: four letters; offset: of its first byte in the file."""

    number: int
    kind: str
    payload: bytes
    offset: int


@dataclass(frozen=True)
class Damage:
    """Bytes of a file, [start, end), that belong to no whole block. at_end: nothing whole follows."""

    start: int
    end: int
    at_end: bool


def sealed(number: int, kind: str, payload: bytes) -> bytes:
    """The bytes of a block."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise ValueError(f"a payload of {len(payload)} bytes is too long for a block")
    block = HEADER.pack(MARKER, len(payload), number, kind.encode("ascii")) + payload
    return block + zlib.crc32(block).to_bytes(CRC_BYTES, "little")


class BlockWriter:
    """Writes a new file, a block with each call; every whole block is handed to the operating system at once, so that a
    killed process loses none of them. Raises UsageError when the file exists, unless `replace`, or cannot be written.

    sync_every_s: a thread writes the file through to the disk at this interval, so that a machine that crashes, or
    whose power fails, loses no more than that; None: only `close` does. The caller of `append` never waits for the
    disk: it may be the one who keeps a board armed.
    """

    def __init__(self, path: Path, magic: str, *, replace: bool = False, sync_every_s: float | None = None) -> None:
        self._path, self._number, self._end = path, 0, 0
        with self._sentences():
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                self._file = path.open("wb" if replace else "xb", buffering=0)
            except FileExistsError:
                raise UsageError(exists_sentence(path)) from None
        self._write(magic.encode("ascii") + b"\n")
        self._closing, self._sync_error = threading.Event(), ""
        self._syncing = threading.Thread(target=self._keep_synced, args=(sync_every_s,), name="sync", daemon=True)
        if sync_every_s is not None:
            self._syncing.start()

    def _keep_synced(self, every_s: float) -> None:
        """Runs in a thread of its own."""
        _sync_folder(self._path.parent)
        synced = 0
        while not self._closing.wait(every_s):
            end = self._end
            if end != synced:
                try:
                    _sync(self._file.fileno())
                except OSError as error:
                    self._sync_error = error.strerror or str(error)
                    return
                synced = end

    @contextlib.contextmanager
    def _sentences(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise UsageError(f"{self._path} cannot be written: {reason}; what was written before is kept") from None

    def append(self, kind: str, payload: bytes) -> None:
        """Write one block. After an error the file ends with the last whole block."""
        if self._sync_error:
            raise UsageError(
                f"{self._path} cannot be written: {self._sync_error}; what was written before may be damaged"
            )
        self._write(sealed(self._number, kind, payload))
        self._number += 1

    def _write(self, data: bytes) -> None:
        with self._sentences():
            try:
                view = memoryview(data)
                while view:
                    view = view[self._file.write(view) or 0 :]
            except OSError:
                with contextlib.suppress(OSError):
                    self._file.truncate(self._end)
                raise
        self._end += len(data)

    def close(self) -> None:
        """Write the file to the disk and close it. Raises UsageError when that fails or the file was deleted."""
        self._closing.set()
        if self._syncing.ident is not None:
            self._syncing.join()
        with self._sentences(), self._file:
            _sync(self._file.fileno())
        if not self._path.exists():
            raise UsageError(f"{self._path} was deleted while it was written: nothing is kept, record again")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _sync(descriptor: int) -> None:
    """Write a file through to the disk. Raises OSError."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a device has nothing to write back
            raise


def _sync_folder(folder: Path) -> None:
    """Write a folder's entries to the disk, so that a new file keeps its name; nothing where the system cannot."""
    with contextlib.suppress(OSError, AttributeError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def exists_sentence(path: Path) -> str:
    """Why a file that exists is not written."""
    return f"{path} exists: choose another name, or give --force to replace it"


def read_blocks(path: Path, magic: str, advice: str) -> Iterator[Block | Damage]:
    """Every whole block in the order of the file, and between them the damaged places.

    Raises UsageError, with the advice, for a file that does not begin with the magic text, or that is damaged in too
    many places.
    """
    input_files.check_regular(path, advice)
    try:
        with path.open("rb") as file:
            begin = file.read(len(magic) + 1)
            if begin != magic.encode("ascii") + b"\n":
                raise UsageError(f"{path} does not begin with '{magic}'; {advice}")
            yield from _Reader(file, f"{path} is damaged in more than {MAX_TRIES} places; {advice}").blocks()
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}; {advice}") from None


class _Reader:
    """Reads blocks. tries: places of a marker that began no whole block; each costs reading a block."""

    def __init__(self, file: IO[bytes], too_many: str) -> None:
        self._file, self._too_many, self._tries = file, too_many, 0

    def blocks(self) -> Iterator[Block | Damage]:
        at = self._file.tell()
        while True:
            block = self._block_at(at)
            if block is not None:
                yield block
                at += HEADER.size + len(block.payload) + CRC_BYTES
                continue
            end = self._file.seek(0, os.SEEK_END)
            if at >= end:
                return
            found = self._next_whole(at + 1)
            yield Damage(at, end if found is None else found, at_end=found is None)
            if found is None:
                return
            at = found

    def _block_at(self, at: int) -> Block | None:
        """The block that begins at an offset; None when no whole one does."""
        self._file.seek(at)
        header = self._file.read(HEADER.size)
        if len(header) < HEADER.size:
            return None
        marker, size, number, kind = HEADER.unpack(header)
        if marker != MARKER or size > MAX_PAYLOAD_BYTES or not kind.isalpha():
            return None
        rest = self._file.read(size + CRC_BYTES)
        crc = zlib.crc32(rest[:size], zlib.crc32(header))
        if len(rest) < size + CRC_BYTES or crc != int.from_bytes(rest[size:], "little"):
            return None
        return Block(number, kind.decode("ascii"), rest[:size], at)

    def _next_whole(self, at: int) -> int | None:
        """Offset of the next whole block from an offset on; None when there is none."""
        while True:
            self._file.seek(at)
            part = self._file.read(_SEARCH_BYTES)
            if len(part) < len(MARKER):
                return None
            place = part.find(MARKER)
            if place < 0:
                at += len(part) - len(MARKER) + 1
                continue
            self._tries += 1
            if self._tries > MAX_TRIES:
                raise UsageError(self._too_many)
            if self._block_at(at + place) is not None:
                return at + place
            at += place + 1
