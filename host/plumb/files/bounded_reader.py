"""Read a foreign file in a process of its own, whose processor time, memory, output and temporary files are bounded.

Files of other tools are decoded by other people's libraries. A damaged or hostile file can make a library loop, or take
any amount of memory: a compressed file of a megabyte expands to a thousand. A reader in a process of its own ends with
one sentence then. The limits grow with the size of the file, so that a large log is read, piece by piece.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from plumb.errors import UsageError
from plumb.files import input_files
from plumb.files.reader_process import END, EXIT_LARGE, EXIT_SLOW, HEAD, PIECE, RAISED, REFUSED

MIB = input_files.MIB
MODULE = "plumb.files.reader_process"


@dataclass(frozen=True)
class Limits:
    """Limits for reading a file: a fixed part, and a part for each MiB (cpu_s) or byte (the others) of the file.

    cpu_s: processor time, after the libraries are loaded. memory_bytes: beyond what the libraries hold. output_bytes:
    of all pieces together. written_bytes: of each temporary file.
    """

    cpu_s: tuple[float, float] = (5.0, 5.0)
    """python-can reads a MiB of frames in 0.3 s (text) to 1.5 s (BLF); the factor is that of a slow machine."""
    memory_bytes: tuple[int, int] = (512 * MIB, 1)
    """A library that maps the file has it in its address space once."""
    output_bytes: tuple[int, int] = (16 * MIB, 32)
    """The shortest frame of a format that is not compressed has 16 bytes, and becomes a record of 22."""
    written_bytes: tuple[int, int] = (16 * MIB, 2)

    def of(self, size: int) -> tuple[float, int, int, int]:
        """cpu_s, memory_bytes, output_bytes and written_bytes for a file of this size."""
        counts = (self.memory_bytes, self.output_bytes, self.written_bytes)
        memory, output, written = (fixed + size * each for fixed, each in counts)
        return self.cpu_s[0] + self.cpu_s[1] * size / MIB, memory, output, written


DEFAULT_LIMITS = Limits()


def pieces_of(
    reader: str,
    path: Path,
    advice: str,
    limits: Limits = DEFAULT_LIMITS,
    text: str | None = None,
    size: int | None = None,
) -> Generator[bytes, None, None]:
    """The pieces that a reader yields for a file. reader: "package.module:function", a generator of bytes that takes
    the path, and `text` where it is given. size: bytes, where the path is a folder of files.
    Closing the iterator ends the process.

    Raises UsageError, with the advice, for a file that the reader refuses, on which it fails, or that exceeds a limit.
    """
    cpu_s, memory, output, written = limits.of(input_files.check_regular(path, advice) if size is None else size)
    with tempfile.TemporaryDirectory(prefix="plumb-") as folder:
        command = [sys.executable, "-P", "-m", MODULE, reader, str(path), str(cpu_s), str(memory), str(written)]
        command += [] if text is None else [text]
        environment = {**os.environ, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder)}
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
        )
        assert process.stdout is not None
        try:
            with process.stdout as pipe:
                kind, data = _next(pipe)
                while kind == PIECE:
                    output -= len(data)
                    if output < 0:
                        raise UsageError(f"{path} expands to more than a file of its size can hold; {advice}")
                    yield data
                    kind, data = _next(pipe)
        except BaseException:
            process.kill()
            raise
        finally:
            code = process.wait()
    if kind == REFUSED:
        raise UsageError(data.decode("utf-8", "surrogatepass"))  # a file's name need not be text
    if kind != END:
        raise UsageError(f"{path} {_failure(path, kind, data, code, memory)}; {advice}")


def _next(pipe: IO[bytes]) -> tuple[bytes, bytes]:
    """The next piece; b"" as its kind when the process has ended without one."""
    head = pipe.read(HEAD.size)
    if len(head) < HEAD.size:
        return b"", b""
    kind, length = HEAD.unpack(head)
    data = pipe.read(length)
    return (kind, data) if len(data) == length else (b"", b"")


def _failure(path: Path, kind: bytes, data: bytes, code: int, memory_bytes: int) -> str:
    """Why a reader gave nothing more, as the rest of a sentence."""
    if kind == RAISED:
        return f"is damaged, or no {path.suffix or 'such'} file ({data.decode('utf-8', 'replace')})"
    if code == EXIT_LARGE:
        return f"takes more than {memory_bytes // MIB} MiB of memory to read: it is damaged, or was made to"
    with contextlib.suppress(ImportError, AttributeError):
        from signal import SIGXCPU  # Windows has none

        code = EXIT_SLOW if code == -SIGXCPU else code
    if code == EXIT_SLOW:
        return "takes longer to read than a file of its size can: it is damaged, or was made to"
    return f"is damaged: its reader failed (exit code {code})"
