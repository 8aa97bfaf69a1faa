"""Decode a file of frames of another tool. Runs in the process that `plumb.files.bounded_reader` starts.

Text is read by the parsers of `plumb.link.frame_formats`: those of python-can end at a cut line or a comment in another
encoding, and take relative times as absolute. BLF and MF4 are read by python-can.
"""

from __future__ import annotations

import gzip
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from plumb.errors import UsageError, counted
from plumb.link.frame_formats import table, text_file
from plumb.link.frame_formats.records import LineReader

BLOCK_FRAMES = 4096
FRAMES, NOTE = b"F", b"N"
"""First byte of a piece: records follow, or a sentence for the user, UTF-8."""


def pieces(path: Path) -> Iterator[bytes]:
    """The records of a file's frames, and notes on how it was read. Raises UsageError, and what the libraries raise."""
    found = table.format_of(path)
    if found is None:
        raise UsageError(
            f"{path} holds no frames in a format that plumb reads ({table.NAMES}); convert it, for example by "
            "`python -m can.logconvert` or SavvyCAN"
        )
    waiting: list[bytes] = []
    classic = 0
    reader = _Text(path, found) if found.reader is not None else _Binary(path, found)
    for record in reader.records():
        waiting.append(record)
        if len(waiting) == BLOCK_FRAMES:
            yield FRAMES + b"".join(waiting)
            classic += len(waiting)
            waiting.clear()
    if waiting:
        yield FRAMES + b"".join(waiting)
    elif not classic and reader.fd:
        raise UsageError(
            f"{path} holds {counted(reader.fd, 'frame')} of CAN FD and no classic one: plumb's are classic frames"
        )
    for note in reader.notes:
        yield NOTE + note.encode("utf-8", "replace")


class _Text:
    """A file of lines. fd: frames of CAN FD that were left out; notes: sentences for the user."""

    def __init__(self, path: Path, found: table.Format) -> None:
        self.fd = 0
        self.notes: list[str] = []
        self._path, self._format = path, found

    def records(self) -> Iterator[bytes]:
        assert self._format.reader is not None
        reader = self._format.reader(lambda: (line for line, _ in text_file.lines_of(self._path)))
        number = 0
        try:
            for number, (line, whole) in enumerate(text_file.lines_of(self._path), 1):
                if not whole:
                    self._last(reader, line, number)
                    break
                record = reader.record(line)
                if record is not None:
                    yield record
        except ValueError as error:
            where = f"{self._path}: line {number} is no whole frame of {self._format.name}"
            raise UsageError(f"{where}: {error}; mend or delete the line") from None
        self.fd = reader.fd
        self.notes += [f"{self._path.name}: {reader.note}"] if reader.note else []

    def _last(self, reader: LineReader, line: str, number: int) -> None:
        """A last line without an end: a frame in it may lack bytes that nobody misses."""
        try:
            cut = reader.record(line) is not None or not line
        except ValueError:
            cut = True
        if cut:
            self.notes.append(f"{self._path.name} is cut in line {number}: it is read up to the last whole line")


class _Binary:
    """A file that a library reads."""

    def __init__(self, path: Path, found: table.Format) -> None:
        self.fd = 0
        self.notes: list[str] = []
        self._path, self._format = path, found

    def records(self) -> Iterator[bytes]:
        if self._format is not table.MF4:
            sys.modules["asammdf"] = None  # type: ignore[assignment]  # python-can loads it, and it pandas: seconds
        import can
        from can.io.mf4 import MF4Reader

        from plumb.link.frame_records import packed

        kind = MF4Reader if self._format is table.MF4 else can.BLFReader
        with tempfile.TemporaryDirectory() as folder, kind(self._expanded(Path(folder))) as messages:
            for message in messages:
                if message.is_fd or len(message.data or b"") > 8:
                    self.fd += 1
                else:
                    yield packed(message)

    def _expanded(self, folder: Path) -> Path:
        """The file, or a copy of what a compressed one holds; of one that is cut, of what came before."""
        with self._path.open("rb") as file:
            if file.read(len(text_file.GZIP)) != text_file.GZIP:
                return self._path
        copy = folder / f"expanded{self._format.suffixes[0]}"
        with gzip.open(self._path, "rb") as packed_file, copy.open("wb") as out:
            try:
                while part := packed_file.read1():
                    out.write(part)
            except EOFError:
                self.notes.append(f"{self._path.name} is cut: it is read up to the last whole part")
        return copy
