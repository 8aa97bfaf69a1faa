"""Snapshots of the virtual board: what is restored goes on byte for byte as it did, and no state is forgotten."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb import systems
from plumb.boards import plant_on_pins
from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import quantise
from plumb.f103.attached.canwire import BIT_RECESSIVE
from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot, wiring
from plumb.link.session import Session
from plumb.systems.contracts import PINS
from support.flash_image import image_path

TRAFFIC_S = 0.05
LOOK_US = 100


@pytest.fixture(scope="module")
def image() -> bytes:
    return image_path().read_bytes()


@pytest.fixture(scope="module", params=[("quad", "serial"), ("balancer", "can")], ids=lambda param: "-".join(param))
def board(request: pytest.FixtureRequest, image: bytes) -> Iterator[VirtualBoard]:
    """Armed and driving its plant, over either link."""
    name, link = request.param
    system, joined = systems.load(name), systems.load(name, PINS)
    run = system.scenario(joined.SCENARIO, 1, seconds=5.0)
    with VirtualBoard(link=link) as board:
        params = quantise(system.TUNINGS[joined.TUNING])
        session = plant_on_pins.configure_as(board, params, period_us=run.period_us, arm_hold_ms=0, **system.LINK)
        joined.couple(board.machine, system.plant(run))
        board.machine.tim1.trace = []
        board.machine.advance_us(plant_on_pins.FOUND_US)
        session.begin("REALTIME_LIVE", frames=joined.FRAMES)
        session.arm()
        traffic(board, 0.1)
        yield board


def traffic(board: VirtualBoard, seconds: float = TRAFFIC_S) -> list[object]:
    """Every frame with the time it came, every change of the pins, and what the run leaves in memory."""
    machine, session, received = board.machine, board.session, []
    pins: list[object] = []

    def look(now: int) -> None:
        levels = (machine.pwm("PB6"), machine.pwm("PB7"), machine.bridge())
        if not pins or pins[-1] != levels:
            pins.append(levels)
        machine.timeline.at("look", now + LOOK_US * TICKS_PER_US, look)

    look(machine.now)
    session.set_setpoint(1 << 24)
    end_s = session.clock() + seconds
    while session.clock() < end_s:
        received.append((session.clock(), session.receive(0.002)))
    machine.timeline.cancel("look")
    return [
        received,
        pins,
        list(machine.tim1.trace or []),
        machine.now,
        bytes(machine.cpu.ram),
        bytes(machine.cpu.flash),
    ]


def state(*roots: object) -> list[object]:
    """All that a snapshot of the roots reaches, as plain values: references by their number."""
    reached = Snapshot(*roots).reached
    number = {id(entry): place for place, entry in enumerate(reached)}

    def plain(value: Any) -> object:
        if id(value) in number:
            return f"object {number[id(value)]}"
        if isinstance(value, dict):
            return [(plain(key), plain(part)) for key, part in value.items()]
        if isinstance(value, list | tuple | deque):
            return [plain(part) for part in value]
        if isinstance(value, set | frozenset):
            return sorted(map(repr, value))
        if isinstance(value, np.ndarray | memoryview | bytearray):
            return bytes(value)
        if isinstance(value, random.Random):
            return value.getstate()
        return value if isinstance(value, int | float | str | bytes | None) else type(value).__name__

    return [
        (type(entry).__name__, [(name, plain(part)) for name, part in attributes(entry) if name not in wired(entry)])
        for entry in reached
    ]


def attributes(entry: object) -> list[tuple[str, object]]:
    return list(getattr(entry, "__dict__", {}).items())


def wired(entry: object) -> frozenset[str]:
    return wiring(type(entry))


@pytest.mark.slow
def test_what_is_restored_goes_on_byte_for_byte(board: VirtualBoard) -> None:
    """Frames with their times, pins, edges of the bridge, memories, and the state of every peripheral."""
    snapshot = board.machine.snapshot(board.session)
    first: Any = traffic(board)
    assert first[0] and len(first[1]) > 1, "there is something to compare"
    left = state(board.machine, board.session)
    for _ in range(3):
        board.machine.restore(snapshot)
        assert traffic(board) == first
        assert state(board.machine, board.session) == left
    board.machine.restore(snapshot)
    assert board.machine.warnings == []


def test_a_restored_machine_is_the_one_that_was_kept(board: VirtualBoard) -> None:
    """Through everything that leaves deep traces: a crash of each kind of supply, a dead crystal, stuck buses."""
    machine = board.machine
    snapshot = machine.snapshot(board.session)
    before = state(machine, board.session)
    machine.i2c_bus.stick(5)
    machine.can.wire.fail_sending.extend([BIT_RECESSIVE] * 40)
    machine.uart.write_with_noise(b"\x55" * 20)
    machine.adc["PA0"] = 3.3
    traffic(board)
    machine.rcc.kill_crystal()
    machine.advance_us(20_000)
    machine.brown_out()
    machine.advance_us(60_000)
    machine.power_cut()
    machine.power_on()
    assert state(machine, board.session) != before
    machine.restore(snapshot)
    assert state(machine, board.session) == before


def scramble(value: Any) -> None:
    """Other content for whatever can hold any."""
    if isinstance(value, list | deque):
        value.clear()
        value.append("scrambled")
    elif isinstance(value, dict):
        dict.clear(value)
    elif isinstance(value, set):
        value.add("scrambled")
    elif isinstance(value, bytearray):
        value[:] = b"\xa5" * len(value)
    elif isinstance(value, memoryview) and not value.readonly:
        value[:] = bytes(byte ^ 0xA5 for byte in value)
    elif isinstance(value, random.Random):
        value.random()


def test_every_attribute_of_every_peripheral_is_state_or_declared_wiring(board: VirtualBoard) -> None:
    """Every attribute of every object that the machine leads to is overwritten, its content before it: all come back.
    A peripheral added tomorrow is reached through the bus, and is no exception."""
    machine = board.machine
    snapshot = machine.snapshot(board.session)
    before, reached = state(machine, board.session), snapshot.reached
    found = {id(entry) for entry in reached}
    assert all(id(peripheral) in found for peripheral in machine.bus.peripherals)
    first = traffic(board)
    machine.restore(snapshot)
    objects = {id(entry) for entry in reached}
    for entry in reached:
        for name, part in attributes(entry):
            if name not in wired(entry) and id(part) not in objects:
                scramble(part)
    for entry in reached:
        for name, _part in attributes(entry):
            if name not in wired(entry):
                vars(entry)[name] = "scrambled"
        vars(entry)["added"] = True
    snapshot.restore()
    assert state(machine, board.session) == before
    assert traffic(board) == first
    machine.restore(snapshot)


def test_declared_wiring_exists_and_never_changes(board: VirtualBoard) -> None:
    """A name that no longer exists, or an attribute that is rebound in a run, is no wiring."""
    machine = board.machine
    snapshot = machine.snapshot(board.session)
    before = {
        (type(entry).__name__, name): vars(entry)[name] for entry in snapshot.reached for name in sorted(wired(entry))
    }
    assert ("Cpu", "uc") in before and ("Bus", "readers") in before
    traffic(board)
    machine.reset()
    machine.advance_us(60_000)
    for entry in snapshot.reached:
        for name in wired(entry):
            assert vars(entry)[name] is before[type(entry).__name__, name]
    machine.restore(snapshot)


@dataclass
class Held:
    value: int = 1
    parts: list[int] = field(default_factory=lambda: [1, 2])


class Novel(Peripheral):
    """A peripheral that the snapshot does not know."""

    REGISTERS = (Register("data", 0x00),)
    data: int

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine, "NOVEL", 0x40015000)
        self.held = [Held()]
        self.by_pin = {"PA0": deque([1])}
        count = 0

        def counted() -> int:
            nonlocal count
            count += 1
            return count

        self.counted = counted
        self.chance = random.Random(1)
        self.curve = np.arange(4.0)


def test_a_new_peripheral_is_kept_without_a_word_about_it(image: bytes) -> None:
    machine = Machine(image)
    novel = Novel(machine)
    machine.bus.attach(novel)
    snapshot = machine.snapshot()
    values = machine.bus.writers[novel.base][1]
    drawn = random.Random(1).random()
    for _ in range(2):
        values(77)
        assert novel.counted() == 1 and novel.chance.random() == drawn
        novel.held[0].value = 2
        novel.held[0].parts.append(3)
        novel.held.append(Held())
        novel.by_pin["PA0"].append(2)
        novel.curve[1] = 9.0
        assert novel.data == 77
        machine.restore(snapshot)
        assert novel.data == 0 and novel.held == [Held()] and novel.by_pin == {"PA0": deque([1])}
        assert novel.curve.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_what_cannot_be_kept_is_refused_by_its_place(image: bytes) -> None:
    machine = Machine(image)
    novel = Novel(machine)
    machine.bus.attach(novel)
    vars(novel)["stream"] = (byte for byte in b"abc")
    with pytest.raises(SimulationError, match=r"generator at root 0.*\.stream: make it plain state, or name it in WIR"):
        machine.snapshot()


def test_flash_and_the_program_in_it_come_back(image: bytes) -> None:
    """Saved parameters, and code that was overwritten and run in between."""
    machine = Machine(image)
    machine.advance_us(60_000)
    with Session.open(machine.uart) as session:
        snapshot = machine.snapshot(session)
        before = bytes(machine.cpu.flash)
        session.execute_idle("SAVE")
        assert bytes(machine.cpu.flash) != before
        entry = int.from_bytes(before[4:8], "little") & ~1
        machine.flash.store(entry - 0x08000000, b"\xfe\xe7")  # a branch to itself
        machine.cpu.forget_code()
        machine.reset()
        machine.advance_us(20_000)
        assert machine.cpu.pc == entry
        machine.restore(snapshot)
        assert bytes(machine.cpu.flash) == before
        machine.reset()
        machine.advance_us(60_000)
    with Session.open(machine.uart) as session:
        assert session.connect().reset_cause == "reset pin"


def test_no_snapshot_of_a_running_core_or_of_the_rom(image: bytes) -> None:
    machine = Machine(image)
    snapshot = machine.snapshot()
    machine.cpu.running = True
    with pytest.raises(SimulationError, match="while the core runs"):
        machine.restore(snapshot)
    machine.cpu.running = False
    machine.boot0 = True
    machine.reset()
    with pytest.raises(SimulationError, match="ROM bootloader"):
        machine.snapshot()
    machine.restore(snapshot)
    assert machine.rom is None
