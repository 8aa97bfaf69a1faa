"""Wiring of the board for `quadrotor`."""

from __future__ import annotations

from plumb.systems.wiring import (
    ADAPTER,
    CAN,
    CAN_POWER,
    CHIPS_ON_SPI,
    COMMON,
    DIVIDER_NOTE,
    INPUT,
    MPU6050,
    MPU6050_NOTES,
    OUTPUT,
    PULL_DOWN,
    SWITCH,
    SWITCH_NOTE,
    TWO_CHIPS,
    Device,
    Drawing,
    Wire,
    battery,
    on_spi,
)

ROTORS = Device(
    "four speed controllers",
    (
        Wire("front right", "PA0", OUTPUT, PULL_DOWN),
        Wire("front left", "PA1", OUTPUT, PULL_DOWN),
        Wire("rear left", "PA2", OUTPUT, PULL_DOWN),
        Wire("rear right", "PA3", OUTPUT, PULL_DOWN),
        Wire("GND of all", "GND"),
    ),
    8,
)
RECEIVER = Device(
    "receiver",
    (Wire("TX, CRSF", "PB11", INPUT), Wire("or PPM", "PA8", INPUT), Wire("5V, GND", "5V GND")),
    4,
)
BATTERY = battery("PB0", "PB1", 13.4)
NOTES = (
    COMMON,
    *CAN_POWER,
    "The strap chooses the pin set at the start: PB4 to GND, PB5 open. The parameters agree with it after",
    "plumb params tuning quadrotor --save.",
    "10 kΩ to GND at every signal: during a reset nothing else keeps it low.",
    "Speed controllers, plain PWM of 50 to 490 Hz, taught 1000 to 2000 us. One red wire may feed 5V, without USB then.",
    "Seen from above, front right and rear left turn clockwise, the others counter-clockwise.",
    "The receiver is used after plumb params set receiver=1 --save; with 3 for PPM.",
    DIVIDER_NOTE,
    "Propellers off: a host arms it over a link, which is for the bench.",
    SWITCH_NOTE,
)

DRAWINGS = (
    Drawing(
        "quadrotor",
        "quadrotor: an MPU-6050, four speed controllers",
        "quadrotor",
        left=(ADAPTER, CAN, MPU6050),
        right=(RECEIVER, ROTORS, BATTERY, SWITCH),
        notes=(*NOTES, *MPU6050_NOTES),
    ),
    Drawing(
        "quadrotor_two_chips",
        "quadrotor: gyro and accelerometer, four speed controllers",
        "quadrotor",
        left=(ADAPTER, CAN, TWO_CHIPS),
        right=(RECEIVER, ROTORS, BATTERY, SWITCH),
        notes=NOTES,
    ),
    *(
        Drawing(
            f"quadrotor_{way.gyro.name}",
            f"quadrotor: {way.gyro.title} on SPI, four speed controllers",
            "quadrotor",
            left=(ADAPTER, CAN),
            right=(RECEIVER, on_spi(way)[0], ROTORS, BATTERY, SWITCH),
            notes=(*NOTES, *on_spi(way)[1]),
        )
        for way in CHIPS_ON_SPI
    ),
)
