"""The parameters of a served board in a file, so that they outlive the process as flash outlives a power cycle.

The file is an image of both parameter slots. It is written when the board has written its flash and then left it alone
for one turn. Writing is atomic: when the process is killed, the file of the last save stays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.files.input_files import read_bytes
from plumb.files.whole_files import require_writable, write_whole
from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SLOTS_BYTES = 4096


def read_slots(path: Path) -> bytes:
    """Contents of the file, b"" when there is none yet; raises UsageError for a file that holds something else, and
    when its folder does not exist, or the file could not be written."""
    if not path.parent.is_dir():
        raise UsageError(f"there is no folder {path.parent} to keep {path.name} in; make it, or choose another file")
    require_writable(path, "choose another file")
    if not path.exists():
        return b""
    slots = read_bytes(path, SLOTS_BYTES, "choose another file")
    if len(slots) != SLOTS_BYTES:
        raise UsageError(f"{path} holds no parameters of a served board; choose another file")
    return slots


class KeptSlots(ABC):
    """Call look() between two turns of the board, and write() after the last."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen = self._written = self.operations()

    @abstractmethod
    def operations(self) -> int:
        """Pages erased and half-words programmed so far."""

    @abstractmethod
    def slots(self) -> bytes:
        """Present contents of both slots."""

    def busy(self) -> bool:
        """True while an operation is under way."""
        return False

    def look(self) -> None:
        """Write the file if the flash has changed and is idle since the last call; raises UsageError when the file
        cannot be written."""
        if self.operations() != self._seen or self.busy():
            self._seen = self.operations()
        else:
            self.write()

    def write(self) -> None:
        """Write the file at once if the flash has changed."""
        if self._written == self.operations():
            return
        self._written = self.operations()
        write_whole({self._path: self.slots()}, "choose another file")


class MachineSlots(KeptSlots):
    """The parameter slots of a simulated chip."""

    def __init__(self, machine: Machine, path: Path) -> None:
        self._machine = machine
        super().__init__(path)

    def operations(self) -> int:
        return self._machine.flash.operations

    def busy(self) -> bool:
        return bool(self._machine.flash.busy)

    def slots(self) -> bytes:
        start = PARAMETER_SLOTS - FLASH_BASE
        return bytes(self._machine.cpu.flash[start : start + SLOTS_BYTES])
