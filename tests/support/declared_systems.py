"""Declared systems by what they have, for tests that are of any such system and name none."""

from __future__ import annotations

import pytest

from plumb import systems


def lacking(part: str) -> list[str]:
    """The systems without that part."""
    return [name for name in systems.SYSTEMS if name not in systems.with_part(part)]


def without_part(part: str) -> str:
    """A system without that part; the test is left out where every system has it."""
    found = lacking(part)
    return found[-1] if found else pytest.skip(f"every declared system has {part}.py")


def without_output() -> str:
    """A system that drives nothing; the test is left out where every system drives something."""
    found = [name for name in systems.SYSTEMS if not systems.load(name).OUTPUT_FRAMES]
    return found[-1] if found else pytest.skip("every declared system drives something")
