"""Wiring of a Blue Pill as data: types and devices that the drawings of several systems share.

A system's own wiring is in its wiring.py. tests/f103/test_f103_wiring.py compares every wire with the pin modes that
the booted image sets.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from plumb.spec import imu_chips
from plumb.spec.system_parts import Part

ANALOG, INPUT, OUTPUT, DRAIN = "analog", "input", "output", "open drain"
"""Role of a pin, seen from the STM32."""


@dataclass(frozen=True)
class Wire:
    """One terminal of a device. pin: of the Blue Pill, or a supply; role: None for a supply."""

    label: str
    pin: str
    role: str | None = None
    remark: str = ""


@dataclass(frozen=True)
class Device:
    title: str
    wires: tuple[Wire, ...]
    row: float
    """Row of the Blue Pill's pins at which its first terminal is drawn; lower if the box above needs the space."""


@dataclass(frozen=True)
class Drawing:
    name: str
    title: str
    pins: str
    """The pin set, as the parameter `pins` names it."""
    left: tuple[Device, ...] = ()
    right: tuple[Device, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def wires(self) -> list[Wire]:
        """The wires that end on a pin."""
        return [wire for device in self.left + self.right for wire in device.wires if wire.role]


class WiringDrawings(Protocol):
    """wiring.py: the wiring of a system."""

    @property
    def DRAWINGS(self) -> tuple[Drawing, ...]:
        """One for each set of sensors."""


WIRING = Part[WiringDrawings]("wiring", WiringDrawings, without="nothing is drawn for it")

SWITCH = Device("arm switch (optional)", (Wire("closed = armed", "PC14", INPUT), Wire("", "GND")), 17.5)
ADAPTER = Device(
    "USB-serial adapter, 3.3 V",
    (Wire("RX", "PA9", OUTPUT), Wire("TX", "PA10", INPUT), Wire("GND", "GND")),
    4.5,
)
CAN = Device(
    "CAN transceiver, 3.3 V (optional)",
    (Wire("RXD", "PA11", INPUT), Wire("TXD", "PA12", OUTPUT), Wire("VCC, GND", "3V3 GND")),
    8.6,
)


def _i2c(title: str, owner: str, supplies: tuple[Wire, Wire]) -> Device:
    """Devices on the two wires of I2C1."""
    pulled = "2.2 kΩ to 3V3"
    lines = (Wire(f"SCL{owner}", "PB8", DRAIN, pulled), Wire(f"SDA{owner}", "PB9", DRAIN, pulled))
    return Device(title, lines + supplies, 19.2)


ITG3205 = _i2c("ITG-3205", "", (Wire("VDD, VLOGIC", "3V3"), Wire("GND; AD0, CLKIN", "GND")))
TWO_CHIPS = _i2c(
    "ITG-3205 and ADXL345",
    " of both",
    (Wire("VDD, VLOGIC; ADXL345's /CS", "3V3"), Wire("GND; SDO, AD0, CLKIN", "GND")),
)
ADXL345_ON_SPI = Device(
    "ADXL345",
    (
        Wire("SDA (data in)", "PA7", OUTPUT),
        Wire("SDO (data out)", "PA6", INPUT),
        Wire("SCL (clock)", "PA5", OUTPUT),
        Wire("/CS", "PA4", OUTPUT),
        Wire("VDD, GND", "3V3 GND"),
    ),
    8,
)
SPI_NOTE = "Set the bus of the accelerometer: plumb params set accel_bus=1 --save."
MPU6050 = Device(
    "MPU-6050 (GY-521 module)",
    (
        Wire("SCL", "PB8", DRAIN, "2.2 kΩ to 3V3"),
        Wire("SDA", "PB9", DRAIN, "2.2 kΩ to 3V3"),
        Wire("VCC", "3V3"),
        Wire("GND; AD0", "GND"),
    ),
    19.2,
)
MPU6050_NOTES = (
    "Set that one chip is both sensors: plumb params set accel_bus=2 --save.",
    "A GY-521 has 4.7 kΩ of its own on SCL and SDA. XDA, XCL and INT stay open.",
)


def on_spi(way: imu_chips.Wired) -> tuple[Device, tuple[str, ...]]:
    """A chip with both sensors on SPI, as its declaration says; and the notes."""
    roles = {"PA6": INPUT}
    wires = tuple(Wire(label, pin, roles.get(pin, OUTPUT)) for label, pin in way.gyro.module)
    told = f"The board has to be told which sensors it has: plumb params set accel_bus={way.number} --save."
    return Device(way.gyro.title, (*wires, Wire("VDD, VDDIO, GND", "3V3 GND")), 8), (told,)


CHIPS_ON_SPI = tuple(way for way in imu_chips.ways() if way.gyro is way.accel and way.bus == "SPI")
"""Chips with both sensors that are wired to SPI."""
PULL_DOWN = "10 kΩ to GND"
"""At an input of a driver: during a reset nothing else keeps it low."""


def battery(voltage: str, current: str | None, row: float) -> Device:
    """A battery by its divider. voltage, current: pins that measure them."""
    sensor = (Wire("current sensor, 3.3 V", current, ANALOG),) if current else ()
    divided = Wire("plus, by 47 kΩ", voltage, ANALOG, "10 kΩ, 100 nF to GND")
    return Device("battery (optional)", (divided, *sensor, Wire("minus", "GND")), row)


STRAP_NOTE = "The strap chooses the pin set at the start. Nothing on PB4 and PB5: standard."
COMMON = "Power: 5 V from USB or from the adapter, never both. Every GND is the same wire."
CAN_POWER = (
    "With CAN: power by the pin 5V, or by a USB cable without data wires. PA11 and PA12 are the data lines of the USB",
    "socket, and a charger shorts the two.",
)
CAN_WIRES = "CAN transceiver, 3.3 V: RXD on PA11, TXD on PA12, VCC on 3V3."
"""Used in a drawing that has no room for it as a box."""
DIVIDER_NOTE = (
    "47 kΩ and 10 kΩ divide up to 18.8 V to 3.3 V. It is used after plumb params set battery_min_mv=10500 --save."
)
SWITCH_NOTE = "The arm switch is the dead man's handle: closed it arms without any host, open it lets go at once."
