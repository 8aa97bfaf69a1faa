"""A peripheral's registers, and when it may be spoken to."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from second_chip.chip import Chip


Layout = dict[int, tuple[str, int, int]]
"""Offset -> name, value after reset, bits that a plain write changes."""


class Block:
    """Registers of one peripheral. A method write_NAME or read_NAME takes the place of the plain access.

    CLOCK: the enable register and bit in RCC; without its clock a peripheral reads as 0 and ignores writes
    (RM0008 7.3.7).
    """

    LAYOUT: ClassVar[Layout] = {}
    CLOCK: tuple[str, int] | None = None

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.value: dict[str, int] = {}
        self._reads: dict[int, Callable[[], int]] = {}
        self._writes: dict[int, Callable[[int], None]] = {}
        for offset, (name, _, writable) in self.LAYOUT.items():
            self._reads[offset] = getattr(self, f"read_{name}", self._plain_read(name))
            self._writes[offset] = getattr(self, f"write_{name}", self._plain_write(name, writable))
        self.reset()

    def _plain_read(self, name: str) -> Callable[[], int]:
        return lambda: self.value[name]

    def _plain_write(self, name: str, writable: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            self.value[name] = self.value[name] & ~writable | value & writable

        return write

    def reset(self) -> None:
        self.value = {name: reset for name, reset, _ in self.LAYOUT.values()}

    def clocked(self) -> bool:
        return self.CLOCK is None or bool(self.chip.rcc.value[self.CLOCK[0]] >> self.CLOCK[1] & 1)

    def read(self, offset: int) -> int:
        found = self._reads[offset]
        return found() if self.clocked() else 0

    def write(self, offset: int, value: int) -> None:
        found = self._writes[offset]
        if self.clocked():
            found(value)

    def bit(self, name: str, position: int, width: int = 1) -> int:
        return self.value[name] >> position & (1 << width) - 1
