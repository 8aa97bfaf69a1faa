"""A small program for the simulated chip, and its results in RAM."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

RESULTS_OFFSET = 0


class RunningProgram:
    """A machine with one of the small programs, and its results in RAM."""

    def __init__(self, elf: Path, **options: Any) -> None:
        from plumb.f103 import Machine

        self.machine = Machine(elf, **options)

    def result(self, index: int) -> int:
        return int(struct.unpack_from("<I", self.machine.cpu.ram, RESULTS_OFFSET + 4 * index)[0])

    def ask(self, index: int, value: int) -> None:
        struct.pack_into("<I", self.machine.cpu.ram, RESULTS_OFFSET + 4 * index, value)


NewBoard = Callable[..., RunningProgram]
"""Name of a program in tests/f103, and options of the machine -> a board that runs it."""
