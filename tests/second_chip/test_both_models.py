"""The second chip model, plumb's virtual board and the vendor's register description, register by register: what the
firmware touches is the same on all three, but for what is listed here."""

from __future__ import annotations

import importlib.util
import itertools
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from plumb.f103.core.bus import SimulationError
from second_chip import Chip
from second_chip.clocks import UNITS_HZ
from support.chip_pair import (
    ACTING,
    PINS,
    VENDOR_SAYS_0,
    Pair,
    assert_both_left_the_same,
    clocked,
    differences,
    registers,
)


def test_registers_hold_the_same_after_reset(image: bytes) -> None:
    names = {name: address for name, address in registers().items() if name not in PINS}
    assert len(names) > 120
    assert differences(clocked(image), names) == {}


def test_registers_keep_the_same_bits_of_what_is_written(image: bytes) -> None:
    kept = 0
    for name, address in registers().items():
        if name in PINS or name.startswith(ACTING):
            continue
        pair = clocked(image)
        for value in (0xFFFFFFFF, 0x55555555, 0xAAAAAAAA, 0):
            try:
                pair.write(address, value)
            except SimulationError:
                continue
            kept += 1
            assert differences(pair, {name: address}) == {}, hex(value)
    assert kept > 250


def test_the_firmware_leaves_the_same_behind_when_it_has_started(image: bytes) -> None:
    assert_both_left_the_same(Pair(image))


PWM_PINS = {1: "PB13", 2: "PB14", 3: "PB15"}
FILTER_UNITS = 300 * UNITS_HZ // 8_000_000
"""Longer than the slowest filter of an input, at 8 MHz."""


@pytest.mark.parametrize("channel", PWM_PINS)
def test_a_complementary_output_is_driven_by_the_same_bits(image: bytes, channel: int) -> None:
    """MOE, OSSI, OSSR, CCxE and CCxNE in every combination (RM0008 table 83)."""
    pair, tim1, gpiob = clocked(image), 0x40012C00, 0x40010C00
    pair.write(gpiob + 0x04, 0xAAA44444)
    for offset, value in ((0x2C, 1000), (0x18, 0x6868), (0x1C, 0x6868), (0x34 + 4 * (channel - 1), 300)):
        pair.write(tim1 + offset, value)
    pair.write(tim1 + 0x14, 1)
    pair.write(tim1, 0xA1)
    driven = 0
    for main, off_states, enables in itertools.product((0, 1 << 15), (0, 1, 2, 3), (0, 1, 4)):
        pair.write(tim1 + 0x44, main | off_states << 10)
        pair.write(tim1 + 0x20, enables << 4 * (channel - 1))
        second, first = pair.second.tim1.complement(channel), pair.first.tim1.gate(PWM_PINS[channel], pair.first.now)
        assert (second is None) == (first is None), (main, off_states, enables)
        alone = pair.first.duty(PWM_PINS[channel])
        assert alone == (0.3 if main and enables == 4 else None)
        if second is not None:
            driven += 1
            assert second == (alone or 0.0)
    assert driven == 10


@pytest.mark.parametrize("cut", [None, "counter", "mode", "inputs", "clock"])
def test_an_encoder_counts_the_same(image: bytes, cut: str | None) -> None:
    """TIM2 by edges at PA0 and PA1, which the second model decodes (RM0008 table 85); forwards, back, and past 0."""
    pair, tim2, at = clocked(image), 0x40000000, 0
    wanted = {0x2C: 0xFFFF, 0x18: 0 if cut == "inputs" else 0xF1F1, 0x08: 0 if cut == "mode" else 3}
    for offset, value in wanted.items():
        pair.write(tim2 + offset, value)
    if cut != "mode":  # without it the counter runs by the clock
        pair.write(tim2, 0 if cut == "counter" else 1)
    if cut == "clock":
        pair.write(0x4002101C, 0)
    for turned in (5, -9, 3, -1, 2):
        for _ in range(abs(turned)):
            at += 1 if turned > 0 else -1
            for pin, level in ((0, at % 4 in (1, 2)), (1, at % 4 in (2, 3))):
                pair.second.ports["A"].drive(pin, int(level))
            pair.second._pass_time(pair.second.now + FILTER_UNITS)
        pair.first.turn_encoder("TIM2", turned)
        assert [pair.second.tim2.read_CNT(), pair.first.tim2.cnt] == [at % 65536 if cut is None else 0] * 2


def described() -> Iterator[tuple[int, int, int]]:
    """Address, value after reset and bits of each register of the vendor's description."""
    spec = importlib.util.find_spec("pyocd")
    if spec is None or spec.origin is None:
        pytest.skip("pyocd is not installed: it carries the vendor's register description")
    with zipfile.ZipFile(Path(spec.origin).parent / "debug/svd/svd_data.zip") as files:
        root = ElementTree.fromstring(files.read("STM32F103xx.svd"))
    blocks = {block.findtext("name", ""): block for block in root.iter("peripheral")}
    for block in blocks.values():
        for register in blocks.get(block.get("derivedFrom", ""), block).iter("register"):
            bits = (
                (1 << int(field.findtext("bitWidth", "0"))) - 1 << int(field.findtext("bitOffset", "0"))
                for field in register.iter("field")
            )
            address = int(block.findtext("baseAddress", ""), 16) + int(register.findtext("addressOffset", ""), 16)
            yield address, int(register.findtext("resetValue", "0"), 16), sum(bits)


def test_the_second_model_has_the_vendor_s_registers(image: bytes) -> None:
    vendor: dict[int, tuple[int, int]] = {}
    for address, reset, bits in described():  # some registers are described twice, once for each use
        vendor[address] = reset, vendor.get(address, (0, 0))[1] | bits
    chip, compared = Chip(image), 0
    for base, block in chip.blocks.items():
        for offset, (name, reset, writable) in block.LAYOUT.items():
            said_reset, said_bits = vendor[base + offset]
            assert writable & ~said_bits == 0, name
            assert reset == said_reset or name in VENDOR_SAYS_0, name
            compared += 1
    assert compared > 200
