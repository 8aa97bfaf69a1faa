"""The process that reads a foreign file for `plumb.files.bounded_reader`: it limits itself, then runs one reader.

    python -P -m plumb.files.reader_process MODULE:FUNCTION FILE CPU_S MEMORY_BYTES WRITTEN_BYTES [TEXT]

The reader is a generator of bytes, which takes the path, and TEXT where there is one. Its pieces go to stdout, each
behind a head of one letter and its length. The system's limits hold where the system has them (Linux: memory and
processor time; macOS: processor time); a thread that looks every WATCH_S holds everywhere.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import signal
import struct
import sys
import threading
import time
from pathlib import Path

from plumb.errors import PlumbError

HEAD = struct.Struct("<cI")
PIECE, END, REFUSED, RAISED = b"P", b"E", b"R", b"X"
"""Bytes of the reader; its end; a sentence with which it refuses the file; the name of another exception."""
EXIT_SLOW, EXIT_LARGE = 75, 76
"""Exit codes: more processor time, or more memory, than the limit."""
WATCH_S = 0.05
AFTER_WATCH_S = 2
"""The system's limit of processor time comes so much later than the thread's, which names the reason."""
_STATM = Path("/proc/self/statm")


def main() -> None:
    reader, path, cpu_s, memory_bytes, written_bytes, *more = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent gets it and ends this process
    out = os.dup(1)
    os.dup2(2, 1)  # a library that prints does not write into the pieces
    module, _, function = reader.partition(":")
    read = getattr(importlib.import_module(module), function)
    threading.Thread(target=_watch, args=(float(cpu_s), int(memory_bytes)), daemon=True).start()
    _limit(float(cpu_s), int(memory_bytes), int(written_bytes))
    kind, last = END, b""
    try:
        for piece in read(Path(path), *more):
            _send(out, PIECE, piece)
    except MemoryError:
        os._exit(EXIT_LARGE)
    except PlumbError as error:
        kind, last = REFUSED, str(error).encode("utf-8", "surrogatepass")
    except Exception as error:  # readers raise many kinds of exceptions for a damaged file
        kind, last = RAISED, type(error).__name__.encode("utf-8", "replace")
    _send(out, kind, last)
    os._exit(0)  # no library's clean-up can hang, or write


def _send(out: int, kind: bytes, data: bytes) -> None:
    view = memoryview(HEAD.pack(kind, len(data)) + data)
    while view:
        view = view[os.write(out, view) :]


def _watch(cpu_s: float, memory_bytes: int) -> None:
    """Runs in a thread of its own: ends the process that exceeds a limit."""
    begin_s, begin_bytes = time.process_time(), _resident_bytes()
    while True:
        time.sleep(WATCH_S)
        if time.process_time() - begin_s > cpu_s:
            os._exit(EXIT_SLOW)
        if _resident_bytes() - begin_bytes > memory_bytes:
            os._exit(EXIT_LARGE)


if sys.platform == "win32":
    import ctypes

    class _MemoryCounters(ctypes.Structure):
        """PROCESS_MEMORY_COUNTERS of psapi.h."""

        _fields_ = (
            ("size", ctypes.c_uint32),
            ("page_faults", ctypes.c_uint32),
            ("peak_working_set", ctypes.c_size_t),
            ("rest", ctypes.c_size_t * 7),
        )

    def _resident_bytes() -> int:
        """Most memory that this process held so far."""
        counters = _MemoryCounters(size=ctypes.sizeof(_MemoryCounters))
        this = ctypes.c_void_p(-1)
        ctypes.windll.kernel32.K32GetProcessMemoryInfo(this, ctypes.byref(counters), counters.size)
        return int(counters.peak_working_set)

    def _limit(cpu_s: float, memory_bytes: int, written_bytes: int) -> None:
        """Windows limits a process only through a job; the thread does it alone."""

else:
    import resource

    def _resident_bytes() -> int:
        """Most memory that this process held so far."""
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else peak * 1024

    def _limit(cpu_s: float, memory_bytes: int, written_bytes: int) -> None:
        """Limits by the system, beyond what this process holds already."""
        seconds = math.ceil(time.process_time() + cpu_s) + AFTER_WATCH_S
        _lower(resource.RLIMIT_CPU, seconds)
        _lower(resource.RLIMIT_FSIZE, written_bytes)
        with contextlib.suppress(OSError):  # macOS has no /proc, and does not hold RLIMIT_AS
            mapped = int(_STATM.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
            _lower(resource.RLIMIT_AS, mapped + memory_bytes)

    def _lower(kind: int, value: int) -> None:
        """A limit that is lower already stays."""
        _, hard = resource.getrlimit(kind)
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (value, hard))


if __name__ == "__main__":
    main()
