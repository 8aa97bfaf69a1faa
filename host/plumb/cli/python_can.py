"""python-can as the commands want it: without its classes for MF4, which load asammdf and pandas at once.

That takes more processor time than the rest of a command.

plumb writes MF4 by asammdf itself, and reads it in a process of its own (`plumb.link.foreign_frames`).
"""

from __future__ import annotations

import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec

MF4 = "can.io.mf4"


class _NoAsammdf(MetaPathFinder):
    """Makes asammdf look missing to python-can's MF4 module, and to no other importer."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name == "asammdf" and MF4 in sys.modules and not hasattr(sys.modules[MF4], "MF4Writer"):
            raise ModuleNotFoundError(f"No module named {name!r} for {MF4}", name=name)
        return None


def load_without_mf4() -> None:
    """From now on in this process, which is to be of plumb alone."""
    sys.meta_path.insert(0, _NoAsammdf())
