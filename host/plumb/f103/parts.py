"""The parts of the STM32F103 family that can be simulated: memories, identification, and what smaller ones lack.

Sources: datasheets DS5319 (x8, xB), DS6132 (x4, x6) and DS5792 (xC to xE), RM0008 31.6.1 (DBGMCU_IDCODE).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from plumb.errors import UsageError


@dataclass(frozen=True)
class Part:
    """lacks: names of peripherals that the chip models and this part does not have."""

    name: str
    flash_kib: int
    ram_kib: int
    idcode: int
    lacks: frozenset[str] = frozenset()


MEMORIES = {
    "4": (16, 6, 0x10006412),
    "6": (32, 10, 0x10006412),
    "8": (64, 20, 0x20036410),
    "b": (128, 20, 0x20036410),
    "c": (256, 48, 0x10036414),
    "d": (384, 64, 0x10036414),
    "e": (512, 64, 0x10036414),
}
"""Letter of the flash -> KiB of flash, KiB of RAM, DBGMCU_IDCODE."""
PACKAGES = {"46": "tcr", "8b": "tcrv", "cde": "rvz"}
"""Letters of the flash -> letters of the packages in which it is sold."""
SMALL_LACK = frozenset({"TIM4", "USART3", "SPI2", "I2C2"})
_NAME = re.compile(r"(stm32f103([tcrvz])([468bcde]))([tuh][67])?")


def part_named(name: str) -> Part:
    """The part with this name: stm32f103c8, or with package and temperature, stm32f103c8t6. Raises UsageError."""
    match = _NAME.fullmatch(name.lower())
    if match is not None:
        for sizes, packages in PACKAGES.items():
            if match[3] in sizes and match[2] in packages:
                lacks = SMALL_LACK if sizes == "46" else frozenset[str]()
                return Part(name.lower(), *MEMORIES[match[3]], lacks)
    raise UsageError(
        f"'{name}' is not a simulated part; use stm32f103 with its package (t, c, r, v, z) and its flash "
        "(4, 6, 8, b, c, d, e), as stm32f103c8 or stm32f103ret6"
    )
