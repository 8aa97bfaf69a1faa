"""Readers of foreign files that never end, or take all that they can: what `plumb.files.bounded_reader` must bound."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from plumb.errors import UsageError


def content(path: Path) -> Iterator[bytes]:
    print("a library that prints")
    data = path.read_bytes()
    yield data[:3]
    yield data[3:]


def loop(path: Path) -> Iterator[bytes]:
    yield b"begun"
    while True:
        pass


def memory(path: Path) -> Iterator[bytes]:
    yield b"begun"
    held = []
    while True:
        held.append(b"x" * (1 << 20))


def output(path: Path) -> Iterator[bytes]:
    while True:
        yield bytes(1 << 16)


def writes(path: Path) -> Iterator[bytes]:
    with tempfile.TemporaryFile() as file:
        yield tempfile.gettempdir().encode()
        while True:
            file.write(bytes(1 << 20))
            file.flush()


def refuses(path: Path) -> Iterator[bytes]:
    yield b"begun"
    raise UsageError(f"{path} is not what it should be; mend it")


def raises(path: Path) -> Iterator[bytes]:
    yield b"begun"
    raise ZeroDivisionError


def dies(path: Path) -> Iterator[bytes]:
    yield b"begun"
    os._exit(9)


def recurses(path: Path) -> Iterator[bytes]:
    sys.setrecursionlimit(1000)
    yield b"begun"
    yield from recurses(path)
