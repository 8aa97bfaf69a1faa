"""A pilot's receiver on the board: the sticks of a run in real time, on the native board and on the flash image."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb.boards.native.mcu import NativeMcu
from plumb.boards.pulse_train import on_native, on_pin
from plumb.contract import run_fixed
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.flash.elf import Elf
from plumb.link.lockstep import Lockstep
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.spec.protocol import protocol
from plumb.systems.quadrotor import quantise, scenarios
from support.image_patches import patched
from support.noise import with_noise

PARAMS = quantise.quantise(scenarios.TUNINGS["hummingbird"])
PERIOD_US = 2500
STATE = "QUADROTOR_STATE"
FRAMES = [*RAW_FRAMES[:4], STATE]
QUADROTOR = 2
"""BOARD_PINS_QUADROTOR of the firmware."""
IMAGE = Path(__file__).parents[2] / "build/images/quadrotor/firmware.elf"
LOST_FLAG, FLIES_FLAG = 1 << 7, 1 << 5
FLOWN, STOPPED = 0, 3
READY_S = 1.1
"""At rest: the tilt is sure by then, and rotors may be switched on."""
LATE, OVERRUN = 0x0002, 0x0200
"""Of the board's faults."""
CAPTURE_IRQ = 27
BYTE_S = 10 / crsf.BAUD


@dataclass
class Flight:
    """A board, its host, and the line of its receiver."""

    session: Session
    receive: Callable[[bytes], object]
    board: Any
    """The machine, or the native board."""
    capture: Capture = field(init=False)

    def begin(self, receiver: int = 1, run: str = "REALTIME_LIVE") -> None:
        self.session.upload(PARAMS.words(), period_us=PERIOD_US, accel_bus=2, receiver=receiver)
        self.capture = Capture(self.session, raw_frames=set(RAW_FRAMES[:4]))
        self.session.begin(run, frames=FRAMES)
        self.session.listener = self.capture.feed

    def fly(self, seconds: float, frame: bytes, period_s: float = 0.004) -> None:
        """Send the frame again and again; without one, time passes."""
        end = self.session.clock() + seconds
        due = self.session.clock()
        while self.session.clock() < end:
            if frame and self.session.clock() >= due:
                self.receive(frame)
                due += period_s
            self.session.receive(0.001)

    def newest(self) -> tuple[list[int], int, int, int]:
        """Commands, throttle, flags and phase of the newest step that came whole."""
        states = self.capture.values[(STATE, "phase")]
        step = max(self.capture.raw.keys() & states.keys())
        throttle = self.capture.setpoints.of_steps(step + 1, step)[0]
        flags = self.capture.values[(STATE, "flags")][step]
        return self.capture.raw[step][6:11], int(throttle), flags, states[step]


def native() -> Flight:
    mcu = NativeMcu(power=False)
    mcu.wires.strap = QUADROTOR
    mcu.wires.receiver_byte_ns = round(BYTE_S * 1e9)
    mcu.power_on()
    mcu.sense([5, -3, 2, 20, 40, 2048])
    return Flight(Session.open(mcu.uart), mcu.receiver_send, mcu)


def virtual() -> Flight:
    pytest.importorskip("unicorn")
    from plumb.boards.virtual_machine import open_machine
    from plumb.f103.machine import Machine
    from plumb.systems.fitted_chips import fit

    def rates(time_s: float) -> tuple[float, float, float]:
        """With noise: data that stand still are those of a stuck sensor."""
        x, y, z = (0.06 * count for count in with_noise((5, -3, 2), round(1e6 * time_s), 3))
        return x, y, z

    def forces(time_s: float) -> tuple[float, float, float]:
        x, y, z = (count / 2048 for count in with_noise((20, 40, 2048), round(1e6 * time_s) + 1, 3))
        return x, y, z

    def couple(machine: Machine) -> None:
        fit(machine, "mpu6050", rates, forces)

    machine = open_machine(IMAGE, strap="quadrotor", couple=couple)
    return Flight(Session.open(machine.uart), machine.usart3.receive, machine)


BOARDS = [native, virtual]
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")


@pytest.fixture(params=BOARDS, ids=["native", "virtual"])
def flight(request: pytest.FixtureRequest) -> Flight:
    made: Flight = request.param()
    return made


def replayed(capture: Capture) -> None:
    """The recorded inputs through the integer model give the digests of the board."""
    steps = min(capture.steps, len(capture.raw))
    assert steps > 50 and capture.setpoints.doubt is None
    inputs = np.array([capture.raw[step] for step in range(steps)], np.int16)
    words = run_fixed.run_control(PARAMS, inputs, capture.setpoints.of_steps(steps))
    assert words.digests().tolist() == [capture.digest[step] for step in range(steps)]


def test_a_flight_by_receiver_replays_to_the_bit(flight: Flight) -> None:
    flight.begin()
    flight.fly(0.02, b"")
    assert flight.newest()[:2] == ([0, 0, 0, 0, 0], 0), "no frame has come yet"
    flight.fly(READY_S, crsf.sticks())
    flight.fly(0.05, crsf.sticks(on=True))
    commands, throttle, flags, phase = flight.newest()
    assert (commands[:4], throttle, phase) == ([0, 0, 0, 1], 0, FLOWN) and flags & FLIES_FLAG
    for k in range(12):
        flight.fly(0.02, crsf.sticks(throttle=k / 24, roll=k / 12, pitch=-k / 20, yaw=1 - k / 12, on=True, rate=k > 6))
    commands, throttle, flags, _ = flight.newest()
    assert commands[:4] == [30046, -18003, 2720, 3] and throttle == 15014
    assert 0 < commands[4] < 256 and flags & FLIES_FLAG
    flight.session.end()
    replayed(flight.capture)


def test_a_silent_receiver_is_lost_after_100_ms_and_so_is_one_without_its_transmitter(flight: Flight) -> None:
    flight.begin()
    flight.fly(READY_S, crsf.sticks())
    flight.fly(0.08, crsf.sticks(on=True, throttle=0.1))
    assert flight.newest()[2] & FLIES_FLAG
    flight.fly(0.09, b"")
    assert not flight.newest()[2] & LOST_FLAG
    flight.fly(0.03, b"")
    commands, _, flags, phase = flight.newest()
    assert flags & LOST_FLAG and phase == STOPPED and not flags & FLIES_FLAG
    raw = flight.capture.raw
    received = max(step for step in raw if raw[step][10] != commands[4]) + 1
    lost = min(s for s, word in flight.capture.values[(STATE, "flags")].items() if word & LOST_FLAG)
    assert lost - received == 40, "steps of 2.5 ms with the same number"
    flight.fly(0.05, crsf.sticks(on=False))
    assert flight.newest()[3] == FLOWN and not flight.newest()[2] & LOST_FLAG, "switched off, it may fly again"
    flight.receive(crsf.statistics(0))
    flight.fly(0.07, crsf.sticks(on=False))
    assert not flight.newest()[2] & LOST_FLAG, "a frame that is missed"
    flight.fly(0.05, crsf.sticks(on=False))
    assert flight.newest()[2] & LOST_FLAG
    flight.session.end()
    replayed(flight.capture)


@pytest.fixture(params=BOARDS, ids=["native", "virtual"])
def by_pulses(request: pytest.FixtureRequest) -> Flight:
    """A board whose receiver has a pulse train."""
    made: Flight = request.param()
    made.receive = (on_native if isinstance(made.board, NativeMcu) else on_pin)(made.board).receive
    return made


def test_a_flight_by_pulses_replays_to_the_bit_and_a_receiver_that_is_lost_stops_it(by_pulses: Flight) -> None:
    flight = by_pulses
    flight.begin(receiver=3)
    flight.fly(READY_S, crsf.sticks())
    flight.fly(0.1, crsf.sticks(on=True))
    flight.fly(0.06, crsf.sticks(throttle=0.5, roll=1.0, pitch=-0.5, yaw=0.25, on=True, rate=True))
    flight.fly(0.08, crsf.sticks(throttle=0.5, roll=1.0, pitch=-0.5, yaw=0.25, on=True, rate=True))
    commands, throttle, flags, phase = flight.newest()
    wanted = [16383, 32767, -16383, 8191]
    assert all(abs(one - other) < 90 for one, other in zip([throttle, *commands[:3]], wanted, strict=True)), commands
    assert commands[3] == 3 and phase == FLOWN and flags & FLIES_FLAG
    flight.fly(0.15, crsf.sticks(throttle=0.5, on=True, rate=True) + crsf.statistics(0))
    assert flight.newest()[2] & LOST_FLAG, "a throttle below 950 us: its frames count as missing"
    flight.fly(0.05, crsf.sticks(throttle=0.5, on=True, rate=True) + crsf.statistics(100))
    flight.fly(0.15, b"")
    commands, _, flags, _ = flight.newest()
    assert flags & LOST_FLAG
    flight.session.end()
    replayed(flight.capture)


def refusals(flight: Flight) -> list[tuple[int, int]]:
    """Reasons of the NACKs of setpoints, from here on."""
    nack = protocol()["NACK"]
    found = []

    def feed(frames: list[tuple[int, bytes]]) -> None:
        for identifier, data in frames:
            if identifier == nack.identifier:
                said = nack.decode(data)
                found.append((said["request"], said["reason"]))

    before = flight.session.listener
    flight.session.listener = feed
    flight.session.set_setpoint(1000)
    flight.fly(0.03, b"")
    flight.session.listener = before
    return found


def test_a_host_sets_nothing_while_the_receiver_does(flight: Flight) -> None:
    flight.begin()
    flight.fly(0.05, crsf.sticks(on=True, throttle=0.25))
    messages = protocol()
    owner = messages["NACK"].value("reason", "OWNER")
    assert set(refusals(flight)) == {(messages["SETPOINT"].identifier, owner)}
    flight.fly(0.03, crsf.sticks(on=True, throttle=0.25))
    commands, throttle, _, _ = flight.newest()
    assert commands[3] == 1 and throttle == 8196


def test_without_the_parameter_the_host_sets_what_it_did_before(flight: Flight) -> None:
    flight.begin(receiver=0)
    flight.fly(0.05, crsf.sticks(on=True, throttle=0.25))
    assert flight.newest()[:2] == ([0, 0, 0, 0, 0], 0)
    flight.session.set_commands({"roll": 500}, 1000)
    flight.fly(0.05, crsf.sticks(on=True, throttle=0.25))
    assert flight.newest()[:2] == ([500, 0, 0, 0, 0], 1000)


def test_lockstep_takes_every_input_from_the_host(flight: Flight) -> None:
    flight.session.upload(PARAMS.words(), receiver=1)
    run = Lockstep(flight.session)
    for _ in range(4):
        flight.receive(crsf.sticks(on=True, throttle=0.5))
    inputs, throttles = np.zeros((20, 12), np.int16), np.full(20, 5000, np.int32)
    inputs[:, 5], inputs[:, 6], inputs[:, 9] = 2048, np.arange(20) * 100, 1
    assert run.run(inputs, throttles).tolist() == run_fixed.run_control(PARAMS, inputs, throttles).digests().tolist()


STREAMS = {
    "frames": crsf.sticks(on=True, throttle=0.2),
    "frames with a wrong CRC": crsf.sticks()[:-1] + b"\0",
    "beginnings of frames": b"\xc8\x18\x16",
    "frames of other types": crsf.frame(0x1E, bytes(20)),
    "noise": random.Random(1).randbytes(997),
}


@pytest.mark.parametrize("stream", STREAMS)
def test_a_flood_of_bytes_does_not_make_the_loop_late(stream: str) -> None:
    """Bytes back to back for 0.25 s. A turn of the loop takes 1.0 ms without them and 1.2 ms at the worst: the loop
    sleeps for a part of each. A byte costs 20 instructions in its handler."""
    pytest.importorskip("unicorn")
    from unicorn import UC_HOOK_CODE

    flight = virtual()
    machine, elf = flight.board, Elf(IMAGE)
    flight.begin()
    flight.fly(0.1, crsf.sticks())
    turns: list[float] = []
    handled = {"bytes": 0, "instructions": 0}
    poll, handler = elf.symbol("session_poll"), elf.symbol("receiver_uart_handler")
    begin, end = handler.address & ~1, (handler.address & ~1) + handler.size

    def in_handler(_cpu: object, address: int, _size: int, _data: object) -> None:
        handled["instructions"] += 1
        handled["bytes"] += address == begin

    place = poll.address & ~1
    machine.cpu.uc.hook_add(UC_HOOK_CODE, lambda *_: turns.append(machine.now_us), begin=place, end=place + 1)
    machine.cpu.uc.hook_add(UC_HOOK_CODE, in_handler, begin=begin, end=end - 1)
    steps: list[float] = []
    step = elf.symbol("control_step").address & ~1
    machine.cpu.uc.hook_add(UC_HOOK_CODE, lambda *_: steps.append(machine.now_us), begin=step, end=step + 1)
    machine.cpu.forget_code()
    data = STREAMS[stream]
    flight.receive(data * (12_000 // len(data)))
    flight.fly(0.25, b"")
    assert max(b - a for a, b in pairwise(turns)) < 1300.0
    assert 10_000 < handled["bytes"] <= 12_000 and handled["instructions"] <= 25 * handled["bytes"]
    late_us = np.array(steps) - PERIOD_US * np.arange(len(steps))
    assert len(steps) >= 99 and np.ptp(late_us) < 1300.0, "every step comes in the turn behind its tick"
    assert not flight.session.connect()["FAULTS"] & (LATE | OVERRUN) and machine.warnings == []


def own_times(machine: Any) -> defaultdict[int, list[float]]:
    """Interrupt -> how long each run of its handler takes from now on, us, without the handlers that interrupt it."""
    spent_us: defaultdict[int, list[float]] = defaultdict(list)
    running: list[tuple[int, float]] = []  # exception number and begin, the latter moved on by what came in between
    enter, leave = machine.nvic.enter, machine.nvic.leave

    def entered(number: int) -> None:
        running.append((number, machine.now_us))
        enter(number)

    def left() -> int:
        if running:  # not one that had begun before
            number, begin_us = running.pop()
            own_us = machine.now_us - begin_us
            spent_us[number - 16].append(own_us)
            running[:] = [(outer, since_us + own_us) for outer, since_us in running]
        return int(leave())

    machine.nvic.enter, machine.nvic.leave = entered, left
    return spent_us


def test_no_handler_keeps_a_byte_waiting_until_the_next_one_comes() -> None:
    """A byte waits in the data register until the next one is whole, 23.8 us. The longest handler of the same priority
    is the end of a transfer from the sensors. Their counts are checked when the next sample begins. SysTick in
    its midst adds 3.5 us, which may reach the time of a byte: one that is lost is counted, and its frame rejected."""
    flight = virtual()
    machine = flight.board
    flight.begin()
    flight.fly(0.1, crsf.sticks())
    spent_us = own_times(machine)
    flight.receive(crsf.sticks() * 400)
    flight.fly(0.3, b"")
    own_us = max(spent_us[39])
    assert own_us < 1.0 and len(spent_us) > 5
    assert max(map(max, spent_us.values())) + own_us < BYTE_S * 1e6


def test_noise_at_the_pulse_input_makes_no_frames_and_nothing_late() -> None:
    """An edge every 16 us, nearly the fastest that pass the filter of 7.1 us, and faster ones, which do not. The time
    of a handler is its own: SysTick may interrupt it."""
    flight = virtual()
    machine = flight.board
    flight.begin(receiver=3)
    flight.fly(0.1, b"")
    edges_us = own_times(machine)[CAPTURE_IRQ]

    def noise(half_us: float) -> None:
        def toggle(time: int) -> None:
            machine.drive("PA8", not machine.pin("PA8"))
            machine.timeline.at("noise", time + round(half_us * TICKS_PER_US), toggle)

        machine.timeline.at("noise", machine.now + TICKS_PER_US, toggle)

    steps = flight.capture.steps
    noise(8.0)
    flight.fly(0.1, b"")
    assert 6000 < len(edges_us) < 6400 and max(edges_us) < 1.0
    noise(6.5)
    flight.fly(0.02, b"")
    edges = len(edges_us)
    flight.fly(0.05, b"")
    assert len(edges_us) == edges
    assert 66 <= flight.capture.steps - steps <= 69
    assert flight.newest()[0][4] == 0
    assert not flight.session.connect()["FAULTS"] & (LATE | OVERRUN) and machine.warnings == []


def test_a_loop_that_stands_still_loses_the_bytes_behind_the_first_256() -> None:
    pytest.importorskip("unicorn")
    from plumb.boards.strap import set_strap
    from plumb.f103.machine import Machine

    elf = Elf(IMAGE)
    machine = Machine(patched(IMAGE.with_suffix(".bin").read_bytes(), elf, "session_poll", b"\xfe\xe7"))
    set_strap(machine, "quadrotor")
    machine.reset()
    machine.advance_us(10_000)
    data = bytes(n % 251 for n in range(400))
    machine.usart3.receive(data)
    machine.advance_us(10_000)

    def memory(name: str, size: int) -> bytes:
        at = elf.symbol(name).address - 0x20000000
        return bytes(machine.cpu.ram[at : at + size])

    assert memory("sticks_ring", 256) == data[:256] and memory("sticks_errors", 4)[0] == len(data) - 256
    assert machine.reset_count == 2 and machine.warnings == []


def test_damaged_and_lost_bytes_are_counted_and_the_next_frame_counts_again() -> None:
    flight = virtual()
    from plumb.f103.peripherals.usart import FE, ORE

    usart = flight.board.usart3
    flight.begin()
    flight.fly(0.02, crsf.sticks(roll=0.5))
    frame = crsf.sticks(roll=-0.5)
    usart.receive(frame[:10])
    usart.receive(frame[10:11], FE)
    usart.receive(frame[11:12], ORE)
    usart.receive(frame[12:])
    flight.fly(0.01, b"")
    assert flight.newest()[0][0] == 16403
    flight.receive(frame)
    flight.fly(0.01, b"")
    assert flight.newest()[0][0] == -16403
    faults = flight.session.connect()["FAULTS"]
    assert faults & OVERRUN and faults >> 16 & 0xFF == 2


def test_bytes_that_the_loop_does_not_fetch_are_lost_and_counted() -> None:
    flight = native()
    mcu = flight.board
    flight.begin()
    flight.fly(0.02, crsf.sticks(roll=0.5))
    mcu.wires.turn_us = 9000
    flight.receive(crsf.sticks(roll=-0.5) * 24)
    flight.fly(0.03, b"")
    mcu.wires.turn_us = 0
    flight.fly(0.02, b"")
    flight.receive(crsf.sticks(roll=0.25))
    flight.fly(0.02, b"")
    assert flight.newest()[0][0] == 8201
    assert flight.session.connect()["FAULTS"] >> 16 & 0xFF > 50


@pytest.mark.parametrize(
    ("crystal", "pll", "baud"), [(True, True, 36e6 / 86), (False, True, 32e6 / 76), (False, False, 8e6 / 19)]
)
def test_the_line_keeps_its_rate_on_every_clock(crystal: bool, pll: bool, baud: float) -> None:
    pytest.importorskip("unicorn")
    from plumb.boards.strap import set_strap
    from plumb.f103.machine import Machine

    machine = Machine(IMAGE, crystal=crystal)
    machine.rcc.pll_dead = not pll
    set_strap(machine, "quadrotor")
    machine.reset()
    assert machine.run_until(lambda: machine.usart3.cr1 != 0, 1e6)
    assert machine.usart3.baud == pytest.approx(baud) == pytest.approx(crsf.BAUD, rel=0.004)
    assert machine.pin("PB11"), "an open line reads idle"


def test_other_pin_sets_leave_the_line_alone() -> None:
    pytest.importorskip("unicorn")
    from plumb.boards.virtual_machine import open_machine

    machine = open_machine(IMAGE)
    assert machine.usart3.brr == machine.usart3.cr1 == 0 and machine.pin("PB11") is None
