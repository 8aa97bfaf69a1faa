"""I2C1, SPI1 and the two sensor chips as register models: what the manuals say, asked by a polling program."""

from __future__ import annotations

from itertools import pairwise

import pytest

from plumb.f103.attached.invensense import Invensense
from plumb.systems.fitted_chips import part_of
from support.f103_program import NewBoard

I2C, SPI = 1, 2
GYRO, ACCEL = 0x68, 0x53
SELECT_PIN = 4
BYTE_US = 9 * 2.5


class Master:
    """A part that runs i2c.c, with both chips on I2C and another accelerometer on SPI."""

    def __init__(self, board: NewBoard) -> None:
        from plumb.f103.attached.adxl345 import Adxl345
        from plumb.f103.attached.itg3205 import Itg3205

        self.board = board("i2c")
        self.machine = self.board.machine
        self.felt_g, self.felt_dps = (0.1, -0.5, 1.0), (10.0, -20.0, 300.0)
        self.accel = Adxl345(self.machine, lambda _t: self.felt_g)
        self.gyro = Itg3205(self.machine, lambda _t: self.felt_dps)
        self.machine.i2c_bus.slaves += [self.accel, self.gyro]
        self.on_spi = Adxl345(self.machine, lambda _t: self.felt_g)
        self.machine.spi1.devices[SELECT_PIN] = self.on_spi
        self.machine.advance_us(5000)

    def ask(self, bus: int, slave: int, register: int, count: int, value: int = 0) -> bytes | None:
        """The bytes read, or None where it was refused or nothing came."""
        for index, word in enumerate((slave, register, count, value, 0)):
            self.board.ask(1 + index, word)
        self.board.ask(0, bus)
        assert self.machine.run_until(lambda: self.board.result(0) == 0, 50_000)
        return None if self.board.result(5) else bytes(self.board.result(8 + i) for i in range(count))

    def read(self, slave: int, register: int, count: int = 1) -> bytes:
        found = self.ask(I2C, slave, register, count)
        assert found is not None, "refused"
        return found

    def write(self, slave: int, register: int, value: int) -> None:
        assert self.ask(I2C, slave, register, 0, value) is not None


@pytest.fixture
def master(board: NewBoard) -> Master:
    return Master(board)


def test_one_byte_two_bytes_and_many(master: Master) -> None:
    assert master.read(ACCEL, 0x00) == b"\xe5"
    assert master.read(ACCEL, 0x2C, 2) == b"\x0a\x00"
    assert master.read(GYRO, 0x15, 6) == bytes(6)
    assert master.read(GYRO, 0x00)[0] & 0x7E == 0x68
    assert master.machine.warnings == []


def test_a_write_arrives_and_is_read_back(master: Master) -> None:
    master.write(ACCEL, 0x31, 0x0B)
    assert master.read(ACCEL, 0x31) == b"\x0b"
    master.write(ACCEL, 0x00, 0x12)
    assert master.read(ACCEL, 0x00) == b"\xe5"
    assert master.machine.warnings == ["ADXL345: register 0x00 is written, which is read-only or reserved"]


def test_nobody_at_the_address_is_a_nack(master: Master) -> None:
    assert master.ask(I2C, 0x10, 0x00, 1) is None
    assert master.board.result(5) & 1 << 10
    assert master.read(ACCEL, 0x00) == b"\xe5", "the bus is free again"


def test_bytes_take_nine_clocks_of_ccr(master: Master) -> None:
    times = []
    honest = master.accel.read

    def noting(now: int) -> int:
        times.append(now / 40320)
        return honest(now)

    master.accel.read = noting  # type: ignore[method-assign, assignment]
    begun = master.machine.now_us
    assert master.read(ACCEL, 0x2C, 4) is not None
    # The handler of a byte takes up to 2 us before it lets the next one begin.
    assert [later - sooner for sooner, later in pairwise(times)] == pytest.approx([BYTE_US] * 3, abs=2.0)
    # START, address, register, START, address, four bytes, STOP
    assert 7 * BYTE_US + 3 * 2.5 < master.machine.now_us - begun < 7 * BYTE_US + 7.5 + 120


def test_a_held_line_keeps_a_start_waiting_until_it_is_free(master: Master) -> None:
    master.machine.i2c_bus.stick(9)
    for index, word in enumerate((ACCEL, 0, 1, 0, 0)):
        master.board.ask(1 + index, word)
    master.board.ask(0, I2C)
    master.machine.advance_us(300)
    assert master.machine.i2c1.phase == "waiting"
    master.machine.i2c_bus.held = 0
    master.machine.i2c_bus.pins_changed()
    assert master.machine.run_until(lambda: master.board.result(0) == 0, 50_000)
    assert master.board.result(8) == 0xE5


@pytest.mark.parametrize(
    ("register", "value", "why"), [("cr2", 8, "PCLK1 is 36 MHz"), ("ccr", 1 << 15 | 29, "400 is the limit")]
)
def test_the_bus_is_strict_about_its_clock(master: Master, register: str, value: int, why: str) -> None:
    from plumb.f103 import SimulationError

    setattr(master.machine.i2c1, register, value)
    with pytest.raises(SimulationError, match=why):
        master.read(ACCEL, 0)


def test_spi_reads_what_i2c_does(master: Master) -> None:
    assert master.ask(SPI, 0, 0x00, 1) == b"\xe5"
    master.ask(SPI, 0, 0x31, 0, 0x0B)
    assert master.ask(SPI, 0, 0x31, 1) == b"\x0b"
    master.ask(SPI, 0, 0x2D, 0, 0x08)
    master.machine.advance_us(12_000)
    raw = master.ask(SPI, 0, 0x32, 6)
    assert raw is not None
    assert [int.from_bytes(raw[i : i + 2], "little", signed=True) for i in (0, 2, 4)] == [26, -128, 256]
    master.on_spi.answers = False
    assert master.ask(SPI, 0, 0x00, 1) == b"\xff"


def test_spi_in_another_mode_says_nothing_of_use(master: Master) -> None:
    master.machine.spi1.cr1 &= ~3
    assert master.ask(SPI, 0, 0x00, 1) == b"\xff"
    assert master.machine.warnings == ["SPI1 has CPOL, CPHA = 0, 0; the chips need 1, 1"]


@pytest.mark.parametrize(
    ("form", "rate", "felt_g", "counts"),
    [
        (0x0B, 0x0A, 1.0, 256),  # full resolution: 256 counts per g in every range
        (0x08, 0x0A, 1.0, 256),
        (0x00, 0x0A, 1.0, 256),  # ten bits: 2 g is 512
        (0x03, 0x0A, 1.0, 32),
        (0x0B, 0x0A, 20.0, 4095),
        (0x0B, 0x0A, -20.0, -4096),
        (0x00, 0x0A, 3.0, 511),
        (0x0B, 0x0E, 1.0039, 256),  # above 800 Hz the last bit is always 0
    ],
)
def test_accelerometer_counts(master: Master, form: int, rate: int, felt_g: float, counts: int) -> None:
    master.felt_g = (felt_g, 0.0, -felt_g)
    for register, value in ((0x31, form), (0x2C, rate), (0x2D, 0x08)):
        master.write(ACCEL, register, value)
    master.machine.advance_us(12_000)
    raw = master.read(ACCEL, 0x32, 6)
    assert int.from_bytes(raw[:2], "little", signed=True) == counts


def test_the_accelerometer_samples_while_it_measures(master: Master) -> None:
    master.machine.advance_us(50_000)
    assert master.read(ACCEL, 0x30) == b"\x02", "standby after power-up: nothing is ready"
    master.write(ACCEL, 0x2D, 0x08)
    master.machine.advance_us(11_000)
    assert master.read(ACCEL, 0x30)[0] & 0x80
    master.read(ACCEL, 0x32, 6)
    assert not master.read(ACCEL, 0x30)[0] & 0x80, "reading the data says they are old"
    taken: list[float] = []
    master.accel.source = lambda t_s: taken.append(t_s) or (0.0, 0.0, 1.0)  # type: ignore[func-returns-value]
    master.machine.advance_us(100_000)
    assert len(taken) == 10
    assert [later - sooner for sooner, later in pairwise(taken)] == pytest.approx([0.01] * 9)
    master.write(ACCEL, 0x2C, 0x0D)
    taken.clear()
    master.machine.advance_us(100_000)
    assert len(taken) in (79, 80)


def test_gyro_counts_and_rate(master: Master) -> None:
    master.write(GYRO, 0x16, 0x1A)
    taken: list[float] = []
    honest = master.gyro.source
    master.gyro.source = lambda t_s: taken.append(t_s) or honest(t_s)  # type: ignore[func-returns-value]
    master.machine.advance_us(50_000)
    raw = master.read(GYRO, 0x1D, 6)
    counts = [int.from_bytes(raw[i : i + 2], "big", signed=True) for i in (0, 2, 4)]
    assert counts == [round(14.375 * dps) for dps in master.felt_dps]
    assert [later - sooner for sooner, later in pairwise(taken)] == pytest.approx([1e-3] * (len(taken) - 1))
    master.felt_dps = (2500.0, -2500.0, 2000.0)
    master.machine.advance_us(2000)
    raw = master.read(GYRO, 0x1D, 6)
    assert raw[:4] == b"\x7f\xff\x80\x00" and int.from_bytes(raw[4:], "big") == 28750
    master.write(GYRO, 0x15, 9)
    taken.clear()
    master.machine.advance_us(100_000)
    assert len(taken) in (9, 10)


def test_the_gyro_says_when_data_are_new_if_it_is_asked_to(master: Master) -> None:
    master.write(GYRO, 0x16, 0x1A)
    master.machine.advance_us(5000)
    assert master.read(GYRO, 0x1A) == b"\x00"
    master.write(GYRO, 0x17, 0x01)
    master.machine.advance_us(2000)
    assert master.read(GYRO, 0x1A) == b"\x01"
    assert master.read(GYRO, 0x1A) == b"\x00", "reading clears it"
    master.write(GYRO, 0x3E, 0x40)
    master.machine.advance_us(5000)
    assert master.read(GYRO, 0x1A) == b"\x00", "asleep"


def test_a_power_cut_takes_the_settings_of_the_chips(master: Master) -> None:
    master.write(ACCEL, 0x31, 0x0B)
    master.machine.power_cut()
    master.machine.power_on()
    master.machine.advance_us(5000)
    assert master.read(ACCEL, 0x31) == b"\x00"


@pytest.fixture
def both(master: Master) -> Invensense:
    """An MPU-6050 in the place of the gyro, awake."""
    chip = Invensense(master.machine, lambda _t: master.felt_dps, lambda _t: master.felt_g, part_of("mpu6050"))
    master.machine.i2c_bus.slaves[:] = [chip]
    assert master.read(GYRO, 0x6B) == b"\x40", "asleep after power-up"
    master.write(GYRO, 0x6B, 0x01)
    return chip


def burst(master: Master) -> list[int]:
    raw = master.read(GYRO, 0x3B, 14)
    return [int.from_bytes(raw[i : i + 2], "big", signed=True) for i in range(0, 14, 2)]


@pytest.mark.parametrize(
    ("setting", "per_dps", "per_g"),
    [(0x00, 131.0, 16384), (0x08, 65.5, 8192), (0x10, 32.8, 4096), (0x18, 16.4, 2048)],
)
def test_one_chip_with_both_sensors_counts_as_its_ranges_say(
    master: Master, both: Invensense, setting: int, per_dps: float, per_g: float
) -> None:
    master.felt_dps = (10.0, -20.0, 100.0)
    for register in (0x1B, 0x1C):
        master.write(GYRO, register, setting)
    master.machine.advance_us(2000)
    assert burst(master) == [round(g * per_g) for g in master.felt_g] + [0] + [
        round(dps * per_dps) for dps in master.felt_dps
    ]
    assert master.read(GYRO, 0x75) == b"\x68" and master.machine.warnings == []
    master.felt_dps, master.felt_g = (2500.0, -2500.0, 0.0), (17.0, -17.0, 0.0)
    master.machine.advance_us(2000)
    assert burst(master) == [32767, -32768, 0, 0, 32767, -32768, 0]


def test_one_chip_samples_by_its_divider_and_says_when_data_are_new(master: Master, both: Invensense) -> None:
    master.write(GYRO, 0x1A, 0x02)
    taken: list[float] = []
    both.source = lambda t_s: taken.append(t_s) or (0.0, 0.0, 0.0)  # type: ignore[func-returns-value]
    master.machine.advance_us(50_000)
    assert [later - sooner for sooner, later in pairwise(taken)] == pytest.approx([1e-3] * (len(taken) - 1))
    assert master.read(GYRO, 0x3A) == b"\x00", "not asked for"
    master.write(GYRO, 0x38, 0x01)
    master.machine.advance_us(2000)
    assert master.read(GYRO, 0x3A) == b"\x01"
    assert master.read(GYRO, 0x3A) == b"\x00", "reading clears it"
    master.write(GYRO, 0x19, 9)
    taken.clear()
    master.machine.advance_us(100_000)
    assert len(taken) in (9, 10)
    master.write(GYRO, 0x75, 0)
    assert master.machine.warnings == ["MPU-6050: register 0x75 is written, which is read-only or not modelled"]
