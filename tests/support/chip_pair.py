"""Both chip models with the same image, register by register."""

from __future__ import annotations

import re
from pathlib import Path

from plumb.f103.machine import Machine
from second_chip import Chip
from second_chip.chip import SYSTEM_SPACE

START_S = 0.06
LOOKS, LOOK_S = 40, 2.3e-4
"""The check of the image and the way onto the CAN bus take this long."""
HEADER = Path(__file__).parents[2] / "firmware/ports/stm32f103/stm32f103.h"
CLOCKS_ON = {0x40021014: 0x557, 0x40021018: 0x38FFFD, 0x4002101C: 0x3AFEC9FF}
"""Every peripheral's, in AHBENR, APB2ENR and APB1ENR."""
WRITE_ONLY = {"AFIO_MAPR": 7 << 24, "FLASH_AR": 0xFFFFFFFF}
"""Bits whose reading is not defined (RM0008 9.4.2, PM0075 3.5)."""
PINS = ("GPIOA_IDR", "GPIOB_IDR", "GPIOC_IDR")
MOMENTARY = ("SYST_CVR", "WWDG_CR", "TIM3_CNT", "TIM4_CNT", "CRC_DR")
"""Running counters; and of the CRC unit, the check over memory that holds them."""
ACTING = ("RCC_C", "RCC_A", "RCC_BDCR", "FLASH_", "SCB_AIRCR", "SCB_ICSR", "NVIC_", "SYST_", "IWDG_", "WWDG_", "CRC_DR")
"""A write to these has an effect beyond the stored value."""
VENDOR_SAYS_0 = ("MCR", "MSR", "TSR", "BTR", "FMR", "ARR")
"""Values after reset that the description has wrong: bxCAN's (RM0008 24.9.2, 24.9.4) and a timer's (15.4.12)."""


def registers() -> dict[str, int]:
    """Name -> address, of the firmware's header."""
    text = HEADER.read_text()
    bases = {found[1]: found[2] for found in re.finditer(r"#define (\w+_BASE)\s+(0x\w+)U", text)}
    return {
        found[1]: int(bases.get(found[2], found[2].rstrip("U")), 0) + int(found[3], 0)
        for found in re.finditer(r"#define (\w+)\s+REG32\((\w+), (0x\w+)U\)", text)
    }


class Pair:
    """Both models with the same image."""

    def __init__(self, image: bytes) -> None:
        self.second, self.first = Chip(image), Machine(image)

    def read(self, address: int) -> tuple[int, int]:
        own = address >= SYSTEM_SPACE
        second = self.second.nvic.read(address - SYSTEM_SPACE) if own else self.second.load(address, 4)
        return second, self.first.bus.read(address, 4)

    def write(self, address: int, value: int) -> None:
        self.first.bus.write(address, 4, value)  # which refuses what it does not model
        if address >= SYSTEM_SPACE:
            self.second.nvic.write(address - SYSTEM_SPACE, value)
        else:
            self.second.store(address, 4, value)


def clocked(image: bytes) -> Pair:
    pair = Pair(image)
    for address, value in CLOCKS_ON.items():
        pair.write(address, value)
    return pair


def differences(pair: Pair, names: dict[str, int]) -> dict[str, tuple[str, str]]:
    both = {name: pair.read(address) for name, address in names.items()}
    masked = {name: tuple(value & ~WRITE_ONLY.get(name, 0) for value in values) for name, values in both.items()}
    return {name: (hex(a), hex(b)) for name, (a, b) in masked.items() if a != b}


def inputs(pair: Pair, port: str) -> int:
    """Pins that are inputs and not the debug port's, of which the virtual board says nothing."""
    block = pair.second.ports[port[4]]
    debug = {"GPIOA": 3 << 13}.get(port, 0)
    return sum(1 << pin for pin in range(16) if block.input(pin)) & ~debug


def assert_both_left_the_same(pair: Pair) -> None:
    """Once the firmware has started. It looks for a chip that does not answer every millisecond: while it does on
    one model alone, both go on."""
    pair.second.run(START_S)
    pair.first.advance_us(START_S * 1e6)
    names = registers()
    kept = {name: at for name, at in names.items() if name not in (*MOMENTARY, *PINS)}
    for _ in range(LOOKS):
        found = differences(pair, kept)
        if not found:
            break
        pair.second.run(LOOK_S)
        pair.first.advance_us(LOOK_S * 1e6)
    assert found == {}
    for name in PINS:
        mask = inputs(pair, name[:5])
        second, first = pair.read(names[name])
        assert second & mask == first & mask, name
