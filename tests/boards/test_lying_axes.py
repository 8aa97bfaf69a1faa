"""Single axes of a digital sensor that lie, and chips that lose a setting, on the virtual board with the flash image.

An axis is at its rail, jumps there and back, or stands still: the board says it and disarms within 500 ms.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("unicorn")

from plumb.f103.attached import adxl345, invensense, itg3205
from plumb.f103.attached.chip import Chip, Source
from plumb.f103.attached.invensense import Invensense
from plumb.link.realtime import Capture
from support.sensor_bench import PERIOD_US
from support.six_axes import IN_GYRO, ON_I2C, Six, six

PERIOD_S = PERIOD_US * 1e-6
WITHIN_S = 0.5
GYRO, ACCEL = "gyro", "accelerometer"
FAR = 1e4
"""Beyond the range of every sensor, in its unit."""
STILL, LIMIT = "its data do not change", "is at its limit"
ANOTHER = "another chip answers, or it did not take its settings"
SENSORS = [(IN_GYRO, GYRO), (IN_GYRO, ACCEL), (ON_I2C, GYRO), (ON_I2C, ACCEL)]
NAMED = ["gyro in one chip", "accelerometer in one chip", "ITG-3205", "ADXL345"]


@pytest.fixture
def mpu() -> Six:
    return six(IN_GYRO)


def source_of(bench: Six, which: str) -> tuple[Chip, str]:
    """The chip that has the sensor, and the name of its source."""
    chip = bench.chips[which == ACCEL]
    return chip, "forces" if which == ACCEL and isinstance(chip, Invensense) else "source"


def lies(bench: Six, which: str, axis: int, value: Callable[[float, float], float]) -> Callable[[], None]:
    """This axis of a sensor reads value(true value, time in s). Returns what ends it."""
    chip, name = source_of(bench, which)
    honest: Source = getattr(chip, name)

    def source(time_s: float) -> tuple[float, float, float]:
        felt = list(honest(time_s))
        felt[axis] = value(felt[axis], time_s)
        return felt[0], felt[1], felt[2]

    setattr(chip, name, source)
    return lambda: setattr(chip, name, honest)


def noticed_s(bench: Six, capture: Capture) -> float:
    """Until the outputs are neutral."""
    begin_s = bench.session.clock()
    while bench.driving() and bench.session.clock() - begin_s <= WITHIN_S:
        bench.run(capture, 0.0025)
    return bench.session.clock() - begin_s


def good_again(bench: Six, capture: Capture) -> None:
    """Samples come, nothing is wrong, and nothing drives by itself."""
    assert bench.reported() == [] and not bench.driving()
    assert bench.run(capture, 0.1) >= 0.1 / PERIOD_S - 2


@pytest.mark.slow
@pytest.mark.parametrize(("bus", "which"), SENSORS, ids=NAMED)
@pytest.mark.parametrize("far", [FAR, -FAR], ids=["upper", "lower"])
def test_an_axis_at_its_rail_for_20_ms_disarms(bus: int, which: str, far: float) -> None:
    bench = six(bus)
    capture = bench.armed()
    ends = lies(bench, which, 0, lambda _at, _time_s: far)
    assert 0.020 < noticed_s(bench, capture) < 0.020 + 4 * PERIOD_S
    assert bench.reported() == [f"{which}: {LIMIT}"]
    ends()
    bench.run(capture, 1.5)
    good_again(bench, capture)


@pytest.mark.parametrize(("bus", "which"), SENSORS, ids=NAMED)
def test_a_jump_to_the_rail_is_none(bus: int, which: str) -> None:
    """A blow: 10 ms at the rail."""
    bench = six(bus)
    capture = bench.armed()
    ends = lies(bench, which, 1, lambda _at, _time_s: FAR)
    bench.run(capture, 0.010)
    ends()
    bench.run(capture, 0.1)
    assert bench.driving() and bench.reported() == []


@pytest.mark.slow
@pytest.mark.parametrize(("bus", "which"), SENSORS, ids=NAMED)
@pytest.mark.parametrize("samples", [40, 80])
def test_an_axis_that_jumps_to_its_rail_again_and_again_disarms(bus: int, which: str, samples: int) -> None:
    """At 400 Hz, in one sample of 40 or 80."""
    bench = six(bus)
    capture = bench.armed(period_us=2500)
    every_s = samples * 2.5e-3
    lies(bench, which, 2, lambda at, time_s: FAR if time_s % every_s < 2.5e-3 else at)
    assert noticed_s(bench, capture) <= 3 * every_s + 0.01
    assert bench.reported() == [f"{which}: {LIMIT}"]


def test_a_blow_every_second_is_forgotten(mpu: Six) -> None:
    capture = mpu.armed(period_us=2500)
    lies(mpu, ACCEL, 2, lambda at, time_s: FAR if time_s % 1.5 < 2.5e-3 else at)
    mpu.run(capture, 4.6)
    assert mpu.driving() and mpu.reported() == []


@pytest.mark.slow
@pytest.mark.parametrize(("bus", "which"), SENSORS, ids=NAMED)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_that_stands_still_disarms_within_500_ms(bus: int, which: str, axis: int) -> None:
    """Once the outputs may drive; the others live."""
    bench = six(bus)
    capture = bench.armed()
    kept: list[float] = []

    def stands(at: float, _time_s: float) -> float:
        kept.extend([at][len(kept) :])
        return kept[0]

    ends = lies(bench, which, axis, stands)
    assert noticed_s(bench, capture) < WITHIN_S
    assert bench.reported() == [f"{which}: {STILL}"]
    ends()
    bench.run(capture, 0.1)
    good_again(bench, capture)


@pytest.mark.parametrize("which", [GYRO, ACCEL])
def test_at_rest_an_axis_may_stand_still_until_another_one_turns(mpu: Six, which: str) -> None:
    """Nothing is armed: the rates are 1 deg/s at most, then the one about z is 6 deg/s."""
    capture = mpu.begin()
    at_rest = lies(mpu, GYRO, 2, lambda at, _time_s: at - 16.0)
    lies(mpu, which, 0, lambda _at, _time_s: 0.5)
    mpu.run(capture, 1.5)
    assert mpu.reported() == []
    at_rest()
    lies(mpu, which, 0, lambda _at, _time_s: 0.5)
    lies(mpu, GYRO, 2, lambda at, _time_s: at - 10.0)
    mpu.run(capture, WITHIN_S - 0.25)
    assert mpu.reported() == [f"{which}: {STILL}"]


@pytest.mark.slow
def test_a_gyro_that_stands_still_with_a_live_accelerometer_disarms(mpu: Six) -> None:
    capture = mpu.armed()
    for axis in range(3):
        lies(mpu, GYRO, axis, lambda _at, _time_s: 2.0)
    assert noticed_s(mpu, capture) < 0.15
    assert mpu.reported()[0] == f"{GYRO}: {STILL}"


SETTINGS = [
    (IN_GYRO, 0, invensense.GYRO_CONFIG, 0x00), (IN_GYRO, 0, invensense.ACCEL_CONFIG, 0x00),
    (IN_GYRO, 0, invensense.CONFIG, 0x06), (IN_GYRO, 0, invensense.SMPLRT_DIV, 0x09),
    (IN_GYRO, 0, invensense.PWR_MGMT_1, 0x00),
    (ON_I2C, 0, itg3205.DLPF_FS, 0x00), (ON_I2C, 0, itg3205.SMPLRT_DIV, 0x09), (ON_I2C, 0, itg3205.PWR_MGM, 0x00),
    (ON_I2C, 1, adxl345.DATA_FORMAT, 0x00), (ON_I2C, 1, adxl345.BW_RATE, 0x0A), (ON_I2C, 1, adxl345.FIFO_CTL, 0x40),
]  # fmt: skip
"""Bus, chip, register, and a value that it falls back to: that after power-up, or another."""


@pytest.mark.slow
@pytest.mark.parametrize(("bus", "number", "register", "value"), SETTINGS)
def test_a_setting_that_falls_back_is_noticed_in_200_ms_and_written_again(
    bus: int, number: int, register: int, value: int
) -> None:
    bench = six(bus)
    capture = bench.armed()
    chip = bench.chips[number]
    right, chip.registers[register] = chip.registers[register], value
    assert right != value
    assert noticed_s(bench, capture) < 0.2
    bench.run(capture, 0.05)
    assert chip.registers[register] == right
    good_again(bench, capture)


@pytest.mark.slow
@pytest.mark.parametrize("which", [GYRO, ACCEL])
def test_a_setting_that_is_not_taken_again_is_reported_for_as_long(which: str) -> None:
    bench = six(ON_I2C)
    capture = bench.armed()
    chip = bench.chips[which == ACCEL]
    register = adxl345.DATA_FORMAT if which == ACCEL else itg3205.DLPF_FS
    honest = chip.written
    chip.registers[register] = 0
    vars(chip)["written"] = lambda at, value: None if at == register else honest(at, value)
    assert noticed_s(bench, capture) < 0.2
    bench.run(capture, 1.0)
    assert bench.reported() == [f"{which}: {ANOTHER}"]


@pytest.mark.slow
def test_settings_are_read_again_all_within_200_ms_at_the_slowest_period() -> None:
    """20 ms, and two chips."""
    bench = six(ON_I2C)
    capture = bench.begin(period_us=20_000)
    bench.run(capture, 0.5)
    for chip, register in ((bench.chips[0], itg3205.DLPF_FS), (bench.chips[1], adxl345.DATA_FORMAT)):
        right, chip.registers[register] = chip.registers[register], 0
        bench.run(capture, 0.2)
        assert chip.registers[register] == right
