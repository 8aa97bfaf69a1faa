"""Register addresses and reset values agree with the vendor's description, which ships inside pyocd."""

from __future__ import annotations

import importlib.util
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

from support.f103_program import NewBoard

KNOWN_DIFFERENCES = {
    ("RCC", "csr"): "holds the flags of the last reset",
    ("TIM1", "arr"): "RM0008 says 0xFFFF",
    ("TIM2", "arr"): "RM0008 says 0xFFFF",
    ("TIM3", "arr"): "RM0008 says 0xFFFF",
    ("TIM4", "arr"): "RM0008 says 0xFFFF",
    ("CAN", "mcr"): "RM0008: asleep",
    ("CAN", "msr"): "RM0008: asleep, the pin recessive",
    ("CAN", "tsr"): "RM0008: every mailbox empty",
    ("CAN", "btr"): "RM0008 says 0x01230000",
    ("CAN", "fmr"): "RM0008: filters in initialisation",
}
CORE = {"SCB", "SysTick", "CoreDebug", "DWT", "DBGMCU"}
"""Not described by the vendor's file."""


def description() -> ElementTree.Element:
    found = importlib.util.find_spec("pyocd")
    if found is None or not found.submodule_search_locations:
        pytest.skip("pyocd, which carries the register description, is not installed")
    archive = Path(found.submodule_search_locations[0]) / "debug" / "svd" / "svd_data.zip"
    with zipfile.ZipFile(archive) as files:
        name = next(name for name in files.namelist() if name.endswith("STM32F103xx.svd"))
        return ElementTree.fromstring(files.read(name))


def text(node: ElementTree.Element, name: str) -> str:
    found = node.findtext(name)
    assert found is not None, name
    return found


def test_addresses_and_reset_values(board: NewBoard) -> None:
    peripherals = {node.findtext("name"): node for node in description().iter("peripheral")}
    machine = board("clock").machine
    compared = 0
    for peripheral in machine.bus.peripherals:
        if peripheral.name in CORE:
            continue
        node = peripherals[peripheral.name]
        base = int(text(node, "baseAddress"), 0)
        node = peripherals.get(node.get("derivedFrom"), node)
        rows = {
            text(row, "name").lower().removesuffix("_output").removeprefix("can_"): (
                base + int(text(row, "addressOffset"), 0),
                int(row.findtext("resetValue") or "0", 16),
            )
            for row in node.iter("register")
        }
        for register in peripheral.REGISTERS:
            address, reset = rows[register.name]
            assert address == peripheral.base + register.offset, (peripheral.name, register.name)
            if (peripheral.name, register.name) not in KNOWN_DIFFERENCES:
                assert reset == register.reset, (peripheral.name, register.name)
            compared += 1
    assert compared > 150
