"""Wiring of the board for `quad`."""

from __future__ import annotations

from plumb.systems.wiring import (
    ADAPTER,
    ANALOG,
    CAN,
    CAN_POWER,
    COMMON,
    OUTPUT,
    STRAP_NOTE,
    SWITCH,
    SWITCH_NOTE,
    Device,
    Drawing,
    Wire,
)

SPEED_CONTROLLERS = Device(
    "two speed controllers",
    (
        Wire("signal 0", "PB6", OUTPUT, "10 kΩ to GND"),
        Wire("signal 1", "PB7", OUTPUT, "10 kΩ to GND"),
        Wire("GND of both", "GND"),
    ),
    13.4,
)
PULL_DOWNS = "10 kΩ to GND at every signal: from power-on until the pins are set up nothing else keeps it low."

DRAWINGS = (
    Drawing(
        "quad",
        "quad: analog gyro and accelerometer, two speed controllers",
        "standard",
        left=(ADAPTER, CAN, SPEED_CONTROLLERS),
        right=(
            Device(
                "MMA7260 accelerometer, 1.5 g",
                (
                    Wire("Z, second axis", "PA2", ANALOG),
                    Wire("Y, the tilt axis", "PA1", ANALOG),
                    Wire("VDD, /SLEEP", "3V3"),
                    Wire("GND, g-select 1, 2", "GND"),
                ),
                8,
            ),
            Device(
                "ENC-03 gyro",
                (Wire("OUT", "PA0", ANALOG), Wire("VCC, GND", "3V3 GND")),
                13.6,
            ),
            SWITCH,
        ),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            PULL_DOWNS,
            "Speed controllers, one-way PWM, have a battery of their own: leave the red wire of their plug open.",
            "Propellers off until the rest works.",
            SWITCH_NOTE,
        ),
    ),
)
