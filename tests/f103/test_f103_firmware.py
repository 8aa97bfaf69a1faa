"""The flash image itself on the simulated part: repeatable to the byte, the same in every form and on every part."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from plumb.link.identity import Identity

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.f103 import Machine
from plumb.link.lockstep import Lockstep
from plumb.link.session import Session
from plumb.spec.parameters import table

STEPS = 200
START_US = 200_000
"""Long enough for the firmware to give up waiting for a dead crystal."""


class Recorder:
    """The UART, with everything that passes through it."""

    def __init__(self, machine: Machine) -> None:
        self.uart, self.clock_s, self.seen = machine.uart, machine.uart.clock_s, hashlib.sha256()

    def read(self, size: int) -> bytes:
        data = self.uart.read(size)
        self.seen.update(data)
        return data

    def write(self, data: bytes) -> int:
        self.seen.update(data)
        return self.uart.write(data)


def lockstep(machine: Machine, seed: int = 5) -> tuple[list[int], tuple[str, bytes, int], Identity]:
    """Digests of a run, and a fingerprint of every byte on the line, of RAM and of time."""
    machine.advance_us(START_US)
    channel = Recorder(machine)
    chance = np.random.default_rng(seed)
    with Session.open(channel) as session:
        run = Lockstep(session)
        raw = chance.integers(0, 4096, (STEPS, 3))
        digests = run.run(raw, np.zeros(STEPS, np.int64))
        identity = session.identity
    assert machine.warnings == [] and identity is not None
    return digests.tolist(), (channel.seen.hexdigest(), bytes(machine.cpu.ram), machine.now), identity


def test_two_runs_are_the_same_to_the_byte(image: Path) -> None:
    first, second, other = lockstep(Machine(image)), lockstep(Machine(image)), lockstep(Machine(image), seed=6)
    assert first == second
    assert first[0] != other[0]


def test_every_form_of_the_image_runs_the_same(image: Path) -> None:
    runs = [lockstep(Machine(image.with_suffix(suffix))) for suffix in (".bin", ".elf", ".hex")]
    assert runs[0] == runs[1] == runs[2]


def test_what_memory_held_before_does_not_matter(image: Path) -> None:
    assert lockstep(Machine(image, seed=1))[0] == lockstep(Machine(image, seed=2))[0]


OTHER_PARTS = ["stm32f103cb", "stm32f103rct6", "stm32f103ret6", "stm32f103zet6"]


@pytest.mark.parametrize("part", OTHER_PARTS)
def test_every_part_gives_the_same_digests_and_its_own_name(image: Path, part: str) -> None:
    machine = Machine(image, part)
    digests, _, identity = lockstep(machine)
    assert digests == lockstep(Machine(image))[0]
    assert identity["FLASH_KIB"] == machine.part.flash_kib


def test_a_dead_crystal_changes_the_clock_and_not_the_answers(image: Path) -> None:
    machine = Machine(image, crystal=False)
    digests, _, identity = lockstep(machine)
    assert digests == lockstep(Machine(image))[0]
    assert machine.rcc.hclk_ticks * 64 == 40320
    assert identity["FAULTS"] & 0x0100


@pytest.mark.slow
@pytest.mark.parametrize("part", ["stm32f103c8", *OTHER_PARTS])
def test_every_part_keeps_its_parameters_in_pages_of_its_own_size(image: Path, part: str) -> None:
    """Two slots of 2 KiB, erased in pages of 1 KiB or 2 KiB: one save after the other, and each is found again."""
    machine = Machine(image, part)
    for number in range(3):
        machine.advance_us(START_US)
        with Session.open(machine.uart) as session:
            words = session.read_parameters()
            control = [row for row in table() if row.owner == "control"]
            session.upload(words[: len(control)], period_us=3000 + number)
            session.execute("SAVE")
        machine.power_cut()
        machine.power_on()
        machine.advance_us(START_US)
        with Session.open(machine.uart) as session:
            identity = session.connect()
            assert (
                identity.parameter_source == f"saved in flash, number {number + 1}" and identity["FAULTS"] & 0xFF == 0
            )
            assert identity["FLASH_KIB"] == machine.part.flash_kib and identity["RAM_KIB"] == machine.part.ram_kib
            names = [row.name for row in table()]
            assert session.read_parameters()[names.index("period_us")] == 3000 + number
    assert machine.warnings == []
