"""A set of all six axes of a live board, from ADXL345 and ITG-3205 or from one MPU-6050, on the virtual board with the
flash image: samples in time and in order, each fault by its name, neutral outputs, and recovery."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.invensense import Invensense
from plumb.f103.attached.itg3205 import Itg3205
from plumb.systems import fitted_chips
from support.sensor_bench import DIGITAL, PERIOD_US, RECOVERY_S, SENSOR, STEPS_MISSED
from support.six_axes import IN_GYRO, ON_I2C, ON_SPI, ONE_CHIP, ONE_CHIP_NAMES, Six, made, six

ANOTHER = "another chip answers, or it did not take its settings"


@pytest.fixture
def mpu() -> Six:
    return six(IN_GYRO)


@pytest.fixture(params=ONE_CHIP, ids=ONE_CHIP_NAMES)
def one(request: pytest.FixtureRequest) -> Six:
    """With each chip that has both sensors."""
    return six(request.param)


@pytest.mark.parametrize("bus", [ON_I2C, ON_SPI, *ONE_CHIP], ids=["two on I2C", "two, one on SPI", *ONE_CHIP_NAMES])
def test_a_sample_is_rates_and_accelerations_in_the_order_of_the_axes(bus: int) -> None:
    bench = six(bus)
    capture = bench.begin()
    bench.run(capture, RECOVERY_S)
    rates: list[tuple[int, int, int]] = []
    forces: list[tuple[int, int, int]] = []

    def take(chip: Itg3205 | Adxl345 | Invensense) -> Callable[[float, tuple[int, int, int]], None]:
        def read(_time_s: float, counts: tuple[int, int, int]) -> None:
            if not isinstance(chip, Adxl345):
                rates.append(counts)
            if not isinstance(chip, Itg3205):
                forces.append(chip.force_counts if isinstance(chip, Invensense) else counts)

        return read

    for chip in bench.chips:
        chip.on_read = take(chip)
    before = capture.steps
    bench.run(capture, 0.1)
    raw = capture.raw_counts(before + 12)[before:]
    assert raw[:, :3].tolist() == [list(counts) for counts in rates[:12]]
    assert raw[:, 3:6].tolist() == [list(counts) for counts in forces[:12]]
    assert bench.reported() == [] and bench.machine.warnings == []


def test_the_set_of_the_wheels_works_with_one_chip_too() -> None:
    bench = made(IN_GYRO, DIGITAL)
    capture = bench.begin(imu_axis=1)
    bench.run(capture, RECOVERY_S)
    seen: list[list[int]] = []
    bench.mpu.on_read = lambda _time_s, rates: seen.append(
        [rates[1], bench.mpu.force_counts[0], bench.mpu.force_counts[2]]
    )
    before = capture.steps
    bench.run(capture, 0.1)
    assert capture.raw_counts(before + 10)[before:, :3].tolist() == seen[:10]


def test_one_chip_is_set_to_2000_deg_per_s_and_16_g(one: Six) -> None:
    capture = one.begin(gyro_filter=3)
    one.run(capture, RECOVERY_S)
    registers = one.mpu.registers
    assert (registers[0x1B], registers[0x1C], registers[0x1A], registers[0x19]) == (0x18, 0x18, 3, 0)
    if one.bus != IN_GYRO:
        register, bit = one.mpu.spi_alone
        assert registers[0x1D] == 3 and registers[register] == bit, "filter of the accelerometer; I2C is off"
    raw = capture.raw_counts(capture.steps)[-1]
    assert raw[2] == pytest.approx(16.0 * 16.4, abs=60) and raw[5] == pytest.approx(0.95 * 2048, abs=60)


def test_a_sample_of_one_chip_is_complete_half_a_millisecond_after_its_tick(mpu: Six) -> None:
    """Behind every second one a setting is read again, in 0.1 ms."""
    machine, taken_us = mpu.machine, []
    mpu.run(mpu.begin(), 0.05)
    for _ in range(6):
        machine.advance_us(PERIOD_US - machine.tim3.count(machine.now) + 1)
        busy_us = 0.0
        for _ in range(120):
            machine.advance_us(5)
            if machine.i2c1.phase != "idle":
                busy_us = machine.tim3.count(machine.now)
        taken_us.append(busy_us)
    assert sum(300 < taken <= 500 for taken in taken_us) >= 3 and max(taken_us) <= 500 + 110


@pytest.mark.slow
@pytest.mark.parametrize("identity", fitted_chips.identities("mpu6050"), ids=hex)
def test_chips_that_are_sold_as_mpu6050_are_taken(mpu: Six, identity: int) -> None:
    mpu.mpu.identity = identity
    capture = mpu.begin(gyro_filter=1)  # other settings: it is started anew
    mpu.run(capture, RECOVERY_S)
    assert mpu.reported() == [] and mpu.run(capture, 0.1) >= 0.1e6 / PERIOD_US - 2


@pytest.mark.slow
@pytest.mark.parametrize("identity", [0x00, 0x69, 0xFF], ids=hex)
def test_any_other_chip_is_reported(mpu: Six, identity: int) -> None:
    mpu.mpu.identity = identity
    capture = mpu.begin(gyro_filter=1)
    assert mpu.run(capture, 0.2) == 0
    assert mpu.reported() == [f"gyro: {ANOTHER}", f"accelerometer: {ANOTHER}"]
    with pytest.raises(LinkError, match="another chip"):
        mpu.session.arm()
    mpu.mpu.identity = 0x68
    mpu.recovers(capture)


@pytest.mark.slow
def test_two_chips_where_one_is_expected_are_reported() -> None:
    """The ITG-3205 has the MPU-6050's address, and the same identity, in another register."""
    bench = six(ON_I2C)
    capture = bench.begin(accel_bus=IN_GYRO)
    assert bench.run(capture, 0.2) == 0
    assert bench.reported() == [f"gyro: {ANOTHER}", f"accelerometer: {ANOTHER}"]


@pytest.mark.slow
def test_a_chip_that_does_not_take_its_settings_is_reported(one: Six) -> None:
    """Awake at +-250 deg/s and +-2 g: counts of another range would be worse than none."""
    chip = one.mpu
    honest = chip.written

    def written(register: int, value: int) -> None:
        if register not in (0x1B, 0x1C):
            honest(register, value)

    chip.written = written  # type: ignore[method-assign]
    chip.brown_out()
    capture = one.begin(gyro_filter=1)
    assert one.run(capture, 0.2) == 0
    assert one.reported() == [f"gyro: {ANOTHER}", f"accelerometer: {ANOTHER}"]
    chip.written = honest  # type: ignore[method-assign]
    one.recovers(capture)


@pytest.mark.slow
def test_one_chip_that_does_not_answer(one: Six) -> None:
    capture = one.armed()
    one.mpu.answers = False
    one.run(capture, 2 * PERIOD_US * 1e-6 + 0.003)
    assert not one.driving()
    assert one.reported() == ["gyro: does not answer", "accelerometer: does not answer"]
    assert one.faults() & SENSOR
    assert one.run(capture, 0.1) == 0, "no sample is made up"
    one.mpu.answers = True
    one.recovers(capture)


@pytest.mark.slow
def test_one_access_that_fails_is_tried_again_and_costs_no_step(mpu: Six) -> None:
    capture = mpu.armed()
    failures = mpu.bus_failures()
    honest = mpu.mpu.begin
    refusals = [False, False]
    mpu.mpu.begin = lambda reading, now: honest(reading, now) and (not refusals or refusals.pop())  # type: ignore[method-assign, assignment]
    assert mpu.run(capture, 0.2) >= 0.2e6 / PERIOD_US - 1
    assert mpu.driving() and mpu.bus_failures() - failures == 2
    assert mpu.faults() & STEPS_MISSED == 0


@pytest.mark.slow
@pytest.mark.parametrize("clocks", [1, 5, 9])
def test_one_chip_that_holds_the_data_line_is_clocked_free(mpu: Six, clocks: int) -> None:
    capture = mpu.armed()
    bus = mpu.machine.i2c_bus
    bus.stick(clocks)
    assert mpu.machine.run_until(lambda: bus.held == 0, 30_000)
    mpu.run(capture, 0.015)
    assert not mpu.driving()
    mpu.recovers(capture)


@pytest.mark.slow
def test_a_shorted_data_line_is_reported_for_as_long_as_it_lasts(mpu: Six) -> None:
    capture = mpu.armed()
    mpu.machine.i2c_bus.short(True)
    mpu.run(capture, 0.015)
    assert not mpu.driving()
    assert mpu.reported() == ["gyro: its bus hangs", "accelerometer: its bus hangs"]
    mpu.run(capture, 0.5)
    assert set(mpu.reported()) & {"gyro: its bus hangs", "gyro: does not answer"}
    mpu.machine.i2c_bus.short(False)
    mpu.recovers(capture)


@pytest.mark.slow
def test_one_chip_whose_data_hang(one: Six) -> None:
    """3 equal samples of all six axes are beyond noise: 30 ms at the default filter. To that add up to a period until
    the first of them, one until the last is judged, one until the next step, and the pulse that runs."""
    capture = one.armed()
    one.mpu.frozen = True
    one.run(capture, 0.030 - 2 * PERIOD_US * 1e-6)
    assert one.driving()
    one.run(capture, 6 * PERIOD_US * 1e-6)
    assert not one.driving()
    assert one.reported()[0] in ("gyro: its data do not change", "gyro: has no data")
    one.run(capture, 0.3)
    assert len(one.reported()) == 2
    one.mpu.frozen = False
    one.run(capture, RECOVERY_S)
    one.recovers(capture)


@pytest.mark.slow
def test_the_accelerations_of_one_chip_hang_alone(mpu: Six) -> None:
    capture = mpu.armed()
    mpu.mpu.forces_frozen = True
    mpu.run(capture, 0.030 - 2 * PERIOD_US * 1e-6)
    assert mpu.driving()
    mpu.run(capture, 5 * PERIOD_US * 1e-6)
    assert not mpu.driving()
    mpu.run(capture, 0.1)
    assert mpu.reported() == ["accelerometer: its data do not change"]
    mpu.mpu.forces_frozen = False
    mpu.run(capture, RECOVERY_S)
    mpu.recovers(capture)


@pytest.mark.slow
def test_one_chip_that_lost_its_settings_gets_them_again(one: Six) -> None:
    """A dip of the supply: it is asleep, its data stand still."""
    capture = one.armed()
    one.mpu.brown_out()
    one.run(capture, 0.1)
    assert not one.driving()
    one.recovers(capture)
    assert one.mpu.registers[0x1B] == one.mpu.registers[0x1C] == 0x18
