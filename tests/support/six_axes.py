"""A bench whose board samples all six axes, from ADXL345 and ITG-3205 or from one chip."""

from __future__ import annotations

from dataclasses import dataclass

from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.invensense import Invensense
from plumb.f103.attached.itg3205 import Itg3205
from plumb.f103.machine import Machine
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec import imu_chips
from plumb.spec.system import SENSORS
from plumb.systems.fitted_chips import fit
from support.sensor_bench import DIGITAL_CONTROL, SELECT_PIN, Bench, bench_as_made, boot_sampling, image, world

SIX_AXES = SENSORS.index("SIX_AXES")
ON_I2C, ON_SPI, IN_GYRO = 0, 1, 2
"""Values of the parameter accel_bus."""
ONE_CHIP = [way.number for way in imu_chips.ways() if way.gyro is way.accel]
"""Those of one chip with both sensors."""
ONE_CHIP_NAMES = [imu_chips.ways()[bus].gyro.name for bus in ONE_CHIP]
RATES, FORCES = ((1.0, 0.0, 16.0), 0.4), ((0.1, 0.2, 0.95), 0.004)
"""Means and noise. The system under test takes rates for accelerations: 16 deg/s is about its 1 g."""


@dataclass(kw_only=True)
class Six(Bench):
    """chips: of the gyro, then of the accelerometer; the same one twice where one has both."""

    chips: tuple[Itg3205 | Invensense, Adxl345 | Invensense]
    bus: int

    def begin(self, **words: int) -> Capture:
        return super().begin(**{"accel_bus": self.bus, **words})

    @property
    def mpu(self) -> Invensense:
        chip = self.chips[0]
        assert isinstance(chip, Invensense)
        return chip


def made(bus: int, kind: int = SIX_AXES, machine: Machine | None = None) -> Six:
    machine = machine or image()
    rates, forces = world(*RATES, 1), world(*FORCES, 2)
    chips: tuple[Itg3205 | Invensense, Adxl345 | Invensense]
    way = imu_chips.ways()[bus]
    if way.gyro is way.accel:
        both = fit(machine, way.gyro.name, rates, forces)
        chips = both, both
    else:
        chips = Itg3205(machine, rates), Adxl345(machine, forces)
        machine.i2c_bus.slaves.append(chips[0])
        if bus == ON_SPI:
            machine.spi1.devices[SELECT_PIN] = chips[1]
        else:
            machine.i2c_bus.slaves.append(chips[1])
    boot_sampling(machine, kind)
    return Six(machine, Session.open(machine.uart), chips=chips, bus=bus, control=DIGITAL_CONTROL)


def six(bus: int) -> Six:
    return bench_as_made(f"six axes {bus}", lambda: made(bus))
