"""A pilot has armed the flash image by his receiver: it bridges a sensor that is gone for a moment, and stops the
rotors when it stays away."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.boards.virtual_machine import open_machine
from plumb.f103.attached.mpu6050 import Mpu6050
from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot
from plumb.link.identity import disarmed_text
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.systems import load
from plumb.tuning.quantise import quantise
from support.noise import with_noise

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.elf"
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
SYSTEM = load("quadrotor")
PARAMS = quantise(SYSTEM.TUNINGS["hummingbird"])
PINS = ("PA0", "PA1", "PA2", "PA3")
NEUTRAL_US, HOLD_MS = 1000.0, 100
SENSOR = 0x0040
FRAME_S = 0.004
START_US = 20_000


class Flown:
    """A machine, the host that listens to it, and its pilot."""

    def __init__(self) -> None:
        self.sensor: Mpu6050
        self._noise = 0

        def couple(machine: Machine) -> None:
            self.sensor = Mpu6050(machine, lambda _s: self._felt(0.0, 0.0, 0.0), lambda _s: self._felt(0.0, 0.0, 1.0))
            machine.i2c_bus.slaves.append(self.sensor)

        self.machine = open_machine(IMAGE, strap="quadrotor", couple=couple)
        session = Session.open(self.machine.uart)
        link = {**PARAMS.link_words(), **SYSTEM.LINK, "period_us": 2500, "arm_hold_ms": HOLD_MS}
        session.upload(PARAMS.words(), **link, receiver=1, accel_bus=2)
        session.execute("SAVE")
        session.close()
        self.machine.reset()
        self.machine.advance_us(START_US)
        self.machine.uart.reset_input_buffer()
        self.session = Session.open(self.machine.uart)
        self.session.connect()
        self.passes(4.0, crsf.sticks())

    def _felt(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        self._noise += 1
        a, b, c = (0.0006 * count for count in with_noise((0, 0, 0), self._noise, 3))
        return x + a, y + b, z + c

    def passes(self, seconds: float, frame: bytes) -> None:
        end = due = self.session.clock()
        end += seconds
        while self.session.clock() < end:
            if self.session.clock() >= due:
                self.machine.usart3.receive(frame)
                due += FRAME_S
            self.session.receive(0.002)

    @property
    def armed(self) -> bool:
        return bool(self.session.telemetry["STATUS"]["armed"])

    @property
    def pulses_us(self) -> list[float]:
        return [self.machine.pwm(pin).pulse_us for pin in PINS]


UP = crsf.sticks(throttle=0.3, on=True)


@pytest.fixture(scope="module")
def taken() -> Iterator[tuple[Flown, Snapshot]]:
    flown = Flown()
    assert not flown.armed
    flown.passes(0.25, crsf.sticks(on=True))
    flown.passes(0.25, UP)
    yield flown, flown.machine.snapshot()


@pytest.fixture
def flown(taken: tuple[Flown, Snapshot]) -> Iterator[Flown]:
    yield taken[0]
    taken[0].machine.restore(taken[1])
    taken[0].sensor.answers = True


def turn(pulses_us: list[float]) -> bool:
    return all(1200.0 < pulse < 1500.0 for pulse in pulses_us)


def test_the_switch_of_the_pilot_turns_the_rotors(flown: Flown) -> None:
    assert flown.armed and turn(flown.pulses_us)
    flown.passes(0.03, crsf.sticks(throttle=0.3))
    assert flown.pulses_us == [NEUTRAL_US] * 4


def test_a_sensor_that_is_gone_for_20_ms_is_bridged(flown: Flown) -> None:
    flown.sensor.answers = False
    flown.passes(0.02, UP)
    flown.sensor.answers = True
    flown.passes(0.5, UP)
    assert flown.armed and turn(flown.pulses_us)
    assert flown.session.telemetry["SENSORS"]["bus_failures"] > 0
    assert not flown.session.telemetry["STATUS"]["faults"] & SENSOR, "it is back"


def test_a_sensor_that_stays_away_stops_the_rotors_after_50_ms(flown: Flown) -> None:
    flown.sensor.answers = False
    flown.passes(0.04, UP)
    assert turn(flown.pulses_us)
    flown.passes(0.04, UP)
    assert flown.pulses_us == [NEUTRAL_US] * 4
    flown.passes(0.3, UP)
    said = flown.session.telemetry
    assert not flown.armed and "no samples came" in disarmed_text(said["EVENTS"]["disarm_cause"], said["PLAUSIBILITY"])
