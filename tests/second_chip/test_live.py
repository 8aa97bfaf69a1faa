"""Sensors, arming and safe outputs of the flash image on the second chip model, in real time."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from plumb import systems
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.run_fixed import run_control
from plumb.link.identity import NackError, sensors_text
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.physics.motor import FORWARD
from plumb.spec import crsf, ppm
from second_chip import Chip
from second_chip.adc import VDDA
from second_chip.i2c import Adxl345, Itg3205, Mpu6050, RegisterSlave
from support.vehicles_image import vehicles_image

from .conftest import START_S, Connect

LIVE_STEPS = 12
INPUTS = 12
"""Of quadrotor: six counts, six commands."""
SAFE_S = 0.050
LAST_FRAME_S = 27 * 10 / 921_600
"""The host's last frame, 27 characters, may be on the line when the host falls silent."""
NEUTRAL_US = 1000.0
READY_S = 0.7
"""At rest from its first step on, a run may be armed by then."""
LEVEL = (1676, 2048, 3041)
"""Counts of the quad's three inputs at rest and level."""


def begin(session: Session, system: str, **link: int) -> tuple[Capture, ControlParams]:
    module = systems.load(system)
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    period_us = round(params.period_s * 1e6)
    link = {"arm_hold_ms": 0, "esc_period_us": 2500, "adc_oversample_log2": 0} | link
    session.upload(params.words(), period_us=period_us, **link)
    session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
    capture = Capture(session)
    session.listener = capture.feed
    return capture, params


def assert_digests_are_those_of(params: ControlParams, capture: Capture) -> None:
    raw = capture.raw_counts(LIVE_STEPS)
    assert capture.unverified_from(LIVE_STEPS) is None
    expected = run_control(params, raw, np.zeros(LIVE_STEPS, np.int32)).digests()
    assert np.array_equal(capture.digests(LIVE_STEPS), expected)


@pytest.mark.parametrize(("system", "channels"), [("quad", (0, 1, 2)), ("turntable", (0, 1, 2, 3, 8, 9))])
def test_the_counts_of_a_live_run_are_the_volts_on_the_pins(
    chip: Chip, session: Session, system: str, channels: tuple[int, ...]
) -> None:
    put: dict[int, list[int]] = {channel: [] for channel in channels}

    def another(channel: int) -> Callable[[], float]:
        def volts() -> float:
            put[channel].append(random.Random(f"{channel} {len(put[channel])}").randrange(1200, 2800))
            return (put[channel][-1] + 0.3) / 4096 * VDDA

        return volts

    for channel in channels:
        chip.adc.volts[channel] = another(channel)
    capture, params = begin(session, system)
    capture.collect(LIVE_STEPS)
    scans_per_step = round(params.period_s * 1000)
    sampled = [put[channel][scans_per_step - 1 :: scans_per_step][:LIVE_STEPS] for channel in channels]
    assert np.array_equal(capture.raw_counts(LIVE_STEPS)[:, : len(channels)], np.transpose(sampled))
    assert_digests_are_those_of(params, capture)


class Moving:
    """Gives another sample at every read of the first data register, and remembers it."""

    def __init__(self, sensor: Adxl345 | Itg3205, first_register: int) -> None:
        self.read_counts: list[tuple[int, int, int]] = []
        plain = sensor.read
        number = itertools.count(1)

        def read(register: int) -> int:
            if register == first_register:
                step = next(number)
                sensor.counts = (step, -2 * step, 256 - step)
                self.read_counts.append(sensor.counts)
            return plain(register)

        sensor.read = read  # type: ignore[method-assign]


def test_digital_sensors_are_set_up_and_read_over_i2c(chip: Chip, session: Session) -> None:
    gyro, accel = Itg3205(), Adxl345()
    chip.i2c.slaves = {gyro.ADDRESS: gyro, accel.ADDRESS: accel}
    rates, tilts = Moving(gyro, 0x1D), Moving(accel, 0x32)
    capture, params = begin(session, "balancer")
    capture.collect(LIVE_STEPS)
    raw = capture.raw_counts(LIVE_STEPS)
    assert raw[:, 0].tolist() == [y for _, y, _ in rates.read_counts[:LIVE_STEPS]]
    assert raw[:, 1:3].tolist() == [[x, z] for x, _, z in tilts.read_counts[:LIVE_STEPS]]
    assert_digests_are_those_of(params, capture)
    assert [register for register, _ in gyro.log] == [0x3E, 0x15, 0x16, 0x17], "awake, rate, range, ready flag"
    assert gyro.registers[0x16] & 0x18 == 0x18, "+-2000 deg/s"
    assert [register for register, _ in accel.log] == [0x2D, 0x2C, 0x31, 0x38, 0x2D], "asleep while it is set up"
    assert accel.registers[0x31] == 0x0B, "full resolution, +-16 g"


def test_one_chip_with_both_sensors_is_set_up_and_read_over_i2c(chip: Chip, session: Session) -> None:
    both = Mpu6050()
    chip.i2c.slaves = {both.ADDRESS: both}
    taken: list[tuple[int, int, int]] = []
    plain, number = both.read, itertools.count(1)

    def read(register: int) -> int:
        if register == 0x3B:
            step = next(number)
            both.counts = (step, -2 * step, 2048 - step, 3 * step, -4 * step, 5 * step)
            taken.append((-4 * step, step, 2048 - step))
        return plain(register)

    both.read = read  # type: ignore[method-assign]
    capture, params = begin(session, "balancer", accel_bus=2)
    capture.collect(LIVE_STEPS)
    raw = capture.raw_counts(LIVE_STEPS)
    assert raw[:, :3].tolist() == [list(counts) for counts in taken[:LIVE_STEPS]]
    assert_digests_are_those_of(params, capture)
    assert [register for register, _ in both.log] == [0x6B, 0x6C, 0x19, 0x1A, 0x1B, 0x1C, 0x38]
    assert both.registers[0x1B] == both.registers[0x1C] == 0x18, "+-2000 deg/s, +-16 g"


def piloted(chip: Chip, connect_uart: Connect, receiver: int) -> tuple[Session, ControlParams, Capture]:
    """A live run of `quadrotor` with a sensor of six axes. receiver: number of its protocol, a parameter."""
    both = Mpu6050()
    chip.ports["B"].outside |= {4: 0}
    chip.i2c.slaves = {both.ADDRESS: both}
    chip.run(START_S)
    session = connect_uart(chip)
    module = systems.load("quadrotor")
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    session.upload(params.words(), period_us=2500, accel_bus=2, receiver=receiver)
    session.begin("REALTIME_LIVE", frames=RAW_FRAMES[:4])
    capture = Capture(session, raw_frames=set(RAW_FRAMES[:4]))
    session.listener = capture.feed
    return session, params, capture


def test_the_bytes_of_a_receiver_are_the_sticks_of_a_step(flying_image: bytes, connect_uart: Connect) -> None:
    chip = Chip(flying_image)
    session, params, capture = piloted(chip, connect_uart, receiver=1)
    for frame in (crsf.sticks(on=True), crsf.sticks(on=True), crsf.sticks(roll=1.0, throttle=0.5, on=True)):
        chip.usart3.put(b"\x00\xc8" + frame)
        listen(session, 0.01)
    listen(session, 0.02)
    steps = len(capture.raw)
    inputs = np.array([capture.raw[step] for step in range(steps)], np.int16)[:, :INPUTS]
    throttles = capture.setpoints.of_steps(steps)
    assert inputs[-1, 6:].tolist() == [32767, 0, 0, 1, 3, 0] and throttles[-1] == 16393
    expected = run_control(params, inputs, throttles).digests()
    assert expected.tolist() == [capture.digest[step] for step in range(steps)]


def test_the_edges_at_pa8_are_the_sticks_of_a_step(flying_image: bytes, connect_uart: Connect) -> None:
    chip = Chip(flying_image)
    session, _, capture = piloted(chip, connect_uart, receiver=3)
    for widths in ([1500, 1500, 988, 1500], [2012, 988, 1500, 988], [2012, 988, 1500, 988, 2012, 700]):
        for edge in ppm.edges_us(widths + [1500] * (8 - len(widths))):
            for later, level in ((0, 1), (300, 0), (400, 1), (403, 0)):  # the last two: shorter than the filter
                chip.after_us(edge + later, partial(chip.ports["A"].drive, 8, level))
        listen(session, 0.03)
    inputs = [capture.raw[step][6:] for step in sorted(capture.raw)]
    assert [row[4] for row in inputs if row[4]][-1] == 2, "the third is no frame"
    rest, moved = ([row for row in inputs if row[4] == number][-1] for number in (1, 2))
    assert all(abs(one) <= 100 for one in rest[:3])
    assert all(abs(one - other) <= 100 for one, other in zip(moved[:3], (32767, -32767, 32767), strict=True)), moved


def test_the_volts_at_pb0_and_pb1_are_those_of_the_battery(connect_uart: Connect) -> None:
    """During a run whose samples ADC1 converts, on the image `vehicles`, which has both."""
    chip = Chip(vehicles_image().read_bytes())
    chip.ports["B"].outside |= {4: 0}
    chip.adc.volts |= {8: 2.0, 9: 0.55}
    chip.run(START_S)
    session = connect_uart(chip)
    capture, params = begin(session, "quad", battery_min_mv=10_500, battery_full_mv=18_810, battery_full_a=90)
    capture.collect(LIVE_STEPS)
    listen(session, 0.5)
    said = session.telemetry["BATTERY"]
    assert abs(said["voltage_mv"] - 18_810 * 2.0 / VDDA) < 10 and abs(said["current_10ma"] - 9000 * 0.55 / VDDA) < 3
    assert_digests_are_those_of(params, capture)


@pytest.mark.parametrize(("accel_bus", "said"), [(0, "another chip answers"), (1, "does not answer")])
def test_a_foreign_chip_on_i2c_and_an_empty_spi_bus_are_reported(
    chip: Chip, connect_uart: Connect, accel_bus: int, said: str
) -> None:
    chip.i2c.slaves = {Itg3205.ADDRESS: Itg3205(), Adxl345.ADDRESS: RegisterSlave({0x00: 0x00})}
    session = connect_uart(chip)
    begin(session, "balancer", accel_bus=accel_bus)
    listen(session, 0.15)
    (found,) = sensors_text(session.telemetry["SENSORS"])
    assert found.startswith(f"accelerometer: {said}")


# ---- arming ----


def rest(chip: Chip) -> None:
    """A quad that stands still: each conversion within a count or two of level."""
    noise = random.Random(7)

    def about(count: int) -> float:
        return (count + noise.gauss(0.5, 1.0)) / 4096 * VDDA

    for channel, count in enumerate(LEVEL):
        chip.adc.volts[channel] = partial(about, count)


def pulses(chip: Chip) -> tuple[float | None, ...]:
    """High time of the two speed controllers on PB6 and PB7, None where the pin is not the timer's."""
    port = chip.ports["B"]
    return tuple(chip.tim4.pulse_us(n) if port.alternate(5 + n) else None for n in (1, 2))


def neutral(chip: Chip) -> bool:
    return pulses(chip) == (NEUTRAL_US, NEUTRAL_US)


def listen(session: Session, seconds: float) -> None:
    end_s = session.clock() + seconds
    while session.clock() < end_s:
        session.receive(0.002)


def test_a_fresh_nonce_arms_and_silence_makes_the_outputs_safe_for_good(chip: Chip, session: Session) -> None:
    rest(chip)
    begin(session, "quad")
    listen(session, READY_S)
    arm = session.protocol["EXECUTE"].value("verb", "ARM")
    nonce = session.request("CHALLENGE", arm, 0, answer="NONCE", first=arm)["nonce"]
    for not_good in (nonce ^ 1, nonce):  # a wrong answer voids the challenge
        with pytest.raises(NackError) as refused:
            session.request("EXECUTE", arm, not_good)
        assert refused.value.reason == "NONCE"
    listen(session, 0.02)
    assert neutral(chip)
    session.arm()
    listen(session, 0.1)
    assert not neutral(chip) and session.telemetry["STATUS"]["armed"]

    since_s = chip.seconds()
    assert chip.run_until(lambda: neutral(chip), 2 * SAFE_S)
    assert chip.seconds() - since_s < SAFE_S + LAST_FRAME_S
    for _ in range(10):
        listen(session, 0.01)
        assert neutral(chip), "the keep-alive that comes back arms nothing"
    assert not session.telemetry["STATUS"]["armed"]
    session.arm()
    listen(session, 0.05)
    assert not neutral(chip)


# ---- bridge ----

HALL_PINS = (("A", 15), ("B", 3), ("B", 10))


def turn(chip: Chip, hall: int) -> None:
    for place, (port, pin) in enumerate(HALL_PINS):
        if chip.ports[port].outside.get(pin) != hall >> place & 1:
            chip.ports[port].drive(pin, hall >> place & 1)


def upright(chip: Chip) -> None:
    """A balancer that leans a little, with the noise of its two sensors."""
    noise = random.Random(3)
    gyro, accel = Itg3205(), Adxl345()
    plain = gyro.read, accel.read

    def read_gyro(register: int) -> int:
        if register == 0x1D:
            gyro.counts = (0, round(noise.gauss(0, 7)), 0)
        return plain[0](register)

    def read_accel(register: int) -> int:
        if register == 0x32:
            accel.counts = (round(noise.gauss(26, 2)), 0, round(noise.gauss(253, 2)))
        return plain[1](register)

    gyro.read, accel.read = read_gyro, read_accel  # type: ignore[method-assign]
    chip.i2c.slaves = {gyro.ADDRESS: gyro, accel.ADDRESS: accel}


def test_a_balancer_commutates_until_break_or_silence(chip: Chip, connect_uart: Connect) -> None:
    balancer = systems.load("balancer")
    words = quantise(balancer.TUNINGS[balancer.DEFAULT_TUNING]).words()
    session = connect_uart(chip)
    session.upload(words, period_us=balancer.PERIOD_US, pins=1, arm_hold_ms=0)
    session.execute("SAVE")

    wired = Chip(bytes(chip.flash))
    wired.ports["B"].outside |= {5: 0, 12: 1}  # strap to ground, break not pulled
    turn(wired, FORWARD[0])
    upright(wired)
    wired.run(START_S)
    session = connect_uart(wired)  # now on PB6 and PB7
    session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
    capture = Capture(session)
    session.listener = capture.feed
    listen(session, READY_S)
    assert wired.tim1.driven() == {}

    session.arm()
    listen(session, 0.02)
    floating = []
    for hall in FORWARD:  # in less than a tenth of a period: by interrupts of the edges, not by new duties
        turn(wired, hall)
        wired.run(0.00015)
        shares = wired.tim1.driven()
        floating += [phase for phase, share in shares.items() if share is None]
        assert max(share for share in shares.values() if share is not None) > 0
        assert sorted(share for share in shares.values() if share is not None)[0] == 0
    assert sorted(floating) == [0, 0, 1, 1, 2, 2], "each phase rests in two of six positions"
    listen(session, 0.03)
    assert capture.raw[capture.steps - 2][3] == len(FORWARD) - 1, "edges that the record counts"

    wired.ports["B"].drive(12, 0)
    assert wired.tim1.driven() == {}, "without an instruction"
    wired.ports["B"].drive(12, 1)
    listen(session, 0.1)
    assert wired.tim1.driven() == {}, "and it stays so"
    session.begin("REALTIME_LIVE")
    listen(session, READY_S)
    session.arm()
    listen(session, 0.02)
    assert wired.tim1.driven() != {}
    assert wired.run_until(lambda: wired.tim1.driven() == {}, SAFE_S)
