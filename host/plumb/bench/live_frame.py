"""What a frame of a vehicle in flight costs the chip: every instruction between two ticks of the step timer, of the
loop and of the interrupts, while a pilot flies the vehicle by its receiver and a host listens over the UART.

A frame is one period of the system's own tuning. The mean and the worst are taken over FRAMES frames, in which the
board sends its periodic status once. Each exception adds its entry and return, as the simulated core takes them.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from plumb import systems
from plumb.bench.instruction_counter import Image, InstructionTrace
from plumb.bench.m3_timing import path_steps
from plumb.flash.named_images import named_image
from plumb.proof.faults.scene import RECEIVER, driving

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

FRAMES = 40
TICK = "sampling_timer_handler"
"""A frame begins with the first instruction of this handler."""
STEP = "control_step"
FEEDS_THE_CRC_UNIT = ("crc_of_words", "digest_crc32")
"""Functions whose stores wait for the CRC unit."""


@dataclass(frozen=True)
class LiveFrame:
    """Instructions and cycles of a frame, at zero and at two wait states; awake_cycles_mean: those in which the
    simulated chip did not sleep, by its own flat estimate. wrong: frames without exactly one step. bytes: of the
    functions that ran. stack: deepest, bytes."""

    instructions_min: int
    instructions_max: int
    cycles_max: int
    cycles_mean: int
    cycles_2ws_max: int
    cycles_2ws_mean: int
    awake_cycles_mean: int
    wrong: int
    bytes: int
    stack: int
    period_us: int


def _exception_cycles(machine: Machine) -> float:
    """Cycles of the entries and returns of exceptions since the start: what is not asleep and is no instruction."""
    cpu = machine.cpu
    return (machine.awake_ticks() - cpu.instructions * cpu.instruction_ticks) / machine.rcc.hclk_ticks


def live_frame(system: str, period_us: int | None = None) -> LiveFrame:
    """Measure a system that a pilot steers, on its own image, at the period of its tuning or another.

    Raises UsageError without that image, LinkError when it does not arm.
    """
    image = named_image(system)
    elf = Image(image.with_suffix(".elf"))
    scene = driving(system, RECEIVER, image, period_us=period_us)
    try:
        machine = scene.machine
        period_us = period_us or systems.load(system).TUNINGS[scene.live.TUNING].period_us
        before, awake = _exception_cycles(machine), machine.awake_ticks()
        trace = InstructionTrace(machine)
        scene.run((FRAMES + 2) * period_us * 1e-6)
        overhead = (_exception_cycles(machine) - before) / (FRAMES + 2)
        awake = (machine.awake_ticks() - awake) // machine.rcc.hclk_ticks
    finally:
        scene.board.close()
    ticks = [at for at, address in enumerate(trace.addresses) if address == elf.symbol(TICK).address][: FRAMES + 1]
    steps = [at for at, address in enumerate(trace.addresses) if address == elf.symbol(STEP).address]
    path = [elf.instruction(address) for address in trace.addresses[: ticks[-1]]]
    stores = {
        one.address
        for one in set(path)
        if one.name == "str" and (symbol := elf.symbol_at(one.address)) and symbol.name in FEEDS_THE_CRC_UNIT
    }
    costs = list(path_steps(path, stores))
    frames = [costs[begin:end] for begin, end in pairwise(ticks)]
    cycles = [sum(one.cycles for one in frame) + overhead for frame in frames]
    cycles_2ws = [sum(one.cycles_2ws for one in frame) + overhead for frame in frames]
    code = {elf.symbol_at(one.address) for one in set(path)}
    return LiveFrame(
        min(map(len, frames)), max(map(len, frames)), round(max(cycles)), round(sum(cycles) / len(cycles)),
        round(max(cycles_2ws)), round(sum(cycles_2ws) / len(cycles_2ws)), round(awake / (FRAMES + 2)),
        sum(bisect_left(steps, end) - bisect_left(steps, begin) != 1 for begin, end in pairwise(ticks)),
        sum(symbol.size for symbol in code if symbol is not None), max(one.stack for one in costs),
        period_us,
    )  # fmt: skip
