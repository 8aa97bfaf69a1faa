"""Flipped bits in memory that decides a pulse: found before the next step, disarmed, and named (BOARD_FAULT_UPSET).

Every bit of the checked area is flipped once, while the loop of an armed, driving board sleeps: all of
them with PLUMB_LONG=1, else a sample that touches every word.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("unicorn")

from unicorn import UC_HOOK_MEM_WRITE

from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.f103.peripherals.tim import UDIS
from plumb.f103.snapshot import Snapshot
from plumb.flash.elf import Elf
from plumb.link.sample_codec import samples_text
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from plumb.spec.records import RECORDS
from support.balancer_bench import Balancer
from support.campaigns import campaign
from support.image_patches import without_memory_check
from support.pins import at_rest

BUILD = Path(__file__).parents[2] / "build/stm32f103"
RAM = 0x20000000
UPSET_FAULT, FAULT_CAUSE = 0x4000, 0x08
NEUTRAL_HALFUS = 2000
NEUTRAL_BOUNDS = set(range(1800, 2201))
"""core/esc.h: what a damaged neutral pulse may be, until the parameters are loaded again."""
SLEEP_US = 1100
"""Longest sleep of the loop, and what it takes to come to the check."""
SILENCE_US = 50_000
BITS_PER_WORD = campaign(2, 32)
"""Flipped in each of 360 words."""
PARTS = 8
"""The flips are shared out over so many tests, which run in parallel."""
REPORTED_EVERY = 40
"""Of the flips, the frames of every so many are read by the host, too."""
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]

pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.elf").exists(), reason="the flash image is not built: run make image"
)


def areas(elf: Elf) -> list[range]:
    """Addresses of the checked words: what changes with every turn, and the parameters."""
    names = ("guarded", "guarded_parameters")
    ends = [[elf.symbols[f"{name}_{end}"].address for end in ("start", "end")] for name in names]
    return [range(start, end, 4) for start, end in ends]


@dataclass
class FlippedBoard:
    machine: Machine
    session: Session
    elf: Elf

    def word(self, symbol: str) -> int:
        at = self.elf.symbol(symbol).address - RAM
        return int.from_bytes(self.machine.cpu.ram[at : at + 4], "little")

    def flip(self, address: int, bit: int) -> None:
        self.machine.cpu.ram[address - RAM + bit // 8] ^= 1 << bit % 8

    def sleep(self) -> None:
        """To the loop's next sleep."""
        assert self.machine.run_until(lambda: self.machine.cpu.sleeping, SLEEP_US)

    def pulses(self) -> tuple[int, int]:
        return self.machine.tim4.ccr1, self.machine.tim4.ccr2

    def listen(self, seconds: float = 0.03) -> dict[str, dict[str, int]]:
        for _ in range(round(seconds / 0.005)):
            self.session.receive(0.005)
        return self.session.telemetry


def started(image: bytes, elf: Elf) -> FlippedBoard:
    machine = Machine(image)
    at_rest(machine)
    machine.advance_us(30_000)
    return FlippedBoard(machine, Session.open(machine.uart), elf)


def driving(image: bytes, elf: Elf) -> FlippedBoard:
    """Armed on its own sensors, outputs away from neutral, the loop asleep."""
    board = started(image, elf)
    board.session.upload(CONTROL, period_us=1000, arm_hold_ms=0)
    board.session.begin("REALTIME_LIVE")
    board.session.arm()
    board.listen(0.1)
    assert NEUTRAL_HALFUS not in board.pulses()
    board.sleep()
    return board


@pytest.fixture(scope="module")
def flown(image: bytes, elf: Elf) -> Iterator[tuple[FlippedBoard, Snapshot]]:
    board = driving(image, elf)
    yield board, board.machine.snapshot(board.session)
    board.session.close()


def flips(elf: Elf) -> list[tuple[int, int]]:
    """(address, bit)"""
    chance = random.Random(7)
    words = [address for area in areas(elf) for address in area]
    return [(word, bit) for word in words for bit in chance.sample(range(32), BITS_PER_WORD)]


def test_the_sample_of_flips_touches_every_word(elf: Elf) -> None:
    words = sum(len(area) for area in areas(elf))
    where = flips(elf)
    assert len({address for address, _bit in where}) == words and len(set(where)) == len(where) >= 2 * words


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_every_flip_disarms_before_the_next_pulse_and_is_named(flown: tuple[FlippedBoard, Snapshot], part: int) -> None:
    board, snapshot = flown
    machine = board.machine
    machine.restore(snapshot)
    before = board.pulses()
    for index, (address, bit) in enumerate(flips(board.elf)[part::PARTS]):
        machine.restore(snapshot)
        board.flip(address, bit)
        seen = set()

        def neutral() -> bool:
            if not machine.tim4.cr1 & UDIS:  # while the pulses are written one by one, none of them takes effect
                seen.add(board.pulses())  # noqa: B023
            return board.pulses() == (NEUTRAL_HALFUS, NEUTRAL_HALFUS)

        place = f"bit {bit} of 0x{address:08X}"
        assert machine.run_until(neutral, SLEEP_US), place
        assert all(one == before or set(one) <= NEUTRAL_BOUNDS for one in seen), f"{place}: a step used it"
        if index % REPORTED_EVERY:
            continue
        report = board.listen()
        assert report["STATUS"]["faults"] & UPSET_FAULT and report["STATUS"]["armed"] == 0, place
        assert report["STATUS"]["mode"] == 0 and report["EVENTS"]["disarm_cause"] == FAULT_CAUSE, place
        assert board.pulses() == (NEUTRAL_HALFUS, NEUTRAL_HALFUS), place
        assert machine.reset_count == 1, place


@pytest.mark.parametrize("clock", ["ticks_ms", "last_us"])
def test_no_flip_in_the_clock_keeps_a_silent_host_armed(flown: tuple[FlippedBoard, Snapshot], clock: str) -> None:
    """The clock is written by an interrupt, and lies outside the checked area: set back, it must not stand still until
    it has caught up."""
    board, snapshot = flown
    for bit in range(32):
        board.machine.restore(snapshot)
        board.flip(board.elf.symbol(clock).address, bit)

        def neutral() -> bool:
            return board.pulses() == (NEUTRAL_HALFUS, NEUTRAL_HALFUS)

        assert board.machine.run_until(neutral, SILENCE_US), f"bit {bit} of {clock}"


def test_a_clock_that_is_set_back_is_named(flown: tuple[FlippedBoard, Snapshot]) -> None:
    board, snapshot = flown
    board.machine.restore(snapshot)
    ticks = board.word("ticks_ms")
    board.flip(board.elf.symbol("ticks_ms").address, ticks.bit_length() - 1)
    report = board.listen()
    assert report["STATUS"]["faults"] & UPSET_FAULT and report["STATUS"]["armed"] == 0
    assert report["EVENTS"]["disarm_cause"] == FAULT_CAUSE


def test_without_the_check_flips_move_the_outputs_unreported(image: bytes, elf: Elf) -> None:
    """What the check is for; and that the test above can fail."""
    board = driving(without_memory_check(image, elf), elf)
    snapshot, moved = board.machine.snapshot(board.session), 0
    before = board.pulses()
    start = elf.symbol("control").address
    for address in range(start, start + 160, 4):
        board.machine.restore(snapshot)
        board.flip(address, 30)
        board.machine.advance_us(SLEEP_US)
        moved += any(abs(now - was) > 200 for now, was in zip(board.pulses(), before, strict=True))
        assert board.word("start_faults") == 0
    assert moved
    board.session.close()


def test_a_flipped_last_command_is_gone_with_the_next_step(image: bytes, elf: Elf) -> None:
    """Without the check, too: 23 bits hold every command (core/pid.h). Its bit 31 was 25 s of full command."""
    board = driving(without_memory_check(image, elf), elf)
    snapshot = board.machine.snapshot(board.session)
    board.machine.advance_us(2 * SLEEP_US)
    unhurt = board.pulses()
    places = RECORDS["quad"].fields
    assert places is not None
    command = elf.symbol("control").address + places["command_q22"][1]
    for bit in range(23, 32):
        board.machine.restore(snapshot)
        board.flip(command, bit)
        board.machine.advance_us(2 * SLEEP_US)
        assert board.pulses() == unhurt, bit
    board.session.close()


@pytest.mark.slow
def test_arming_needs_a_new_start_after_an_upset(image: bytes, elf: Elf) -> None:
    """Whatever the host does: commit, begin, greet again. Lockstep goes on, since it moves nothing."""
    board = driving(image, elf)
    board.flip(elf.symbol("params").address + 40, 17)
    assert board.listen()["STATUS"]["faults"] == UPSET_FAULT
    board.session.connect()
    board.session.upload(CONTROL, period_us=1000)
    board.session.begin("REALTIME_LIVE")
    with pytest.raises(LinkError, match="the board has a fault"):
        board.session.arm()
    board.session.begin("LOCKSTEP")
    assert board.listen()["STATUS"]["mode"] == 1
    board.session.close()

    board.machine.reset()
    board.machine.advance_us(30_000)
    with Session.open(board.machine.uart) as session:
        session.upload(CONTROL, period_us=1000, arm_hold_ms=0)
        session.begin("REALTIME_LIVE")
        session.arm()


def test_parameters_are_the_saved_ones_after_an_upset(image: bytes, elf: Elf) -> None:
    board = started(image, elf)
    board.session.upload(CONTROL, period_us=3000)
    board.session.execute("SAVE")
    board.session.upload(CONTROL, period_us=1000)
    words = board.session.read_parameters()
    row = next(index for index, row in enumerate(parameters.table()) if row.name == "period_us")
    assert words[row] == 1000
    board.sleep()
    board.flip(elf.symbol("params").address + 4 * row, 4)
    assert board.listen()["STATUS"]["faults"] & UPSET_FAULT
    assert board.session.read_parameters()[row] == 3000
    board.session.close()


def test_a_flip_while_no_run_is_on_is_found(image: bytes, elf: Elf) -> None:
    board = started(image, elf)
    board.listen(0.2)
    board.sleep()
    board.flip(elf.symbol("params").address, 3)
    assert board.listen(0.2)["STATUS"]["faults"] == UPSET_FAULT
    board.session.close()


def test_a_parameter_that_flips_in_lockstep_is_found_when_the_run_ends(image: bytes, elf: Elf) -> None:
    """In lockstep nothing is checked: nothing can be armed, and the host compares every step."""
    board = started(image, elf)
    board.session.begin("LOCKSTEP")
    board.machine.uart.write(samples_text(protocol(), np.array([[1, 2, 3]] * 4), np.zeros(4, int)).part(0, 4))
    board.listen()
    board.sleep()
    board.flip(elf.symbol("params").address + 4 * 20, 9)
    assert board.listen(0.2)["STATUS"]["faults"] == 0
    board.session.end()
    assert board.listen(0.2)["STATUS"]["faults"] == UPSET_FAULT
    board.session.close()


def test_the_check_cannot_be_switched_off_by_a_flip(image: bytes, elf: Elf) -> None:
    """Nor do its own words forgive: a flip in them is an upset, or changes nothing."""
    board = driving(image, elf)
    snapshot = board.machine.snapshot(board.session)
    for symbol in ("state_word", "parameters_word", "state"):
        for bit in range(32):
            board.machine.restore(snapshot)
            board.flip(elf.symbol(symbol).address, bit)
            board.flip(elf.symbol("params").address, 0)
            assert board.machine.run_until(lambda: board.pulses() == (NEUTRAL_HALFUS,) * 2, SLEEP_US), (symbol, bit)
    board.session.close()


def interrupt_writes(machine: Machine, ranges: list[range]) -> list[int]:
    """Addresses in these ranges that exception handlers write from now on."""
    writes: list[int] = []

    def look(_uc: object, _access: int, address: int, _size: int, _value: int, _user: object) -> None:
        if machine.nvic.active:
            writes.append(address)

    for one in ranges:
        machine.cpu.uc.hook_add(UC_HOOK_MEM_WRITE, look, begin=one.start, end=one.stop - 1)
    return writes


def test_interrupts_write_no_guarded_memory(image: bytes, elf: Elf) -> None:
    """They come while the loop sleeps: what they write there would be found to be damage."""
    board = started(image, elf)
    writes = interrupt_writes(board.machine, areas(elf))
    for run in ("LOCKSTEP", "REALTIME_INJECTED", "REALTIME_LIVE"):
        board.session.begin(run)
        board.listen(0.1)
    board.session.arm()
    board.listen(0.1)
    assert writes == []
    board.session.close()


@pytest.mark.slow
def test_interrupts_of_bridge_and_digital_sensors_write_none_either() -> None:
    balancer = Balancer()
    writes = interrupt_writes(balancer.machine, areas(Elf(BUILD / "firmware.elf")))
    balancer.arm()
    balancer.keep_alive(0.1)
    assert balancer.driving and writes == []


@pytest.mark.slow
def test_a_bridge_is_off_at_the_first_check_after_a_flip(elf: Elf) -> None:
    balancer = Balancer()
    balancer.arm()
    machine = balancer.machine
    machine.run_until(lambda: machine.cpu.sleeping, SLEEP_US)
    snapshot, chance = machine.snapshot(balancer.session), random.Random(11)
    names = ["control", "session", "params", "period", "on_max", "dead_cycles", "wired", "wanted_q15"]
    for name in names * 12:
        machine.restore(snapshot)
        symbol = elf.symbol(name)
        machine.cpu.ram[symbol.address - RAM + chance.randrange(symbol.size)] ^= 1 << chance.randrange(8)
        assert balancer.driving and machine.run_until(lambda: not balancer.driving, SLEEP_US), name


def test_no_state_of_the_loop_lies_outside(elf: Elf) -> None:
    """Core and link keep no variables of their own; those of loop.c are guarded, but for what passes through."""
    guarded = areas(elf)
    firmware = BUILD.parents[1] / "firmware"
    found = []
    for path in [path for folder in ("app", "core", "systems", "link") for path in firmware.glob(f"{folder}/*.c")]:
        text = path.read_text(encoding="utf-8")
        found += re.findall(
            r"^\s*(?:BOARD_\w+ )?static (?!const|inline)[\w ]+?(\w+)(?:\[[^\]]*\])?(?: =[^;]*)?;", text, re.M
        )
    assert {"control", "session", "params", "outputs", "buffers"} <= set(found)
    for name in set(found) - {"buffers"}:
        symbols = [symbol for label, symbol in elf.symbols.items() if label.split(".")[0] == name]
        assert any(symbol.address in range(area.start, area.stop) for symbol in symbols for area in guarded), name
