"""How a text table is written: its encoding, its separator, the line of its header, decimal commas."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from plumb.errors import UsageError
from plumb.readers.imu_files.header_words import Meaning, meaning

HEADER_LINES = 200
"""Lines in which a header is looked for: loggers put comments before it."""
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}


@dataclass(frozen=True)
class Layout:
    """separator: one character; header: its cells; meanings: by the place of a column."""

    separator: str
    header: list[str]
    meanings: dict[int, Meaning]


def encoding_of(path: Path) -> str:
    with path.open("rb") as file:
        return "utf-16" if file.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


def layout_of(line: str) -> Layout | None:
    """The layout that a line declares, if it is the header of an IMU: it names a time and three axes of a gyro and of
    an accelerometer. The line may be a comment. Raises csv.Error."""
    text = line.strip().lstrip("#/").strip()
    for separator in SEPARATORS:
        header = next(csv.reader([text], delimiter=separator), [])
        meanings: dict[int, Meaning] = {}
        seen: set[tuple[str, int]] = set()
        for at, cell in enumerate(header):
            said = meaning(cell)
            if said is not None and (said.quantity, said.axis) not in seen:
                seen.add((said.quantity, said.axis))
                meanings[at] = said
        if seen == {("time", 0), *((quantity, axis) for quantity in ("gyr", "acc") for axis in range(3))}:
            return Layout(separator, [cell.strip() for cell in header], meanings)
    return None


def check_units(path: Path, line: int, layout: Layout) -> None:
    """Raises UsageError for a column whose header states no unit that is known."""
    for at, said in layout.meanings.items():
        if said.factor is None:
            fault = f"has the unit {said.unit!r}, which is not known" if said.unit else "states no unit"
            example = {"time": "time (s)", "gyr": "gyro x (deg/s)", "acc": "acc x (g)"}[said.quantity]
            raise UsageError(
                f"{path.name} line {line}: column {layout.header[at]!r} {fault}; "
                f"write it into the header, as in {example!r}"
            )


def number(text: str, separator: str) -> float:
    """Raises ValueError. A comma that does not separate is a decimal comma."""
    return float(text.replace(",", ".") if separator != "," else text)
