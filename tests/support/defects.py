"""Declared defects: one-line changes of the firmware, each with the rows and tests that must notice it.

tests/defects/*.toml declare them, a file for each file of the firmware:

    source = "firmware/ports/stm32f103/stall.c"

    [[defect]]
    name = "stall-watch-dead"             unique
    line = "if (ticks < STALL_TICKS) {"   text that the source has exactly once, within one line
    after = "bool stall_tick(void) {"     if given: text before the line that the source has once; the line is the next
    becomes = "if (true) {"               what stands there instead
    caught_by = ["loop-pauses"]           rows of `plumb faults`, or tests: tests/FOLDER/FILE.py::NAME, tests/c/NAME.c
    why = "not told"                      if given: what the failing row says, which proves that it means this defect

    [[equivalent]]                        a change that nothing can notice
    line = ...
    becomes = ...
    reason = "why no input distinguishes the two"

A text with a line that the source no longer has is stale: update it, or replace the defect by one of the new code.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "defects"


@dataclass(frozen=True)
class Defect:
    """One declared defect. source: relative to the root of the checkout. A row is run on the first system that has it;
    ROW@FEATURE on the first that has the feature (plumb.proof.faults.scene)."""

    name: str
    source: str
    line: str
    becomes: str
    caught_by: tuple[str, ...]
    why: str = ""
    after: str = ""

    @property
    def rows(self) -> tuple[str, ...]:
        """Rows of the fault table."""
        return tuple(name for name in self.caught_by if "/" not in name)

    @property
    def tests(self) -> tuple[str, ...]:
        """Tests in Python and C."""
        return tuple(name for name in self.caught_by if "/" in name)

    def applied(self, text: str) -> str:
        """The source with the defect. Raises ValueError, with the name of the defect, when its line is not there."""
        return replaced(text, self.line, self.becomes, self.after, f"{self.name}: {self.source}")


def replaced(text: str, line: str, becomes: str, after: str, place: str) -> str:
    """The text with another line. Raises ValueError when the line, or the text before it, is not there once."""
    before, found, rest = text.partition(after) if after else ("", "", text)
    if text.count(after or line) != 1 or line not in rest or "\n" in line:
        raise ValueError(f"{place} has no one place with: {line}" + (f", after: {after}" if after else ""))
    return before + found + rest.replace(line, becomes, 1)


@dataclass(frozen=True)
class Equivalent:
    """A change that no test can notice, and the reason."""

    source: str
    line: str
    becomes: str
    reason: str
    after: str = ""


@cache
def _tables() -> list[tuple[str, dict[str, list[dict[str, object]]]]]:
    found = []
    for path in sorted(FOLDER.glob("*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        found.append((table.pop("source"), table))
    return found


@cache
def declared() -> tuple[Defect, ...]:
    """All defects, by file and in the order of its lines."""
    return tuple(
        Defect(source=source, **{**row, "caught_by": tuple(row["caught_by"])})  # type: ignore[arg-type]
        for source, table in _tables()
        for row in table.get("defect", [])
    )


@cache
def equivalents() -> tuple[Equivalent, ...]:
    """All changes that are declared to change nothing."""
    return tuple(
        Equivalent(source=source, **row)  # type: ignore[arg-type]
        for source, table in _tables()
        for row in table.get("equivalent", [])
    )
