"""Used range of every word of a step: the column "worst seen" of docs/reference/arithmetic/kernels.md.

`python -m plumb.proof.ranges [SYSTEM ...]` runs the golden vectors of a checkout, wild inputs included, on the native
core and prints for every word its largest magnitude, in the unit of its name, and how many bits of the word stay free.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.proof import golden
from plumb.spec.records import RECORDS, names_of

_FORMAT = re.compile(r"_q(\d+)(?=_|$)")


@dataclass(frozen=True)
class Used:
    """The largest magnitude of a word. worst: in the unit of its name. free_bits: unused bits, without the sign."""

    name: str
    worst: float
    free_bits: int


def used(system: str) -> Iterator[Used]:
    """Every word of the system's step, over its golden vectors."""
    largest = dict.fromkeys(names_of(system), 0)
    steps = [vector for vector in golden.load(golden.vectors_folder(), [system]) if vector.task is None]
    for vector in steps:
        words = native_core.run_control(vector.params, vector.raw, vector.setpoint)
        for name in largest:
            column = words.record[name]
            largest[name] = max(largest[name], abs(int(column.max())), abs(int(column.min())))
    for name, most in largest.items():
        kind = RECORDS[system][name]
        bits = 8 * kind.itemsize - (kind.kind == "i")
        found = _FORMAT.search(name)
        yield Used(name, most / 2.0 ** int(found[1] if found else 0), max(bits - most.bit_length(), 0))


def _rows(names: Sequence[str]) -> Iterator[str]:
    for name in names:
        yield f"{name}: word, largest magnitude in the unit of its name, bits to spare"
        yield from (f"  {row.name:<32}{row.worst:>12.5g}  {row.free_bits:>3}" for row in used(name))


if __name__ == "__main__":
    for line in _rows(sys.argv[1:] or tuple(systems.SYSTEMS)):
        print(line)
