"""The flash image that was built, for the tests that look into it."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb.flash.elf import Elf

BUILD = Path(__file__).resolve().parents[2] / "build" / "stm32f103"


@pytest.fixture(scope="session")
def elf() -> Elf:
    return Elf(BUILD / "firmware.elf")


@pytest.fixture(scope="session")
def image() -> bytes:
    return (BUILD / "firmware.bin").read_bytes()
