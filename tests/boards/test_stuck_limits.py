"""Limits of digital sensors that repeat themselves: from noise at rest, the smallest that does not cry wolf.

A stuck chip gives the same three counts again and again; so does noise, now and then. The least noise at rest is that
of the data sheets as the project uses it: ADXL345 0.75 counts rms on x and y and 1.1 on z at 100 samples/s, ITG-3205
0.38 deg/s rms behind 98 Hz, MPU-6050 0.05 deg/s rms behind 98 Hz and 400 ug/sqrt(Hz). Slower
rates and narrower filters have less: by the square root of the bandwidth.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from plumb.physics.sensors import Adxl345, Itg3205
from plumb.spec import parameters

CHIPS = Path(__file__).resolve().parents[2] / "firmware/ports/stm32f103"
HOURS = 1e4
FASTEST_S = 0.010
"""Samples are counted at least so far apart, whatever the period."""
GYRO_LSB = Itg3205().lsb_per_dps * 0.38
ACCEL_LSB = Adxl345().noise_lsb
ADXL345_HZ = {6: 6.25, 7: 12.5, 8: 25.0, 9: 50.0, 10: 100.0, 11: 200.0, 12: 400.0, 13: 800.0, 14: 1600.0, 15: 3200.0}
ITG3205_HZ = {1: 188.0, 2: 98.0, 3: 42.0, 4: 20.0, 5: 10.0, 6: 5.0}
RATES, FORCES = "mpu6050 rates", "mpu6050 forces"
"""The tables of the two sensors of one chip."""
SHORTEST = 3
MPU6050_GYRO_LSB, MPU6050_ACCEL_LSB_PER_RTHZ = 16.4 * 0.05, 2048 * 400e-6


OPTIONS = {"adxl345": ADXL345_HZ, "itg3205": ITG3205_HZ, RATES: ITG3205_HZ, FORCES: ITG3205_HZ}
"""Bandwidth or output rate in Hz, by option of each table."""


def alike(sigma_lsb: float, samples: int) -> float:
    """Chance that so many samples in a row are equal, at the worst place between two codes."""
    codes = np.arange(-40, 42)
    chances = []
    for place in np.linspace(0.0, 0.5, 21):
        edges = np.array([math.erf((code - 0.5 - place) / (sigma_lsb * math.sqrt(2.0))) for code in codes])
        chances.append(float(np.sum((0.5 * np.diff(edges)) ** samples)))
    return max(chances)


def false_alarm_hours(sigmas_lsb: tuple[float, ...], repeats: int, interval_s: float) -> float:
    """Mean time between two alarms of a sound chip at rest: `repeats` samples that equal the one before."""
    chance = math.prod(alike(sigma, repeats + 1) for sigma in sigmas_lsb)
    return interval_s / chance / 3600.0


def one_axis_hours(sigmas_lsb: tuple[float, ...], repeats: int, interval_s: float) -> float:
    """The same of a sensor of which one axis is enough."""
    chance = sum(alike(sigma, repeats + 1) for sigma in sigmas_lsb)
    return interval_s / chance / 3600.0 if chance else math.inf


def table(chip: str) -> list[tuple[float, int, int]]:
    """(interval in s, repeats of all axes, repeats of one axis) by option, as the firmware has them."""
    source, _, name = chip.partition(" ")
    text = (CHIPS / f"{source}.c").read_text()
    body = re.search(rf"imu_still_t {name or 'still'}\[\] = \{{(.*?)\n\}};", text, re.DOTALL)
    assert body
    rows = re.findall(r"\{(\d+)U, +(\d+)U, +(\d+)U\}", body[1])
    made = [(int(ms) * 1e-3, int(whole), int(axis)) for ms, whole, axis in rows]
    last = re.search(r"\.still_last = (\d+)U", text)
    assert last and len(made) == int(last[1]) + 1
    return made + made[-1:] * (len(OPTIONS[chip]) - len(made))


def noise(chip: str, option: int) -> tuple[tuple[float, ...], float]:
    """Least noise in counts by axis, and the time from one sample to the next that does not know of it."""
    if chip == "adxl345":
        hz = ADXL345_HZ[option]
        less = min(1.0, math.sqrt(hz / 100.0))
        return tuple(less * sigma for sigma in (ACCEL_LSB[0], ACCEL_LSB[0], ACCEL_LSB[1])), max(FASTEST_S, 1.0 / hz)
    hz = ITG3205_HZ[option]
    less = min(1.0, math.sqrt(hz / 98.0))
    if chip == RATES:
        return (less * MPU6050_GYRO_LSB,) * 3, max(FASTEST_S, 0.5 / hz)
    if chip == FORCES:
        return (MPU6050_ACCEL_LSB_PER_RTHZ * math.sqrt(min(hz, 98.0)),) * 3, max(FASTEST_S, 0.5 / hz)
    return (less * GYRO_LSB,) * 3, max(FASTEST_S, 0.5 / hz)


def test_the_noise_is_that_of_the_scenarios() -> None:
    assert ACCEL_LSB == (0.75, 1.1) and pytest.approx(5.46, abs=0.01) == GYRO_LSB


@pytest.mark.parametrize(
    ("chip", "options"), [("adxl345", ADXL345_HZ), ("itg3205", ITG3205_HZ), (RATES, ITG3205_HZ), (FORCES, ITG3205_HZ)]
)
def test_limits_are_the_smallest_with_a_false_alarm_in_10000_hours(chip: str, options: dict[int, float]) -> None:
    """Of all axes together, and of each axis alone."""
    rows = table(chip)
    assert len(rows) == len(options)
    for option, (interval_s, whole, axis) in zip(options, rows, strict=True):
        sigmas, independent_s = noise(chip, option)
        assert interval_s == pytest.approx(math.floor(independent_s * 1000 + 0.5) * 1e-3, abs=1e-9), (chip, option)
        assert false_alarm_hours(sigmas, whole, interval_s) >= HOURS, (chip, option)
        assert whole == SHORTEST or false_alarm_hours(sigmas, whole - 1, interval_s) < HOURS, (chip, option)
        assert one_axis_hours(sigmas, axis, interval_s) >= HOURS > one_axis_hours(sigmas, axis - 1, interval_s), option


def test_a_chip_with_both_sensors_is_still_when_all_six_axes_are_for_as_long_as_its_accelerations() -> None:
    for option, (interval_s, whole, _axis) in zip(ITG3205_HZ, table(FORCES), strict=True):
        sigmas_lsb = noise(RATES, option)[0] + noise(FORCES, option)[0]
        assert false_alarm_hours(sigmas_lsb, whole, interval_s) >= HOURS, option


@pytest.mark.parametrize(
    ("chip", "options", "word", "moved_lsb"),
    [
        ("adxl345", ADXL345_HZ, "accel_rate", 256 * 5e-3),
        ("itg3205", ITG3205_HZ, "gyro_filter", 14.375 * 0.4),
        (RATES, ITG3205_HZ, "gyro_filter", 16.4 * 0.4),
        (FORCES, ITG3205_HZ, "gyro_filter", 2048 * 5e-3),
    ],
)
def test_an_axis_that_stands_while_motors_may_turn_is_found_in_400_ms(
    chip: str, options: dict[int, float], word: str, moved_lsb: float
) -> None:
    """With every option that a board may be armed with: a driven body moves each axis by so much rms at least."""
    text = re.search(r"IMU_STILL_DRIVEN_US (\d+)U", (CHIPS / "imu_watch.h").read_text())
    assert text and int(text[1]) == 400_000
    (least, most) = next(row.armed for row in parameters.table() if row.name == word)
    for option, (interval_s, _whole, axis) in zip(options, table(chip), strict=True):
        sigma_lsb = max(moved_lsb, *noise(chip, option)[0])
        repeats = math.ceil(0.4 / interval_s)
        if least <= option <= most and axis > repeats:
            assert one_axis_hours((sigma_lsb,) * 3, repeats, interval_s) >= HOURS, option


def test_an_axis_that_stands_is_found_within_500_ms_with_the_shipped_settings() -> None:
    """Once it should have moved, motors or not: behind 98 Hz and wider, and at 100 samples a second and more."""
    for chip, first, count in ((RATES, 0, 2), (FORCES, 0, 4), ("itg3205", 0, 4), ("adxl345", 4, 6)):
        for interval_s, _whole, axis in table(chip)[first : first + count]:
            assert interval_s * axis <= 0.35, chip


def test_the_shipped_settings_find_a_stuck_chip_in_80_and_30_ms() -> None:
    from plumb.systems.balancer import scenarios as balancer

    for chip, option, least_s in (
        ("adxl345", balancer.LINK["accel_rate"] - 6, 0.080),
        ("itg3205", balancer.LINK["gyro_filter"] - 1, 0.030),
    ):
        interval_s, repeats, _axis = table(chip)[option]
        assert max(interval_s, balancer.PERIOD_US * 1e-6) * repeats == pytest.approx(least_s)


def test_equal_readings_of_analog_sensors_are_common_and_a_hundred_are_not() -> None:
    """ENC-03 behind the converter, 0.81 counts rms: five in a row every few seconds of 20 ms steps. 100 single
    conversions never: at 1 kHz, with the noise of the converter alone."""
    five_s = false_alarm_hours((0.81,), 4, 0.020) * 3600.0
    assert 0.5 < five_s < 10.0
    assert false_alarm_hours((0.7,), 100, 0.001) > 1e15
