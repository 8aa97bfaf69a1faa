"""Wiring of the board for `attitude`."""

from __future__ import annotations

from plumb.systems.wiring import (
    ADAPTER,
    ADXL345_ON_SPI,
    CAN,
    CAN_POWER,
    CHIPS_ON_SPI,
    COMMON,
    ITG3205,
    MPU6050,
    MPU6050_NOTES,
    SPI_NOTE,
    STRAP_NOTE,
    TWO_CHIPS,
    Drawing,
    on_spi,
)

OWN_IMAGE = "The image `attitude` has no room for it; `all` and `vehicles` have: plumb flash --image all."
NOTES = (COMMON, *CAN_POWER, STRAP_NOTE, "This system moves nothing.")

DRAWINGS = (
    Drawing(
        "attitude",
        "attitude: gyro and accelerometer on one bus",
        "standard",
        left=(ADAPTER, CAN, TWO_CHIPS),
        notes=NOTES,
    ),
    Drawing(
        "attitude_spi",
        "attitude, its accelerometer on SPI",
        "standard",
        left=(ADAPTER, CAN, ITG3205),
        right=(ADXL345_ON_SPI,),
        notes=(*NOTES, SPI_NOTE),
    ),
    Drawing(
        "attitude_mpu6050",
        "attitude: an MPU-6050 for both sensors",
        "standard",
        left=(ADAPTER, CAN, MPU6050),
        notes=(*NOTES, *MPU6050_NOTES),
    ),
    *(
        Drawing(
            f"attitude_{way.gyro.name}",
            f"attitude: {way.gyro.title} for both sensors, on SPI",
            "standard",
            left=(ADAPTER, CAN),
            right=(on_spi(way)[0],),
            notes=(*NOTES, *on_spi(way)[1], OWN_IMAGE),
        )
        for way in CHIPS_ON_SPI
    ),
)
