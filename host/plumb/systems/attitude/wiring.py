"""Wiring of the board for `attitude`."""

from __future__ import annotations

from plumb.systems.wiring import (
    ADAPTER,
    ADXL345_ON_SPI,
    CAN,
    CAN_POWER,
    COMMON,
    ITG3205,
    MPU6050,
    MPU6050_NOTES,
    SPI_NOTE,
    STRAP_NOTE,
    TWO_CHIPS,
    Drawing,
)

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
)
