"""Limits of digital sensors that repeat themselves: from noise at rest, the smallest that does not cry wolf.

A stuck chip gives the same three counts again and again; so does noise, now and then. The least noise at rest is that
of the data sheets as the project uses it: ADXL345 0.75 counts rms on x and y and 1.1 on z at 100 samples/s, ITG-3205
0.38 deg/s rms behind 98 Hz, MPU-6050 0.05 deg/s rms behind 98 Hz and 400 ug/sqrt(Hz), ICM-20602 4 mdeg/s/sqrt(Hz) and
100 ug/sqrt(Hz), MPU-9250 0.1 deg/s rms behind 92 Hz and 300 ug/sqrt(Hz). Slower rates and narrower filters have less:
by the square root of the bandwidth.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from plumb.physics.sensors import Adxl345, Itg3205
from plumb.spec import imu_chips, parameters

CHIPS = Path(__file__).resolve().parents[2] / "firmware/ports/stm32f103"
HOURS = 1e4
FASTEST_S = 0.010
"""Samples are counted at least so far apart, whatever the period."""
GYRO_LSB = Itg3205().lsb_per_dps * 0.38
ACCEL_LSB = Adxl345().noise_lsb
DECLARED = imu_chips.chips()
SENSORS = [(name, which) for name in DECLARED for which in ("gyro", "accel") if getattr(DECLARED[name], which)]
BOTH = [name for name in DECLARED if DECLARED[name].both]
SHORTEST = 3
NEVER_S = 2000.0
"""A limit that the board does not reach."""
ADXL345_HZ = {6: 6.25, 7: 12.5, 8: 25.0, 9: 50.0, 10: 100.0, 11: 200.0, 12: 400.0, 13: 800.0, 14: 1600.0, 15: 3200.0}
GYRO_HZ: dict[str, tuple[float, ...]] = {"itg3205": (188, 98, 42, 20, 10, 5), "mpu6050": (188, 98, 42, 20, 10, 5)}
GYRO_HZ |= {"icm20602": (176, 92, 41, 20, 10, 5), "mpu9250": (184, 92, 41, 20, 10, 5)}
ACCEL_HZ: dict[str, tuple[float, ...]] = {
    "mpu6050": (188, 98, 42, 20, 10, 5),
    "icm20602": (218.1, 99, 44.8, 21.2, 10.2, 5.1),
}
ACCEL_HZ |= {"mpu9250": (218.1, 99, 44.8, 21.2, 10.2, 5.05), "adxl345": tuple(ADXL345_HZ.values())}
RATE_LSB = {"itg3205": GYRO_LSB, "mpu6050": 16.4 * 0.05, "mpu9250": 16.4 * 0.1}
"""Counts rms behind the filter of 98 or 92 Hz."""
ICM20602_RATE_LSB_PER_RTHZ = 16.4 * 0.004
FORCE_LSB_PER_RTHZ = {"mpu6050": 2048 * 400e-6, "icm20602": 2048 * 100e-6, "mpu9250": 2048 * 300e-6}


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


def table(chip: str, which: str) -> list[tuple[float, int, int]]:
    """(interval in s, repeats of all axes, repeats of one axis) by option, as the firmware has them."""
    sensor = getattr(DECLARED[chip], which)
    return [(row.interval_ms * 1e-3, row.whole, row.axis) for row in sensor.still]


def hz_of(chip: str, which: str) -> tuple[float, ...]:
    """Bandwidth or output rate by option."""
    return (GYRO_HZ if which == "gyro" else ACCEL_HZ)[chip]


def noise(chip: str, which: str, hz: float) -> tuple[tuple[float, ...], float]:
    """Least noise in counts by axis, and the time from one sample to the next that does not know of it."""
    if chip == "adxl345":
        less = min(1.0, math.sqrt(hz / 100.0))
        return tuple(less * sigma for sigma in (ACCEL_LSB[0], ACCEL_LSB[0], ACCEL_LSB[1])), max(FASTEST_S, 1.0 / hz)
    independent_s = max(FASTEST_S, 0.5 / hz)
    if which == "accel":
        widest_hz = 98.0 if chip == "mpu6050" else math.inf
        return (FORCE_LSB_PER_RTHZ[chip] * math.sqrt(min(hz, widest_hz)),) * 3, independent_s
    if chip == "icm20602":
        return (ICM20602_RATE_LSB_PER_RTHZ * math.sqrt(hz),) * 3, independent_s
    return (min(1.0, math.sqrt(hz / GYRO_HZ[chip][1])) * RATE_LSB[chip],) * 3, independent_s


def test_the_noise_is_that_of_the_scenarios() -> None:
    assert ACCEL_LSB == (0.75, 1.1) and pytest.approx(5.46, abs=0.01) == GYRO_LSB


@pytest.mark.parametrize(("chip", "which"), SENSORS)
def test_limits_are_the_smallest_with_a_false_alarm_in_10000_hours(chip: str, which: str) -> None:
    """Of all axes together, and of each axis alone; noise that allows no limit gets one that is never reached."""
    options, rows = hz_of(chip, which), table(chip, which)
    assert options == getattr(DECLARED[chip], which).option_hz and len(rows) == len(options)
    for hz, (interval_s, whole, axis) in zip(options, rows, strict=True):
        sigmas, independent_s = noise(chip, which, hz)
        assert interval_s == pytest.approx(math.floor(independent_s * 1000 + 0.5) * 1e-3, abs=1e-9), (chip, hz)
        assert false_alarm_hours(sigmas, whole, interval_s) >= HOURS, (chip, hz)
        assert whole == SHORTEST or false_alarm_hours(sigmas, whole - 1, interval_s) < HOURS, (chip, hz)
        assert one_axis_hours(sigmas, axis - 1, interval_s) < HOURS, (chip, hz)
        assert one_axis_hours(sigmas, axis, interval_s) >= HOURS or axis * interval_s == pytest.approx(NEVER_S), hz


@pytest.mark.parametrize("chip", BOTH)
def test_a_chip_with_both_sensors_is_still_when_all_six_axes_are_for_as_long_as_its_accelerations(chip: str) -> None:
    rates, forces = table(chip, "gyro"), table(chip, "accel")
    for place, (rate, force) in enumerate(zip(rates, forces, strict=True)):
        sigmas_lsb = noise(chip, "gyro", hz_of(chip, "gyro")[place])[0]
        sigmas_lsb += noise(chip, "accel", hz_of(chip, "accel")[place])[0]
        assert false_alarm_hours(sigmas_lsb, force[1], rate[0]) >= HOURS, place


@pytest.mark.parametrize(("chip", "which"), SENSORS)
def test_an_axis_that_stands_while_motors_may_turn_is_found_in_400_ms(chip: str, which: str) -> None:
    """With every option that a board may be armed with: a driven body moves each axis by so much rms at least."""
    text = re.search(r"IMU_STILL_DRIVEN_US (\d+)U", (CHIPS / "imu_watch.h").read_text())
    assert text and int(text[1]) == 400_000
    counts = getattr(DECLARED[chip], which).counts_per_unit
    moved_lsb = counts * (0.4 if which == "gyro" else 5e-3)
    word = "accel_rate" if chip == "adxl345" else "gyro_filter"
    (least, most) = next(row.armed for row in parameters.table() if row.name == word)
    options = enumerate(hz_of(chip, which), DECLARED[chip].option_first)
    for (option, hz), (interval_s, _whole, axis) in zip(options, table(chip, which), strict=True):
        sigma_lsb = max(moved_lsb, *noise(chip, which, hz)[0])
        repeats = math.ceil(0.4 / interval_s)
        if least <= option <= most and axis > repeats:
            assert one_axis_hours((sigma_lsb,) * 3, repeats, interval_s) >= HOURS, option


@pytest.mark.parametrize(("chip", "which"), SENSORS)
def test_an_axis_that_stands_is_found_within_500_ms_with_the_shipped_settings(chip: str, which: str) -> None:
    """Once it should have moved, motors or not: behind 92 Hz and wider, and at 100 samples a second and more."""
    narrower = (chip, which) in (("itg3205", "gyro"), ("mpu6050", "accel"))
    shipped = table(chip, which)[4:] if chip == "adxl345" else table(chip, which)[: 4 if narrower else 2]
    for interval_s, _whole, axis in shipped:
        assert interval_s * axis <= (0.42 if chip == "icm20602" else 0.35), chip


def test_the_shipped_settings_find_a_stuck_chip_in_80_and_30_ms() -> None:
    from plumb.systems.balancer import scenarios as balancer

    for chip, option, least_s in (
        ("adxl345", balancer.LINK["accel_rate"] - 6, 0.080),
        ("itg3205", balancer.LINK["gyro_filter"] - 1, 0.030),
    ):
        interval_s, repeats, _axis = table(chip, "accel" if chip == "adxl345" else "gyro")[option]
        assert max(interval_s, balancer.PERIOD_US * 1e-6) * repeats == pytest.approx(least_s)


def test_equal_readings_of_analog_sensors_are_common_and_a_hundred_are_not() -> None:
    """ENC-03 behind the converter, 0.81 counts rms: five in a row every few seconds of 20 ms steps. 100 single
    conversions never: at 1 kHz, with the noise of the converter alone."""
    five_s = false_alarm_hours((0.81,), 4, 0.020) * 3600.0
    assert 0.5 < five_s < 10.0
    assert false_alarm_hours((0.7,), 100, 0.001) > 1e15
