"""A virtual board with the flash image and sensors of either kind, begun, armed and watched from its link."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import pytest

pytest.importorskip("unicorn")

from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.itg3205 import Itg3205
from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot
from plumb.flash.elf import Elf
from plumb.flash.image import find_image
from plumb.link.identity import sensors_text
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec.parameters import table
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.quad import scenarios as quad
from support.kept import as_made

PERIOD_US = 5000
NEUTRAL_US = 1000.0
CONTROL_WORDS = sum(row.owner == "control" for row in table())
ANALOG_3, DIGITAL = 1, 3
"""BOARD_SENSORS_ANALOG_3 and BOARD_SENSORS_BALANCE of app/board_sensors.h."""
SENSORS_AT = 23
"""Place of `sensors` in control_system_t (firmware/systems/control.h)."""
FLASH = 0x08000000
NO_CONVERSIONS, STEPS_MISSED, SENSOR = 1, 2, 0x40
SELECT_PIN = 4
BOOT_US = 30_000
READY_S = 0.7
"""A run at rest from its first step on may be armed by then."""
RECOVERY_S = 0.15
"""Clearing the bus, setting up both chips, and their first samples."""


def world(scale: tuple[float, float, float], noise: float, seed: int) -> Callable[[float], tuple[float, float, float]]:
    chance = random.Random(seed)

    def felt(_time_s: float) -> tuple[float, float, float]:
        x, y, z = (value + noise * chance.gauss(0.0, 1.0) for value in scale)
        return x, y, z

    return felt


@dataclass
class Bench:
    """A board with sensors, begun and watched from its link."""

    machine: Machine
    session: Session
    words: dict[str, int] = field(default_factory=dict)
    control: Sequence[int] | None = None
    """Control part of the parameters; None: the board's own."""
    name: str = ""
    """Of what `bench_as_made` keeps; empty: not kept."""
    made_at: int = 0

    def begin(self, **words: int) -> Capture:
        return self.begin_with(self.control or self.session.read_parameters()[:CONTROL_WORDS], **words)

    def begin_with(self, control: Sequence[int], **words: int) -> Capture:
        self.words = {"period_us": PERIOD_US, "esc_period_us": 2500, "arm_hold_ms": 0} | words
        self.session.upload(control, **self.words)
        self.session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
        return Capture(self.session)

    def run(self, capture: Capture, seconds: float) -> int:
        """How many steps it took."""
        before, end = capture.steps, self.session.clock() + seconds
        while self.session.clock() < end:
            capture.feed(self.session.receive(0.002))
        return capture.steps - before

    def armed(self, **words: int) -> Capture:
        """Begun and armed. A bench of `bench_as_made` comes here before a test changes anything: what the first test
        waited for, the others get from a snapshot."""
        name = f"{self.name} {sorted(words.items())}"
        if self.name and name in _armed:
            capture, snapshot = _armed[name]
            self.machine.restore(snapshot)
            return capture
        made = not self.name or self.machine.now == self.made_at
        assert made, "a bench is armed before anything else happens to it"
        capture = self.begin(**words)
        self.run(capture, READY_S)
        self.session.arm()
        self.run(capture, 0.1)
        assert self.driving()
        if self.name:
            _armed[name] = capture, self.machine.snapshot(self, capture)
        return capture

    def driving(self) -> bool:
        return any(self.machine.pwm(pin).pulse_us != NEUTRAL_US for pin in ("PB6", "PB7"))

    def reported(self) -> list[str]:
        """What the board says of its sensors, from here on."""
        self.session.telemetry.pop("SENSORS", None)
        end = self.session.clock() + 0.25
        while "SENSORS" not in self.session.telemetry and self.session.clock() < end:
            self.session.receive(0.01)
        return sensors_text(self.session.telemetry["SENSORS"])

    def faults(self) -> int:
        return self.session.connect()["FAULTS"]

    def bus_failures(self) -> int:
        self.reported()
        return self.session.telemetry["SENSORS"]["bus_failures"]

    def recovers(self, capture: Capture) -> None:
        """No fault any more, samples again, and it can be armed again: by a command, not by itself."""
        self.run(capture, RECOVERY_S)
        assert self.reported() == []
        assert not self.driving()
        assert self.run(capture, 0.1) >= 0.1e6 / PERIOD_US - 2
        self.session.arm(ready_wait_s=4 * READY_S)  # the filter comes back from what the fault did to it
        self.run(capture, 0.05)
        assert self.driving()
        assert self.machine.reset_count == 1
        assert self.machine.warnings == []


@dataclass(kw_only=True)
class DigitalBench(Bench):
    """Its sensors are two chips."""

    gyro: Itg3205
    accel: Adxl345


AnyBench = TypeVar("AnyBench", bound=Bench)

_armed: dict[str, tuple[Capture, Snapshot]] = {}


def bench_as_made(name: str, make: Callable[[], AnyBench]) -> AnyBench:
    """The bench of this name, each time as it was when it was made."""

    def named() -> AnyBench:
        bench = make()
        bench.name, bench.made_at = name, bench.machine.now
        return bench

    return as_made(f"bench {name}", named)


def image(**options: Any) -> Machine:
    try:
        return Machine(find_image(), **options)
    except UsageError as error:
        pytest.skip(str(error))


def fit(machine: Machine, *, spi: bool = False) -> tuple[Itg3205, Adxl345]:
    gyro = Itg3205(machine, world((1.0, 2.0, -3.0), 0.4, 1))
    accel = Adxl345(machine, world((0.1, 0.2, 0.95), 0.004, 2))
    machine.i2c_bus.slaves.append(gyro)
    if spi:
        machine.spi1.devices[SELECT_PIN] = accel
    else:
        machine.i2c_bus.slaves.append(accel)
    return gyro, accel


DIGITAL_CONTROL = quantise(replace(quad.ADAPTIVE, calibration=balancer.CALIBRATION)).words()
"""For the system with two speed controllers on digital sensors."""


def boot_digital(machine: Machine) -> None:
    """From here on the system with two speed controllers samples the digital sensors."""
    boot_sampling(machine, DIGITAL)


def boot_sampling(machine: Machine, kind: int) -> None:
    """From here on the system with two speed controllers samples sensors of this kind (BOARD_SENSORS_ of
    app/board_sensors.h): its entry in the description of systems is changed. Sensors and outputs are under test here,
    not what is computed in between."""
    machine.advance_us(BOOT_US)
    elf, flash = Elf(find_image().with_suffix(".elf")), machine.cpu.flash
    to, other = (elf.symbol(f"{name}_system").address - FLASH + SENSORS_AT for name in ("quad", "balancer"))
    assert (flash[to], flash[other]) == (ANALOG_3, DIGITAL)
    flash[to] = kind
