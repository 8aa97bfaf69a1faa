"""Wiring of the board for `turntable`."""

from __future__ import annotations

from plumb.systems.wiring import ADAPTER, ANALOG, CAN, CAN_POWER, COMMON, STRAP_NOTE, Device, Drawing, Wire

DRAWINGS = (
    Drawing(
        "turntable",
        "turntable: three gyro and three angular-acceleration inputs",
        "standard",
        left=(ADAPTER, CAN),
        right=(
            Device(
                "angular acceleration, 0 to 3.3 V",
                (
                    Wire("Z", "PB1", ANALOG),
                    Wire("Y", "PB0", ANALOG),
                    Wire("X", "PA3", ANALOG),
                    Wire("supply, GND", "3V3 GND"),
                ),
                3.4,
            ),
            Device(
                "gyros, 0 to 3.3 V",
                (
                    Wire("Z", "PA2", ANALOG),
                    Wire("Y", "PA1", ANALOG),
                    Wire("X", "PA0", ANALOG),
                    Wire("supply, GND", "3V3 GND"),
                ),
                12,
            ),
        ),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            "Outputs above 3.3 V need a divider; sources of up to 50 kΩ are fine. This system moves nothing.",
        ),
    ),
)
