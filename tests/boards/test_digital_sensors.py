"""ADXL345 and ITG-3205 of a live board, on the virtual board with the flash image: read in time, and when a chip or a
bus fails the right one is named, the outputs go to neutral, nothing hangs, and it recovers when the sensor does."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.link.realtime import Capture
from plumb.link.session import Session
from support.sensor_bench import (
    DIGITAL_CONTROL,
    PERIOD_US,
    RECOVERY_S,
    SENSOR,
    STEPS_MISSED,
    DigitalBench,
    bench_as_made,
    boot_digital,
    fit,
    image,
)


def digital_bench(bus: str) -> DigitalBench:
    machine = image()
    gyro, accel = fit(machine, spi=bus == "spi")
    boot_digital(machine)
    bench = DigitalBench(machine, Session.open(machine.uart), gyro=gyro, accel=accel, control=DIGITAL_CONTROL)
    begin = bench.begin
    bench.begin = lambda **words: begin(accel_bus=int(bus == "spi"), **words)  # type: ignore[method-assign]
    return bench


@pytest.fixture(params=["i2c", "spi"])
def digital(request: pytest.FixtureRequest) -> DigitalBench:
    return bench_as_made(request.param, lambda: digital_bench(request.param))


def begin_apart(digital: DigitalBench, again: Callable[[], None], **words: int) -> Capture:
    """A run whose reads do not meet the gyro's samples, which come every 1 ms: its data sheet does not promise that six
    registers belong to one sample. again: called before every further try."""
    machine, gyro = digital.machine, digital.gyro
    for attempt in range(20):
        machine.advance_us(130 * attempt)
        capture = digital.begin(**words)
        digital.run(capture, 0.05)
        tick_s = machine.now_s - machine.tim3.count(machine.now) * 1e-6
        if (gyro.sampled_s - tick_s) % 1e-3 > 0.45e-3:
            return capture
        digital.session.end()
        again()
    raise AssertionError("no such phase was found")


@pytest.mark.slow
def test_every_period_has_the_newest_sample_of_both_chips(digital: DigitalBench) -> None:
    gyro, accel = digital.gyro, digital.accel
    seen: list[tuple[float, str, float, tuple[int, int, int]]] = []
    gyro.on_read = lambda time_s, counts: seen.append((digital.machine.now_s, "gyro", time_s, counts))
    accel.on_read = lambda time_s, counts: seen.append((digital.machine.now_s, "accel", time_s, counts))
    capture = begin_apart(digital, seen.clear)
    digital.run(capture, 0.3)
    rates, tilts = ([row for row in seen if row[1] == name] for name in ("gyro", "accel"))
    raw = capture.raw_counts(50)
    assert raw[:, 0].tolist() == [counts[1] for *_, counts in rates[:50]]
    assert raw[:, 1].tolist() == [counts[0] for *_, counts in tilts[:50]]
    assert raw[:, 2].tolist() == [counts[2] for *_, counts in tilts[:50]]
    for rows, period_s in ((rates, 1 / 1000), (tilts, 1 / 200)):
        apart_s = [b[0] - a[0] - PERIOD_US * 1e-6 for a, b in pairwise(rows)]
        assert max(map(abs, apart_s)) < 8e-6, "the check of the last counts runs while the bus does"
        assert max(at_s - sampled_s for at_s, _, sampled_s, _ in rows) < period_s + 1e-3
    assert digital.machine.warnings == []


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "pair"), [(0, (1, 2)), (1, (0, 2)), (2, (0, 1))])
def test_the_rate_is_about_the_axle_and_the_accelerations_across_it(
    digital: DigitalBench, axis: int, pair: tuple[int, int]
) -> None:
    capture = begin_apart(digital, lambda: None, imu_axis=axis)
    digital.run(capture, RECOVERY_S)
    seen: dict[str, list[tuple[int, int, int]]] = {"gyro": [], "accel": []}
    digital.gyro.on_read = lambda _time_s, counts: seen["gyro"].append(counts)
    digital.accel.on_read = lambda _time_s, counts: seen["accel"].append(counts)
    before = capture.steps
    digital.run(capture, 0.1)
    raw = capture.raw_counts(before + 10)[before:]
    late = int(raw[0, 0] != seen["gyro"][0][axis])  # a step of a sample that was read before `on_read` was there
    assert raw[late:, 0].tolist() == [counts[axis] for counts in seen["gyro"][: 10 - late]]
    for place in (0, 1):
        assert raw[late:, 1 + place].tolist() == [counts[pair[place]] for counts in seen["accel"][: 10 - late]]


def test_a_sample_is_complete_soon_after_its_tick(digital: DigitalBench) -> None:
    """Within 0.45 ms where both chips are on I2C, 0.25 ms with the accelerometer on SPI. Behind every second one a
    setting is read again, in 0.1 ms."""
    machine, taken_us = digital.machine, []
    digital.run(digital.begin(), 0.05)
    for _ in range(6):
        machine.advance_us(PERIOD_US - machine.tim3.count(machine.now) + 1)  # just begun
        busy_us = 0.0
        for _ in range(100):
            machine.advance_us(5)
            if machine.i2c1.phase != "idle" or machine.spi1.shifting is not None:
                busy_us = machine.tim3.count(machine.now)
        taken_us.append(busy_us)
    sample_us = 250 if machine.spi1.devices else 450
    assert sum(taken <= sample_us for taken in taken_us) >= 3 and max(taken_us) <= sample_us + 110


@pytest.mark.slow
@pytest.mark.parametrize("digital", ["i2c"], indirect=True)
def test_a_period_that_begins_during_a_read_is_counted_as_missed(digital: DigitalBench) -> None:
    """At 2 kHz, with an accelerometer that refuses twice of three times: what was begun is finished."""
    capture = digital.begin(period_us=500)
    digital.run(capture, RECOVERY_S)
    assert digital.run(capture, 0.1) >= 0.1e6 / 500 - 2
    assert digital.faults() & STEPS_MISSED == 0
    honest, turns = digital.accel.begin, 0

    def begin(reading: bool, now: int) -> bool:
        nonlocal turns
        turns += reading
        return honest(reading, now) and not (reading and turns % 3)

    digital.accel.begin = begin  # type: ignore[method-assign, assignment]
    digital.run(capture, 0.1)
    assert digital.faults() & STEPS_MISSED
    with pytest.raises(LinkError, match="fault"):
        digital.session.arm()


@pytest.mark.slow
def test_a_chip_can_be_armed_on_as_soon_as_it_is_there(digital: DigitalBench) -> None:
    """begin, then arm at once: the host waits until the sensors are up."""
    capture = digital.begin()
    digital.session.arm()
    digital.run(capture, 0.1)
    assert digital.driving()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro", "accelerometer"])
def test_a_chip_that_does_not_answer(digital: DigitalBench, name: str) -> None:
    capture = digital.armed()
    chip = digital.gyro if name == "gyro" else digital.accel
    chip.answers = False
    digital.run(capture, 2 * PERIOD_US * 1e-6 + 0.003)
    assert not digital.driving()
    assert digital.reported() == [f"{name}: does not answer"]
    assert digital.faults() & SENSOR
    assert digital.run(capture, 0.1) == 0, "no sample is made up"
    with pytest.raises(LinkError, match=f"{name}: does not answer"):
        digital.session.arm()
    chip.answers = True
    digital.recovers(capture)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro", "accelerometer"])
def test_another_chip_at_its_place(digital: DigitalBench, name: str) -> None:
    chip = digital.gyro if name == "gyro" else digital.accel
    right, chip.identity = chip.identity, 0x33
    capture = digital.begin(gyro_filter=1)  # other settings: both are started anew
    assert digital.run(capture, 0.2) == 0
    assert digital.reported() == [f"{name}: another chip answers, or it did not take its settings"]
    with pytest.raises(LinkError, match="another chip"):
        digital.session.arm()
    chip.identity = right
    digital.recovers(capture)


@pytest.mark.slow
def test_an_accelerometer_that_does_not_take(digital: DigitalBench) -> None:
    """It reads well, but its settings are those of power-up: counts of another range would be worse than none."""
    honest, digital.accel.written = digital.accel.written, lambda _register, _value: None  # type: ignore[method-assign, assignment]
    digital.accel.brown_out()
    capture = digital.begin(gyro_filter=1)
    assert digital.run(capture, 0.2) == 0
    assert digital.reported() == ["accelerometer: another chip answers, or it did not take its settings"]
    digital.accel.written = honest  # type: ignore[method-assign]
    digital.recovers(capture)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro", "accelerometer"])
def test_a_chip_whose_data_hang(digital: DigitalBench, name: str) -> None:
    """At 200 Hz 16 equal samples of the ADXL345 are beyond noise, 6 of the ITG-3205: 80 and 30 ms."""
    capture = digital.armed()
    chip, limit_s = (digital.gyro, 0.030) if name == "gyro" else (digital.accel, 0.080)
    chip.frozen = True
    digital.run(capture, limit_s - 3 * PERIOD_US * 1e-6)  # one sample may have equalled the last before it hung
    assert digital.driving(), f"not before {limit_s} s"
    digital.run(capture, 6 * PERIOD_US * 1e-6)
    assert not digital.driving()
    assert digital.reported()[0] in (f"{name}: its data do not change", f"{name}: has no data")
    digital.run(capture, 0.3)
    assert len(digital.reported()) == 1, "set up anew or not: a chip that hangs stays a fault"
    chip.frozen = False
    digital.run(capture, RECOVERY_S)
    digital.recovers(capture)


@pytest.mark.slow
def test_a_chip_that_says_the_same_for_ever_stays_a_fault(digital: DigitalBench) -> None:
    """Its data are new each time, and the same: setting it up anew does not clear that, only a change does."""
    capture = digital.armed()
    honest, digital.accel.source = digital.accel.source, lambda _time_s: (0.1, 0.2, 0.9)
    digital.run(capture, 0.1)
    assert not digital.driving()
    for _ in range(10):
        assert digital.reported() == ["accelerometer: its data do not change"]
    digital.accel.source = honest
    digital.recovers(capture)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro", "accelerometer"])
def test_a_chip_that_had_no_data_is_up_again_as_soon_as_it_has(digital: DigitalBench, name: str) -> None:
    """However often it was started in vain."""
    capture = digital.armed()
    chip = digital.gyro if name == "gyro" else digital.accel
    for silent_s in (0.5, 0.3, 0.8):
        chip.frozen = True
        digital.run(capture, 0.1 + silent_s)
        assert not digital.driving()
        chip.frozen = False
        digital.recovers(capture)


def test_the_slowest_rate_of_the_accelerometer_is_a_rate_too(digital: DigitalBench) -> None:
    """6.25 Hz: its first sample comes 160 ms after its start."""
    capture = digital.begin(accel_rate=6)
    digital.accel.brown_out()  # or a sample from before would do for its first
    digital.run(capture, 0.5)
    assert digital.reported() == []
    assert digital.run(capture, 0.1) >= 0.1e6 / PERIOD_US - 2


@pytest.mark.parametrize("digital", ["spi"], indirect=True)
def test_an_exchange_that_is_cut_short_leaves_nothing_for_the_next(digital: DigitalBench) -> None:
    """The sensors are chosen anew in the middle of one: a byte in the receiver would put all others one place late."""
    machine, capture = digital.machine, digital.begin()
    for rate in (12, 11, 12, 11):
        digital.run(capture, 0.05)
        assert machine.run_until(lambda: machine.spi1.shifting is not None, 2 * PERIOD_US)
        machine.advance_us(4)
        machine.spi1.rx_dma.ccr &= ~1  # what an abort does first; the byte under way comes all the same
        machine.advance_us(4)
        assert machine.spi1.sr & 1, "a byte that nobody fetched"
        capture = digital.begin(accel_rate=rate)
        digital.run(capture, RECOVERY_S)
        assert digital.reported() == []
        assert digital.run(capture, 0.1) >= 0.1e6 / PERIOD_US - 2


@pytest.mark.slow
def test_a_chip_that_lost_its_settings_gets_them_again(digital: DigitalBench) -> None:
    """A dip of the supply: the accelerometer is back at +-2 g and in standby, its data stand still."""
    capture = digital.armed()
    digital.accel.brown_out()
    digital.run(capture, 0.1)
    assert not digital.driving()
    digital.recovers(capture)
    assert digital.accel.registers[0x31] == 0x0B


@pytest.mark.slow
def test_one_access_that_fails_is_tried_again_and_costs_no_step(digital: DigitalBench) -> None:
    capture = digital.armed()
    failures = digital.bus_failures()
    honest = digital.gyro.begin
    refusals = [False, False]

    def begin(reading: bool, now: int) -> bool:
        return honest(reading, now) and (not refusals or refusals.pop())

    digital.gyro.begin = begin  # type: ignore[assignment]
    assert digital.run(capture, 0.2) >= 0.2e6 / PERIOD_US - 1
    assert digital.driving()
    assert digital.bus_failures() - failures == 2
    assert digital.reported() == []


# The I2C bus


@pytest.fixture
def i2c() -> DigitalBench:
    return bench_as_made("i2c", lambda: digital_bench("i2c"))


@pytest.mark.slow
@pytest.mark.parametrize("clocks", [1, 5, 9])
def test_a_slave_that_holds_the_data_line_is_clocked_free(i2c: DigitalBench, clocks: int) -> None:
    capture = i2c.armed()
    bus = i2c.machine.i2c_bus
    bus.stick(clocks)
    assert i2c.machine.run_until(lambda: bus.held == 0, 30_000), "by the first nine clocks"
    i2c.run(capture, 0.015)
    assert not i2c.driving()
    i2c.recovers(capture)


@pytest.mark.slow
@pytest.mark.parametrize("clocks", [1, 9])
def test_a_data_line_that_is_held_at_power_up(clocks: int) -> None:
    """The processor was reset in the middle of a byte: the slave was not."""
    machine = image()
    gyro, accel = fit(machine)
    machine.i2c_bus.stick(clocks)
    boot_digital(machine)
    with Session.open(machine.uart) as session:
        bench = DigitalBench(machine, session, gyro=gyro, accel=accel, control=DIGITAL_CONTROL)
        bench.recovers(bench.begin())


@pytest.mark.slow
def test_analog_filters_that_lock_at_power_up(i2c: DigitalBench) -> None:
    """The erratum that makes the bus look busy for ever: only edges on the pins and a reset of I2C1 help."""
    capture = i2c.armed()
    i2c.machine.i2c1.filters_locked = {"scl": True, "sda": True}
    i2c.run(capture, 0.015)
    assert not i2c.driving()
    i2c.recovers(capture)


@pytest.mark.slow
def test_a_shorted_data_line_is_a_fault_for_as_long_as_it_lasts(i2c: DigitalBench) -> None:
    capture = i2c.armed()
    i2c.machine.i2c_bus.short(True)
    i2c.run(capture, 0.015)
    assert not i2c.driving()
    said = i2c.reported()
    assert said == ["gyro: its bus hangs"]
    i2c.run(capture, 0.5)
    assert set(i2c.reported()) & {"gyro: its bus hangs", "gyro: does not answer"}
    i2c.machine.i2c_bus.short(False)
    i2c.recovers(capture)


def test_a_misplaced_stop_costs_no_step(i2c: DigitalBench) -> None:
    """No START can be sent after it until I2C1 is reset (errata): the access is begun again in the same period."""
    capture = i2c.armed()
    for wait_us in (31.0, 57.0, 101.0, 203.0):
        assert i2c.machine.run_until(lambda: i2c.machine.i2c1.phase == "sending", 2 * PERIOD_US)
        i2c.machine.advance_us(wait_us)
        i2c.machine.i2c1.bus_error()
        i2c.run(capture, 0.03)
    assert i2c.driving()
    assert i2c.reported() == []
    assert capture.disarmed_step is None
    assert i2c.bus_failures() >= 4
    assert i2c.faults() & STEPS_MISSED == 0


@pytest.mark.slow
def test_without_a_crystal_the_bus_runs_from_the_other_clock() -> None:
    """64 MHz: FREQ, CCR and TRISE are others, or the model stops; both chips are read all the same."""
    machine = image(crystal=False)
    gyro, accel = fit(machine)
    machine.advance_us(170_000)
    boot_digital(machine)
    with Session.open(machine.uart) as session:
        bench = DigitalBench(machine, session, gyro=gyro, accel=accel, control=DIGITAL_CONTROL)
        bench.recovers(bench.begin())
        assert 380.0 < 1e3 * 40320 / machine.i2c1.clock_ticks <= 400.0
