"""Every register, offset and bit that the firmware's header names is the vendor's.

The vendor's description (SVD) comes with pyocd. It covers peripherals and the numbers of their interrupts; the
processor's own blocks and the factory's data are fixed by the Armv7-M architecture reference manual (DDI 0403) and by
RM0008, and are listed here as facts, each with its section. No line of the header is left out: what neither the
description nor this list knows fails. Values of fields (which number means which mode) are held by the virtual board,
which was written from the manual apart from the header.
"""

from __future__ import annotations

import importlib.util
import re
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import pytest

from plumb.spec import pin_sets

HEADER = Path(__file__).parents[2] / "firmware/ports/stm32f103/stm32f103.h"

STARTUP = HEADER.with_name("startup.c")

FACTS = {
    "SYST_CSR": 0xE000E010,  # Armv7-M B3.3.2, table B3-7
    "SYST_CSR_ENABLE": 1 << 0,  # B3.3.3
    "SYST_CSR_TICKINT": 1 << 1,
    "SYST_CSR_CLKSOURCE": 1 << 2,
    "SYST_RVR": 0xE000E014,  # B3.3.4
    "SYST_CVR": 0xE000E018,  # B3.3.5
    "NVIC_IPR(word)": 0xE000E400,  # B3.4.9
    "SCB_ICSR": 0xE000ED04,  # B3.2.4
    "SCB_ICSR_PENDSVSET": 1 << 28,
    "SCB_SHPR3": 0xE000ED20,  # B3.2.12
    "NVIC_ISER(word)": 0xE000E100,  # B3.4.4; B3.4.3, table B3-8
    "NVIC_ISPR(word)": 0xE000E200,  # B3.4.6
    "NVIC_ICPR(word)": 0xE000E280,  # B3.4.7
    "SCB_VTOR": 0xE000ED08,  # B3.2.5; B3.2.2, table B3-4
    "SCB_AIRCR": 0xE000ED0C,  # B3.2.6
    "SCB_AIRCR_RESET": 0x05FA << 16 | 1 << 2,  # B3.2.6: VECTKEY, SYSRESETREQ
    "DEVICE_SYSTEM_MEMORY": 0x1FFFF000,  # RM0008 3.3.3, table 5 (not the connectivity line)
    "DEVICE_FLASH_KIB": 0x1FFFF7E0,  # RM0008 30.1.1
    "DEVICE_UID(word)": 0x1FFFF7E8,  # RM0008 30.2
}
"""Addresses, and of bits their value, that are in no vendor's file. An array's name is that of its first word."""
PIN_MODES = {
    "PIN_ANALOG": 0b0000,  # RM0008 9.1, table 20: CNF1:0 MODE1:0
    "PIN_FLOATING": 0b0100,
    "PIN_INPUT_PULLED": 0b1000,
    "PIN_OUTPUT_10MHZ": 0b0001,  # table 21: MODE 01 is 10 MHz
    "PIN_OPEN_DRAIN": 0b0101,
    "PIN_ALTERNATE_10MHZ": 0b1001,
    "PIN_ALTERNATE_2MHZ": 0b1010,
    "PIN_ALTERNATE_DRAIN": 0b1101,
}
HANDLERS = {
    "adc_dma_handler": "DMA1_Channel1",
    "spi_dma_handler": "DMA1_Channel2",
    "uart_tx_dma_handler": "DMA1_Channel4",
    "uart_rx_dma_handler": "DMA1_Channel5",
    "i2c_dma_handler": "DMA1_Channel7",
    "can_tx_handler": "CAN1_TX",
    "can_rx_handler": "CAN1_RX0",
    "bridge_handler": "TIM2",
    "sampling_timer_handler": "TIM3",
    "i2c_event_handler": "I2C1_EV",
    "i2c_error_handler": "I2C1_ER",
    "uart_handler": "USART1",
    "ppm_capture_handler": "TIM1_CC",
    "receiver_uart_handler": "USART3",
}
"""Handler in the vector table -> the vendor's name of its interrupt."""
PROCESSOR_VECTORS = 16
"""Armv7-M B1.5.2, table B1-4; SysTick is the last of them."""


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
    return {name: value.strip() for name, value in found if not name.startswith(("PULSE_", "ENCODER_"))}


PULSES = re.compile(r"^#define ((?:PULSE|ENCODER)_\w+)(\(\w+(?:, \w+)?\))? +(.*?)(?:/\*.*)?$", re.MULTILINE)
"""The registers of a timer of pulses or of an encoder, which the header has by the base of the timer."""


def _value(expression: str) -> int:
    """A constant expression of the header: numbers, parentheses, shifts and ors."""
    text = re.sub(r"(?<=[0-9a-fA-F])U\b", "", expression)
    assert re.fullmatch(r"[0-9a-fA-Fx()|< ]+", text), expression
    return int(eval(text))


def test_every_definition_is_the_vendors(svd: tuple[dict[str, Block], dict[str, int]]) -> None:
    blocks, interrupts = svd
    definitions = _definitions()
    checked = 0
    for name, value in definitions.items():
        address = re.fullmatch(r"REG32\((\w+), (\w+)\)", value)
        if name in FACTS or name in PIN_MODES:
            continue
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
    assert checked > 300


@pytest.mark.parametrize("timer", ["TIM2", "TIM4"])
def test_both_timers_of_pulses_and_encoders_have_these_registers_and_bits(
    svd: tuple[dict[str, Block], dict[str, int]], timer: str
) -> None:
    block = svd[0][timer]
    modes = block.bits["CCMR1"]
    masks = {"CCMR_OCPE": modes["OC1PE"], "CCMR_OCM_PWM1": modes["OC1M"]}
    masks |= {"SMCR_SMS_BOTH": block.bits["SMCR"]["SMS"], "CCMR1_INPUTS": modes["CC1S"] | modes["CC2S"]}
    masks["CCMR1_FILTERS_SLOWEST"] = modes["IC1F"] | modes["IC2F"]
    masks |= {f"{register}_{bit}": mask for register in ("CR1", "EGR") for bit, mask in block.bits[register].items()}
    checked = 0
    for name, arguments, value in PULSES.findall(HEADER.read_text(encoding="utf-8")):
        what = name.removeprefix("PULSE_").removeprefix("ENCODER_")
        plain = re.sub(r"(?<=[0-9a-fA-F])U\b", "", value.strip())
        if arguments == "(base, number)":
            offset = plain.removeprefix("REG32(base, ").removesuffix(")")
            for number in range(4):
                assert eval(offset, {"number": number}) == block.registers[f"{what}{number + 1}"], name
        elif arguments == "(base)":
            assert value.strip() == f"REG32(base, 0x{block.registers[what]:02x}U)", name
        elif arguments == "(number)":
            for number in range(4):
                assert eval(plain, {"number": number}) == block.bits["CCER"][f"CC{number + 1}E"], name
        else:
            assert _value(value) & ~masks[what] == 0, name
        checked += 1
    assert checked == 20


def test_what_no_file_of_the_vendor_knows() -> None:
    definitions = _definitions()
    assert [
        name for name in definitions if name.startswith(("SYST", "NVIC", "SCB", "DEVICE")) and name not in FACTS
    ] == []
    assert {name for name in definitions if name.startswith("PIN_")} == set(PIN_MODES)
    for name, expected in PIN_MODES.items():
        assert _value(definitions[name]) == expected, name
    for name, expected in FACTS.items():
        text = definitions[name]
        address = re.fullmatch(r"REG32\((\w+), (\w+|4U \* \(word\))\)", text)
        pointer = re.fullmatch(r"\(\*\(volatile const uint16_t \*\)(\w+)\)", text)
        if address is not None:
            offset = 0 if "word" in address[2] else _value(address[2])
            assert ("word" in address[2]) == ("(word)" in name), name
            assert _value(address[1]) + offset == expected, name
        else:
            assert _value(pointer[1] if pointer else text) == expected, name


def test_every_handler_stands_where_its_interrupt_looks(svd: tuple[dict[str, Block], dict[str, int]]) -> None:
    _, interrupts = svd
    table = re.search(r"vectors\[16 \+ 60\] = \{(.*?)\};", STARTUP.read_text(encoding="utf-8"), re.DOTALL)
    assert table is not None
    entries = [entry.strip() for entry in re.sub(r"/\*.*?\*/", "", table[1]).split(",") if entry.strip()]
    assert len(entries) == PROCESSOR_VECTORS + 60
    assert entries[1] == "reset_handler" and entries[PROCESSOR_VECTORS - 1] == "systick_handler"
    placed = {entry: place - PROCESSOR_VECTORS for place, entry in enumerate(entries) if entry.endswith("_handler")}
    assert placed.pop("pendsv_handler") == -2  # exception 14
    del placed["reset_handler"], placed["systick_handler"]
    assert placed == {handler: interrupts[name] for handler, name in HANDLERS.items()}


def test_no_address_stands_outside_the_header() -> None:
    for path in sorted(HEADER.parent.glob("*.c")):
        for literal in re.findall(r"\b0x[0-9a-fA-F]{8}U?\b", path.read_text(encoding="utf-8")):
            number = int(literal.rstrip("U"), 16)
            assert not 0x1FFF0000 <= number < 0x20000000, f"{path.name}: {literal}"
            assert not 0x40000000 <= number < 0x40024000, f"{path.name}: {literal}"
            assert not 0xE0000000 <= number < 0xE0100000, f"{path.name}: {literal}"


def test_nothing_is_defined_that_nobody_uses() -> None:
    """A register header grows old first where no code holds it in place."""
    declared = Path(pin_sets.__file__).parent.glob("pin_sets.*")  # modes of the pins, which the build writes
    sources = "".join(path.read_text(encoding="utf-8") for path in (*HEADER.parent.glob("*.[ch]"), *declared))
    words = [name.removesuffix("(word)") for name in _definitions()]
    assert [word for word in words if len(re.findall(rf"\b{word}\b", sources)) < 2] == []


def test_systick_alone_can_interrupt_another_handler() -> None:
    """What the bound of the stack counts on: priorities are given in two places, and nothing else could give one.
    tests/boards/test_hangs.py finds them in the running image."""
    given = []
    for path in sorted(HEADER.parent.glob("*.[ch]")):
        if path != HEADER:
            text = path.read_text(encoding="utf-8")
            given += [(path.name, found) for found in re.findall(r"\b(?:NVIC_IPR|SCB_SHP\w*|SCB_SHCSR)\b.*", text)]
            assert not re.search(r"basepri|AIRCR_PRIGROUP", text, re.IGNORECASE), path.name
            assert not re.search(r"0x[eE]000[eE]4|0x[eE]000[eE][dD][12]", text), path.name
    assert given == [
        ("nvic.h", "NVIC_IPR(irq / 4U) |= NVIC_PRIORITY << 8U * (irq % 4U);"),
        ("systick.c", "SCB_SHPR3 = NVIC_PRIORITY << 16; /* PendSV; SysTick, the byte above, stays 0: the highest */"),
    ]
