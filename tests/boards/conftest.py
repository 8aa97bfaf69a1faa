"""The flash image that was built, and a scene of it that every test of a module begins with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb.f103.snapshot import Snapshot
from plumb.flash.elf import Elf
from plumb.proof.faults.scene import Scene

BUILD = Path(__file__).resolve().parents[2] / "build" / "stm32f103"


@pytest.fixture(scope="session")
def elf() -> Elf:
    return Elf(BUILD / "firmware.elf")


@pytest.fixture(scope="session")
def image() -> bytes:
    return (BUILD / "firmware.bin").read_bytes()


@pytest.fixture
def scene(taken: tuple[Scene, Snapshot]) -> Iterator[Scene]:
    """The scene as the module's fixture `taken` left it, set back after each test."""
    yield taken[0]
    taken[0].machine.restore(taken[1])
