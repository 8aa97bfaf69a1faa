"""The flash image on the simulated chip, with the face of support.native_board.UartBoard: one body runs on both."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from plumb.boards.virtual_can import MachineBus
from plumb.f103.machine import Machine
from plumb.flash.elf import Elf
from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS, find_image
from plumb.proof.faults import core
from plumb.proof.faults.scene import Scene
from support.pins import PINS, at_rest

BOOT_US = 30_000
"""The flash image answers this long after power-up."""
LOOK_US = 1100
"""Longest sleep of the loop, and a turn."""
BYTE_US = 10.9
SWITCH_PIN = "PC14"
RAM = 0x20000000
SLOTS_BYTES = 4096
ARMED = 0x6B95D2A7
"""ARMING_ARMED of firmware/link/arming.h."""


@lru_cache(maxsize=1)
def _places(path: Path) -> dict[str, int]:
    """Where the session keeps whether it is armed, and the number of the next step."""
    from elftools.elf.elffile import ELFFile

    elf = Elf(path)
    with path.open("rb") as file:
        for unit in ELFFile(file).get_dwarf_info().iter_CUs():
            if unit.get_top_DIE().attributes["DW_AT_name"].value.endswith(b"app/loop.c"):
                start = elf.symbol("session").address
                variable = _child(unit.get_top_DIE(), b"session")
                return {
                    "armed": start + _offset(variable, b"arming", b"armed", b"word"),
                    "steps": start + _offset(variable, b"run", b"step"),
                }
    raise AssertionError("the image has no debug information of app/loop.c")


def _child(entry: Any, name: bytes) -> Any:
    named = (one for one in entry.iter_children() if "DW_AT_name" in one.attributes)
    return next(one for one in named if one.attributes["DW_AT_name"].value == name)


def _offset(variable: Any, *names: bytes) -> int:
    """Bytes from the start of a variable to a member of its members."""
    entry, offset = variable, 0
    for name in names:
        kind = entry.get_DIE_from_attribute("DW_AT_type")
        while kind.tag != "DW_TAG_structure_type":
            kind = kind.get_DIE_from_attribute("DW_AT_type")
        entry = _child(kind, name)
        offset += entry.attributes["DW_AT_data_member_location"].value
    return offset


class FlashBoard:
    """A machine with the built image, its sensors at rest; as a stream, its UART."""

    def __init__(self, seed: int = 1) -> None:
        image = find_image()
        self._elf = Elf(image.with_suffix(".elf"))
        self._places = _places(image.with_suffix(".elf"))
        self.machine = Machine(image, seed=seed)
        self.name, self.timeout = "the flash image", 0.005
        self.spoil_down: Callable[[bytes], bytes] = bytes
        self.spoil_up: Callable[[bytes], bytes] = bytes
        at_rest(self.machine)
        self.switch(False)
        self.machine.advance_us(BOOT_US)

    def reset(self) -> None:
        """Power off and on."""
        self.machine.power_cut()
        self.machine.uart.reset_input_buffer()
        self.machine.power_on()
        self.machine.advance_us(BOOT_US)

    # ---- the UART ----

    def clock_s(self) -> float:
        return self.machine.now_s

    @property
    def in_waiting(self) -> int:
        return self.machine.uart.in_waiting

    def write(self, data: bytes) -> int:
        self.machine.uart.write(self.spoil_down(bytes(data)))
        return len(data)

    def read(self, size: int = 1) -> bytes:
        self.machine.uart.timeout = self.timeout
        return self.spoil_up(self.machine.uart.read(size))

    def say(self, text: bytes, turns: int = 3) -> bytes:
        """Send text, let some turns go by, and give what was answered, to its last byte."""
        self.write(text)
        self.machine.advance_us(len(text) * BYTE_US + turns * LOOK_US)
        return self.received()

    def received(self) -> bytes:
        uart = self.machine.uart
        data = uart.read(uart.in_waiting) if uart.in_waiting else b""
        while data and data[-1:] not in (b"\r", b"\a"):
            data += uart.read(1)
        return self.spoil_up(data)

    def turn(self, step_us: int = 0) -> None:
        """At least one turn of the loop."""
        self.machine.advance_us(max(step_us, LOOK_US))

    def run_us(self, time_us: int, step_us: int = 0) -> None:
        self.machine.advance_us(time_us)

    # ---- wires, and a look inside ----

    def switch(self, closed: bool) -> None:
        self.machine.drive(SWITCH_PIN, not closed)

    @property
    def time_us(self) -> int:
        return int(self.machine.now_us)

    @property
    def leaves(self) -> bool:
        """Gone into the ROM bootloader."""
        return self.machine.rom is not None

    def flash_cells(self) -> memoryview:
        """The half-words of both slots."""
        start = PARAMETER_SLOTS - FLASH_BASE
        return memoryview(self.machine.cpu.flash)[start : start + SLOTS_BYTES].cast("H")

    @property
    def armed(self) -> bool:
        return self._word("armed", 4) == ARMED

    @property
    def steps(self) -> int:
        return self._word("steps", 2)

    @property
    def pulses(self) -> tuple[int, int]:
        return self.machine.tim4.ccr1, self.machine.tim4.ccr2

    def _word(self, name: str, size: int) -> int:
        at = self._places[name] - RAM
        return int.from_bytes(bytes(self.machine.cpu.ram[at : at + size]), "little")

    # ---- the second link, and trouble ----

    def can_bus(self) -> MachineBus:
        return MachineBus(self.machine)

    def stop_converter(self) -> None:
        self.machine.adc1.silent = True

    def rail_input(self, channel: int) -> None:
        self.machine.adc[PINS[channel]] = 0.0

    def hang(self) -> None:
        """The loop comes round no more, until the next reset."""
        core.patch_the_loop(cast(Scene, SimpleNamespace(machine=self.machine)), core.FOREVER)

    def damage(self, data: bytes) -> None:
        """Bytes to the board that arrive with a framing error."""
        self.machine.uart.write_with_framing_error(data)

    def short_can(self, shorted: bool) -> None:
        self.machine.can.wire.short(shorted)

    def flip(self, at: float, bit: int) -> None:
        """A bit of guarded memory, at this share of it; while the loop sleeps."""
        assert self.machine.run_until(lambda: self.machine.cpu.sleeping, LOOK_US)
        start, end = (self._elf.symbols[f"guarded_{name}"].address for name in ("start", "end"))
        self.machine.cpu.ram[start - RAM + int(at * (end - start))] ^= 1 << bit

    def set_clock_back(self) -> None:
        ticks = self._elf.symbol("ticks_ms").address - RAM
        value = int.from_bytes(bytes(self.machine.cpu.ram[ticks : ticks + 4]), "little")
        self.machine.cpu.ram[ticks : ticks + 4] = (value // 2).to_bytes(4, "little")

    def write_and_cut_power(self, request: bytes, operation: int) -> None:
        """Power fails in the middle of this operation of the flash, counted from the request."""
        begin = self.machine.flash.operations
        self.write(request)
        assert self.machine.run_until(lambda: self.machine.flash.operations - begin >= operation, 500_000)
        self.machine.power_cut()
