"""Which programs have a device open, from /proc of Linux; elsewhere nothing is known."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")


@dataclass(frozen=True)
class Holder:
    """A process that has the device open."""

    process: int
    program: str

    def __str__(self) -> str:
        return f"{self.program} (process {self.process})"


def holders(device: str, proc: Path = PROC) -> list[Holder]:
    """The processes that have the device open. Of other users' processes only root sees the open files."""
    with contextlib.suppress(OSError, ValueError):
        target = Path(device).resolve()
        return [
            Holder(int(process.name), program_of(process))
            for process in sorted(proc.glob("[0-9]*"))
            if _has_open(process, target)
        ]
    return []


def _has_open(process: Path, target: Path) -> bool:
    found = False
    with contextlib.suppress(OSError):
        for descriptor in (process / "fd").iterdir():
            with contextlib.suppress(OSError):
                found = found or descriptor.readlink() == target
    return found


def program_of(process: Path) -> str:
    """The short name of the program that a folder of /proc is about; "" when the process has gone."""
    with contextlib.suppress(OSError):
        return (process / "comm").read_text(errors="replace").strip()
    return ""


def running(programs: set[str], proc: Path = PROC) -> list[Holder]:
    """The processes of these programs."""
    found = [(process, program_of(process)) for process in sorted(proc.glob("[0-9]*"))]
    return [Holder(int(process.name), name) for process, name in found if name in programs]
