"""A pilot's receiver on the board: the sticks of a run in real time, on the native board and on the flash image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from plumb.boards.native_mcu import NativeMcu
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.spec.protocol import protocol
from plumb.systems import run_fixed
from plumb.systems.quadrotor import quantise, scenarios

PARAMS = quantise.quantise(scenarios.TUNINGS["hummingbird"])
PERIOD_US = 2500
STATE = "QUADROTOR_STATE"
FRAMES = [*RAW_FRAMES[:4], STATE]
QUADROTOR = 2
"""BOARD_PINS_QUADROTOR of firmware/app/board.h."""
IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.elf"
LOST_FLAG, FLIES_FLAG = 1 << 7, 1 << 5
FLOWN, STOPPED = 0, 3
READY_S = 1.1
"""At rest: the tilt is sure by then, and rotors may be switched on."""
BYTE_S = 10 / crsf.BAUD


@dataclass
class Flight:
    """A board, its host, and the line of its receiver."""

    session: Session
    receive: Callable[[bytes], object]
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
    mcu.wires.raw[:] = [5, -3, 2, 20, 40, 2048]
    return Flight(Session.open(mcu.uart), mcu.receiver_send)


def virtual() -> Flight:
    pytest.importorskip("unicorn")
    from plumb.boards.virtual_machine import open_machine
    from plumb.f103.attached.mpu6050 import Mpu6050
    from plumb.f103.machine import Machine

    def couple(machine: Machine) -> None:
        machine.i2c_bus.slaves.append(Mpu6050(machine, lambda _s: (0.3, -0.2, 0.1), lambda _s: (0.01, 0.02, 1.0)))

    machine = open_machine(IMAGE, strap="quadrotor", couple=couple)
    return Flight(Session.open(machine.uart), machine.usart3.receive)


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


def test_a_silent_receiver_is_lost_after_100_ms_and_one_that_says_so_at_once(flight: Flight) -> None:
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
    heard = max(step for step in raw if raw[step][10] != commands[4]) + 1
    lost = min(s for s, word in flight.capture.values[(STATE, "flags")].items() if word & LOST_FLAG)
    assert lost - heard == 40, "steps of 2.5 ms with the same number"
    flight.fly(0.05, crsf.sticks(on=False))
    assert flight.newest()[3] == FLOWN and not flight.newest()[2] & LOST_FLAG, "switched off, it may fly again"
    flight.receive(crsf.statistics(0))
    flight.fly(0.02, b"")
    commands, _, flags, _ = flight.newest()
    assert flags & LOST_FLAG and commands[4] & 256
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
