"""Declared systems by what they have, for tests that are of any such system and name none."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import pytest

from plumb import systems
from plumb.contract.parameters import groups_of

Row = TypeVar("Row", bound="str | tuple[Any, ...]")  # Any: what a test says of a system


def lacking(part: str) -> list[str]:
    """The systems without that part."""
    return [name for name in systems.SYSTEMS if name not in systems.with_part(part)]


def without_part(part: str) -> str:
    """A system without that part; the test is left out where every system has it."""
    found = lacking(part)
    return found[-1] if found else pytest.skip(f"every declared system has {part}.py")


def without_group(group: str, part: str = "") -> str:
    """A system that reads no parameters of that group, and has that part; the test is left out where none is so."""
    able = systems.with_part(part) if part else systems.SYSTEMS
    found = [name for name in able if group not in groups_of(name)]
    return found[-1] if found else pytest.skip(f"every declared system has the group {group}")


def of_declared(rows: Iterable[Row]) -> list[Row]:
    """Of rows that say something of one system each, whose name comes first, those of systems that are declared."""
    return [row for row in rows if (row if isinstance(row, str) else row[0]) in systems.SYSTEMS]


def without_outputs() -> list[str]:
    """The systems that drive nothing."""
    return [name for name in systems.SYSTEMS if not systems.load(name).OUTPUT_FRAMES]


def without_output() -> str:
    """A system that drives nothing; the test is left out where every system drives something."""
    found = without_outputs()
    return found[-1] if found else pytest.skip("every declared system drives something")
