"""Every register, offset and bit that the firmware's header names is the vendor's.

The vendor's description (SVD) comes with pyocd. It covers peripherals; the processor's own blocks (SysTick, SCB) and
the factory's data are fixed by the architecture and by RM0008 section 30, and are listed here as facts.
"""

from __future__ import annotations

import importlib.util
import re
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import pytest

HEADER = Path(__file__).parents[1] / "firmware/stm32f103/stm32f103.h"

PROCESSOR = {
    "SYST_CSR": 0xE000E010,
    "SYST_RVR": 0xE000E014,
    "SYST_CVR": 0xE000E018,
    "SCB_VTOR": 0xE000ED08,
    "SCB_AIRCR": 0xE000ED0C,
}
ARRAYS = {"NVIC_ISER": 0xE000E100, "NVIC_ISPR": 0xE000E200, "DEVICE_UID": 0x1FFFF7E8}


@dataclass
class Block:
    base: int
    registers: dict[str, int] = field(default_factory=dict)
    bits: dict[str, dict[str, int]] = field(default_factory=dict)
    """Register -> field -> mask."""


@pytest.fixture(scope="module")
def svd() -> tuple[dict[str, Block], dict[str, int]]:
    """The vendor's blocks by name, and the numbers of the interrupts."""
    spec = importlib.util.find_spec("pyocd")
    if spec is None or spec.origin is None:
        pytest.skip("pyocd is not installed: it carries the vendor's register description")
    archive = Path(spec.origin).parent / "debug/svd/svd_data.zip"
    with zipfile.ZipFile(archive) as files:
        root = ElementTree.fromstring(files.read("STM32F103xx.svd"))
    found = {_text(node, "name"): node for node in root.iter("peripheral")}
    blocks = {}
    for name, node in found.items():
        block = Block(_number(node, "baseAddress"))
        source = found[node.attrib["derivedFrom"]] if "derivedFrom" in node.attrib else node
        for register in source.iter("register"):
            # Input and output views of one register are two entries in the SVD.
            label = _text(register, "name").removesuffix("_Output").removesuffix("_Input").removeprefix(f"{name}_")
            block.registers[label] = _number(register, "addressOffset")
            block.bits.setdefault(label, {}).update(
                (_text(bit, "name"), ((1 << _number(bit, "bitWidth")) - 1) << _number(bit, "bitOffset"))
                for bit in register.iter("field")
            )
        blocks[name] = block
    return blocks, {_text(node, "name"): _number(node, "value") for node in root.iter("interrupt")}


def _text(node: ElementTree.Element, name: str) -> str:
    found = node.findtext(name)
    assert found is not None
    return found


def _number(node: ElementTree.Element, name: str) -> int:
    return int(_text(node, name), 0)


def _definitions() -> dict[str, str]:
    pattern = r"^#define[ ]+([A-Z]\w+(?:\(word\))?)[ ]+(.*?)(?:/\*.*)?$"
    found = re.findall(pattern, HEADER.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: value.strip() for name, value in found}


def _value(expression: str) -> int:
    """A constant expression of the header: numbers, parentheses, shifts and ors."""
    text = re.sub(r"(?<=[0-9a-fA-F])u\b", "", expression)
    assert re.fullmatch(r"[0-9a-fA-Fx()|< ]+", text), expression
    return int(eval(text))


def test_every_definition_is_the_vendors(svd: tuple[dict[str, Block], dict[str, int]]) -> None:
    blocks, interrupts = svd
    definitions = _definitions()
    checked = 0
    for name, value in definitions.items():
        address = re.fullmatch(r"REG32\((\w+), (\w+)\)", value)
        if name.startswith(("PIN_", "DEVICE_FLASH")) or name in PROCESSOR or name.endswith("(word)"):
            continue
        if name.startswith(("SYST_", "SCB_")):
            continue  # bits of the processor's blocks: test_processor_blocks
        if name.startswith("IRQ_"):
            assert _value(value) == interrupts[name.removeprefix("IRQ_")], name
        elif name.endswith("_BASE"):
            assert _value(value) == blocks[name.removesuffix("_BASE")].base, name
        elif address is not None:
            block, register = name.split("_", 1)
            assert address[1] == f"{block}_BASE", name
            assert _value(address[2]) == blocks[block].registers[register], name
        else:
            block, register, bit = name.split("_", 2)
            fields = blocks[block].bits[register]
            words = bit.split("_")
            label = next("_".join(words[:n]) for n in range(len(words), 0, -1) if "_".join(words[:n]) in fields)
            assert f"{block}_{register}" in definitions, f"{name}: its register is not defined"
            mask = fields[label]
            if label == bit:
                assert _value(value) == mask, name
            else:
                assert _value(value) & ~mask == 0, name
        checked += 1
    assert checked > 120


def test_processor_blocks() -> None:
    definitions = _definitions()
    for name, expected in PROCESSOR.items():
        address = re.fullmatch(r"REG32\((\w+), (\w+)\)", definitions[name])
        assert address is not None and _value(address[1]) + _value(address[2]) == expected, name
    for name, expected in ARRAYS.items():
        assert f"REG32(0x{expected:08x}u, 4u * (word))" == definitions[f"{name}(word)"]
    assert "0x1ffff7e0u" in definitions["DEVICE_FLASH_KIB"]
    assert _value(definitions["SCB_AIRCR_RESET"]) == 0x05FA0004
    bits = {name: _value(definitions[f"SYST_CSR_{name}"]) for name in ("ENABLE", "TICKINT", "CLKSOURCE")}
    assert bits == {"ENABLE": 1, "TICKINT": 2, "CLKSOURCE": 4}


def test_nothing_is_defined_that_nobody_uses() -> None:
    """A register header grows old first where no code holds it in place."""
    sources = "".join(path.read_text(encoding="utf-8") for path in HEADER.parent.glob("*.[ch]"))
    words = [name.removesuffix("(word)") for name in _definitions()]
    assert [word for word in words if len(re.findall(rf"\b{word}\b", sources)) < 2] == []
