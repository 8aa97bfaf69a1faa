"""Wiring of the board for `wheels`, with either of two drivers.

What a driver does by itself is from its data sheet: Toshiba TB6612FNG (2014-10-01), table "H-SW Control Function";
ST VNH5019A-E (Doc ID 15701), table 1, table 11 and the sentence about PWM above it. 5 V at a pin: ST STM32F103x8,
table 5, column "I/O level".
"""

from __future__ import annotations

from plumb.systems.wiring import (
    ADAPTER,
    CAN_POWER,
    CAN_WIRES,
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
    Device,
    Drawing,
    Wire,
    battery,
    on_spi,
)

STRAP = Device(
    "strap: pin set wheels", (Wire("jumper", "PB4", INPUT), Wire("jumper", "PB5", INPUT), Wire("", "GND")), 11
)
RIGHT_ENCODER = Device(
    "encoder of the right wheel, 3.3 V",
    (Wire("A", "PB6", INPUT), Wire("B", "PB7", INPUT), Wire("supply, GND", "3V3 GND")),
    14.4,
)
LEFT_ENCODER = Device(
    "encoder of the left wheel, 3.3 V",
    (Wire("B", "PA1", INPUT), Wire("A", "PA0", INPUT), Wire("supply, GND", "3V3 GND")),
    16.4,
)
RECEIVER = Device("receiver", (Wire("TX, CRSF", "PB11", INPUT), Wire("5V, GND", "5V GND")), -1)
RIDER = Device("switch under the rider", (Wire("closed = ridden", "PA3", INPUT), Wire("", "GND")), 8.4)
BATTERY = battery("PA2", None, 11.8)
NOTES = (
    f"{COMMON} On wheels: a converter from the battery to the pin 5V.",
    "The strap chooses the pin set at the start: PB4 and PB5 to GND. The parameters agree with it after",
    "plumb params tuning wheels --save.",
    "10 kΩ to GND at PWM and directions: during a reset nothing else keeps them low.",
    "Encoders by 3V3: PA0 and PA1 do not stand 5 V. Forward, A leads B on both wheels; if not, exchange A and B.",
    "The receiver is used after plumb params set receiver=1 --save.",
    DIVIDER_NOTE,
    CAN_WIRES,
    *CAN_POWER,
)


def drivers(titles: tuple[str, str], off: Wire, inputs: tuple[str, ...], *supplies: Wire) -> tuple[Device, ...]:
    """The boxes of both motors' drivers, left and right. off: what PB12 is on; inputs: names of PWM, directions forward
    and backward of the left motor, then of the right one; supplies: of the left box, and
    of the right one where it has its own."""
    pwm_left, forward_left, backward_left, pwm_right, forward_right, backward_right = inputs
    left = ((backward_left, "PB13"), (pwm_left, "PB14"), (pwm_right, "PB15"), (forward_left, "PA8"))
    right = ((backward_right, "PB1"), (forward_right, "PB0"))
    return (
        Device(titles[0], (off, *(Wire(name, pin, OUTPUT, PULL_DOWN) for name, pin in left), supplies[0]), -1),
        Device(titles[1], (*(Wire(name, pin, OUTPUT, PULL_DOWN) for name, pin in right), *supplies[1:]), 3.8),
    )


TB6612 = drivers(
    ("TB6612FNG, channel A: left motor", "TB6612FNG, channel B: right motor"),
    Wire("STBY: a switch, closed to 3V3", "PB12", INPUT, PULL_DOWN),
    ("PWMA", "AIN1", "AIN2", "PWMB, of channel B", "BIN1", "BIN2"),
    Wire("VCC, GND", "3V3 GND"),
)
TB6612_NOTES = (
    "Disarmed, PWM and both directions are low. The data sheet gives IN1 = IN2 = L with PWM = H alone: outputs off, the"
    " motors coast. With PWM = L: not stated.",
    "Switch open: STBY low, outputs off, the motors coast whatever the board does. PB12 low: the timer drops PWM, and"
    " the board disarms. The chip has no fault output.",
    "Wire of PB12 off: PWM drops at once, the directions when the loop sees it. Until then short brake (one IN = H,"
    " PWM = L).",
    "Motors of up to 13.5 V; 1.2 A mean, 3.2 A peak a channel.",
)
VNH5019 = drivers(
    ("VNH5019 of the left motor", "VNH5019 of the right motor"),
    Wire("EN/DIAG, both of both boards", "PB12", INPUT, "3.3 kΩ to 3V3"),
    ("PWM", "INA", "INB", "PWM of the right board", "INA", "INB"),
    Wire("VDD, GND", "3V3 GND"),
    Wire("VDD, GND", "3V3 GND"),
)
VNH5019_NOTES = (
    "Disarmed, PWM and both directions are low. INA = INB = L takes the low sides, PWM = L turns both off: all four"
    " switches are off, the motors coast.",
    "A driver's fault, or a switch from EN/DIAG to GND: all half-bridges of both boards off, the motors coast; the"
    " timer drops PWM, and the board disarms.",
    "Wire of PB12 off: PWM drops at once, the directions when the loop sees it. Until then one high side is on, both"
    " low sides are off: no drive; brake or coast: not stated.",
    "VDD is 3.3 V: PB12 is pulled down inside, and does not stand 5 V. Carriers with pull-ups at EN/DIAG need no"
    " others.",
)

DRIVERS = (
    ("wheels", "a TB6612FNG for both motors", TB6612, TB6612_NOTES),
    ("wheels_vnh5019", "a VNH5019 for each motor", VNH5019, VNH5019_NOTES),
)
"""Name of the drawing, and what drives the motors: in words, its boxes, its notes."""

DRAWINGS = (
    *(
        Drawing(
            name,
            f"wheels: an MPU-6050, encoders, {what}",
            "wheels",
            left=(driver[0], ADAPTER, STRAP, RIGHT_ENCODER, MPU6050),
            right=(RECEIVER, driver[1], RIDER, BATTERY, LEFT_ENCODER, SWITCH),
            notes=(*notes, *NOTES, *MPU6050_NOTES, SWITCH_NOTE),
        )
        for name, what, driver, notes in DRIVERS
    ),
    *(
        Drawing(
            f"{name}_{way.gyro.name}",
            f"wheels: {way.gyro.title} on SPI, encoders, {what}",
            "wheels",
            left=(driver[0], ADAPTER, STRAP, RIGHT_ENCODER),
            right=(RECEIVER, driver[1], on_spi(way)[0], RIDER, BATTERY, LEFT_ENCODER, SWITCH),
            notes=(*notes, *NOTES, *on_spi(way)[1], SWITCH_NOTE),
        )
        for name, what, driver, notes in DRIVERS
        for way in CHIPS_ON_SPI
    ),
)
