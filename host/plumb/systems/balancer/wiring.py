"""Wiring of the board for `balancer`."""

from __future__ import annotations

from plumb.systems.wiring import (
    ADXL345_ON_SPI,
    CAN_POWER,
    CAN_WIRES,
    CHIPS_ON_SPI,
    INPUT,
    ITG3205,
    MPU6050,
    MPU6050_NOTES,
    OUTPUT,
    PULL_DOWN,
    SPI_NOTE,
    SWITCH,
    SWITCH_NOTE,
    TWO_CHIPS,
    Device,
    Drawing,
    Wire,
    on_spi,
)

BRIDGE = (
    Device(
        "three-phase bridge, with gate driver",
        (
            Wire("/FAULT (open drain)", "PB12", INPUT, "4.7 kΩ to 3V3"),
            Wire("gate A low", "PB13", OUTPUT, PULL_DOWN),
            Wire("gate B low", "PB14", OUTPUT, PULL_DOWN),
            Wire("gate C low", "PB15", OUTPUT, PULL_DOWN),
            Wire("gate A high", "PA8", OUTPUT, PULL_DOWN),
            Wire("gate B high", "PA9", OUTPUT, PULL_DOWN),
            Wire("gate C high", "PA10", OUTPUT, PULL_DOWN),
            Wire("logic GND", "GND"),
        ),
        -1,
    ),
    Device(
        "Hall sensors of the motor",
        (
            Wire("A", "PA15", INPUT, "4.7 kΩ to 3V3"),
            Wire("B", "PB3", INPUT, "4.7 kΩ to 3V3"),
            Wire("supply, GND", "5V GND"),
        ),
        8.6,
    ),
    Device("strap: pin set bridge", (Wire("jumper", "PB5", INPUT), Wire("", "GND")), 12),
    Device(
        "USB-serial adapter, 3.3 V",
        (
            Wire("RX", "PB6", OUTPUT),
            Wire("TX", "PB7", INPUT, "1 kΩ in series"),
            Wire("GND", "GND"),
        ),
        14.4,
    ),
)
"""Devices left of the Blue Pill in every drawing with the pin set of the bridge."""
HALL_C = Device("Hall sensors of the motor", (Wire("C", "PB10", INPUT, "4.7 kΩ to 3V3"),), 5)
BRIDGE_NOTES = (
    "10 kΩ to GND at every gate input are a must: until the pins are set up, they alone keep the bridge off.",
    "/FAULT low, or its wire off, switches off without any software. A driver without one: tie PB12 to 3V3.",
    "The strap comes first: with PB5 at GND the UART is on PB6, PB7, and no gate is driven before the parameter pins",
    "agrees (plumb params tuning balancer --save, reset). Without the strap PB7 is an output: the 1 kΩ protects it.",
)
BRIDGE_CAN = (CAN_WIRES, *CAN_POWER)


DRAWINGS = (
    Drawing(
        "balancer",
        "balancer: digital sensors, three-phase bridge, Hall sensors",
        "bridge",
        left=(
            *BRIDGE,
            TWO_CHIPS,
        ),
        right=(HALL_C, SWITCH),
        notes=(*BRIDGE_NOTES, *BRIDGE_CAN, SWITCH_NOTE),
    ),
    Drawing(
        "balancer_spi",
        "balancer, its accelerometer on SPI",
        "bridge",
        left=(*BRIDGE, ITG3205),
        right=(
            HALL_C,
            ADXL345_ON_SPI,
            SWITCH,
        ),
        notes=(
            *BRIDGE_NOTES,
            SPI_NOTE,
            *BRIDGE_CAN,
            SWITCH_NOTE,
        ),
    ),
    Drawing(
        "balancer_mpu6050",
        "balancer, an MPU-6050 for both sensors",
        "bridge",
        left=(*BRIDGE, MPU6050),
        right=(HALL_C, SWITCH),
        notes=(*BRIDGE_NOTES, *MPU6050_NOTES, *BRIDGE_CAN, SWITCH_NOTE),
    ),
    *(
        Drawing(
            f"balancer_{way.gyro.name}",
            f"balancer, {way.gyro.title} on SPI for both sensors",
            "bridge",
            left=BRIDGE,
            right=(HALL_C, on_spi(way)[0], SWITCH),
            notes=(*BRIDGE_NOTES, *on_spi(way)[1], *BRIDGE_CAN, SWITCH_NOTE),
        )
        for way in CHIPS_ON_SPI
    ),
)
