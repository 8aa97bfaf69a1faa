"""The parameters of a served board in a file, so that they outlive the process as flash outlives the power.

The file holds both slots of the flash as they are. It is written when the board has written its flash and then left it
alone for a turn, as a whole or not at all: killed in between, the process leaves what the last save left.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.files.input_files import read_bytes
from plumb.files.whole_files import write_whole
from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SLOTS_BYTES = 4096


def read_slots(path: Path) -> bytes:
    """What was kept, or nothing yet; raises UsageError for another file."""
    if not path.exists():
        return b""
    slots = read_bytes(path, SLOTS_BYTES, "choose another file")
    if len(slots) != SLOTS_BYTES:
        raise UsageError(f"{path} holds no parameters of a served board; choose another file")
    return slots


class KeptSlots:
    """Call look() between two turns of the machine, and write() after the last."""

    def __init__(self, machine: Machine, path: Path) -> None:
        self._machine, self._path = machine, path
        self._seen = self._written = machine.flash.operations

    def look(self) -> None:
        """Write the file when the flash was written; raises UsageError where that cannot be."""
        flash = self._machine.flash
        if flash.operations != self._seen or flash.busy:
            self._seen = flash.operations
        else:
            self.write()

    def write(self) -> None:
        """The same at once."""
        if self._written == self._machine.flash.operations:
            return
        self._written = self._machine.flash.operations
        start = PARAMETER_SLOTS - FLASH_BASE
        slots = bytes(self._machine.cpu.flash[start : start + SLOTS_BYTES])
        write_whole({self._path: slots}, "choose another file")
