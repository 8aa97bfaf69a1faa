"""What gdb asks once, and its answers: what is served, and registers and memories of the simulated chip, as XML."""

from __future__ import annotations

import re

from plumb.f103.core.cpu import FLASH_BASE, RAM_BASE, SYSTEM_BASE
from plumb.f103.debug_hold import REGISTERS, Chip

PACKET_BYTES = 0x1000
"""The most that a packet holds, either way."""
FEATURES = f"PacketSize={PACKET_BYTES:x};qXfer:features:read+;qXfer:memory-map:read+;QStartNoAckMode+;vContSupported+"
SIMPLE = {"!": "OK", "qAttached": "1", "vCont?": "vCont;c;C;s;S", "qSupported": FEATURES, "H": "OK", "T": "OK"}
"""Answers to packets that begin like this."""
CORE_REGISTERS = 17
"""r0 to xpsr; the others belong to the system."""
TYPES = {"sp": "data_ptr", "msp": "data_ptr", "psp": "data_ptr", "pc": "code_ptr"}


def target_xml(_machine: Chip) -> str:
    """The registers of the core."""
    registers = [f'<reg name="{name}" bitsize="32" type="{TYPES.get(name, "uint32")}"/>' for name in REGISTERS]
    parts = {"m-profile": registers[:CORE_REGISTERS], "m-system": registers[CORE_REGISTERS:]}
    features = (f'<feature name="org.gnu.gdb.arm.{name}">{"".join(part)}</feature>' for name, part in parts.items())
    return f'<?xml version="1.0"?><target version="1.0"><architecture>arm</architecture>{"".join(features)}</target>'


def memory_map_xml(machine: Chip) -> str:
    """The memories: for code that is read only gdb takes hardware breakpoints, and does not load an image into it."""
    flash, ram = len(machine.cpu.flash), len(machine.cpu.ram)
    areas = (("rom", 0, flash), ("rom", FLASH_BASE, flash), ("rom", SYSTEM_BASE, 0x1000), ("ram", RAM_BASE, ram),
             ("ram", 0x40000000, 0x20000000), ("ram", 0xE0000000, 0x100000))  # fmt: skip
    memories = "".join(f'<memory type="{kind}" start="{start:#x}" length="{size:#x}"/>' for kind, start, size in areas)
    return f'<?xml version="1.0"?><memory-map>{memories}</memory-map>'


def unescaped(data: str) -> bytes:
    """The bytes of a binary packet."""
    return re.sub(rb"}(.)", lambda found: bytes([found[1][0] ^ 0x20]), data.encode("latin-1"), flags=re.DOTALL)
