"""The pin set of two wheels on the second chip model: encoders, motors, rider and battery of the image `wheels`."""

from __future__ import annotations

import random
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from plumb import systems
from plumb.boards.strap import set_strap
from plumb.contract.parameters import quantise
from plumb.contract.run_fixed import run_control
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.systems.wheels.pins import MOTORS
from second_chip import Chip, UartEnd
from second_chip.adc import VDDA
from second_chip.i2c import Mpu6050
from support.chip_pair import Pair, assert_both_left_the_same

from .conftest import START_S, Connect

INPUTS = 12
"""Of a step: its channels, then its commands."""
PWM_COUNTS = 1800
"""Half a period of 20 kHz at 72 MHz."""
CHANNELS = {13: 1, 14: 2, 15: 3}
"""TIM1's complementary outputs on port B (RM0008 9.3.7)."""
EDGE_US, READY_S = 700, 0.7
LEFT, RIGHT, RIDER = 4, 5, 6
"""Places of a step's raw counts."""


def place(pin: str) -> tuple[str, int]:
    return pin[1], int(pin[2:])


class Wheel:
    """An encoder; forward, A leads B."""

    def __init__(self, chip: Chip, *pins: str) -> None:
        self.chip, self.pins, self.position = chip, [place(pin) for pin in pins], 0
        self._show()

    def _show(self) -> None:
        phase = self.position % 4
        for (port, pin), level in zip(self.pins, (phase in (1, 2), phase in (2, 3)), strict=True):
            if self.chip.ports[port].outside.get(pin) != level:
                self.chip.ports[port].drive(pin, int(level))

    def sparks(self) -> None:
        """A whole period of both lines in 2 us, which an encoder without its filters would count as four edges: up from
        here, down from an odd position."""
        for after_us, line in ((0.0, 0), (0.7, 1), (1.4, 0), (2.1, 1)):
            self.chip.after_us(after_us, partial(self._flip, line))

    def _flip(self, line: int) -> None:
        port, pin = self.pins[line]
        self.chip.ports[port].drive(pin, 1 - self.chip.ports[port].outside[pin])

    def turn(self, edges: int) -> None:
        self.position += edges
        self._show()


def wheels_of(chip: Chip) -> tuple[Wheel, Wheel]:
    return Wheel(chip, "PA0", "PA1"), Wheel(chip, "PB6", "PB7")


def motor(chip: Chip, pins: tuple[str, str, str]) -> tuple[float | None, int, int]:
    """PWM and both directions of a motor; None where neither timer nor port drives."""
    pwm, *directions = (place(pin) for pin in pins)
    port = chip.ports["B"]
    level = None if port.input(pwm[1]) else float(port.level(pwm[1]))
    share = chip.tim1.complement(CHANNELS[pwm[1]]) if port.alternate(pwm[1]) else level
    forward, backward = (chip.ports[port].value["ODR"] >> pin & 1 for port, pin in directions)
    assert not any(chip.ports[port].input(pin) for port, pin in directions)
    return share, forward, backward


def expected(duty_q15: int) -> tuple[float, int, int]:
    """What a motor's pins say for a duty of the record."""
    return (abs(duty_q15) * PWM_COUNTS >> 15) / PWM_COUNTS, int(duty_q15 >= 0), int(duty_q15 < 0)


@pytest.fixture(scope="session")
def wheels_image() -> bytes:
    """Of the pin set whose motors the image of all systems does not have."""
    try:
        return find_image(Path("wheels")).read_bytes()
    except UsageError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def wheels_flash(wheels_image: bytes) -> bytes:
    """The whole flash of a board on which this pin set was saved."""
    module = systems.load("wheels")
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    configured = Chip(wheels_image)
    configured.run(START_S)
    with Session.open(UartEnd(configured)) as session:
        link = {**params.link_words(), **module.LINK, "arm_hold_ms": 0, "battery_min_mv": 6_400}
        session.upload(params.words(), period_us=module.PERIOD_US, **link)
        session.execute("SAVE")
    return bytes(configured.flash)


@pytest.fixture
def wired(wheels_flash: bytes) -> Chip:
    """The board as `wheels` wires it, started: the break is not pulled, and a rider stands on it."""
    chip = Chip(wheels_flash)
    chip.ports["B"].outside |= {4: 0, 5: 0, 12: 1}
    chip.ports["A"].outside |= {3: 0}
    chip.adc.volts[2] = 1.25
    noise, both = random.Random(5), Mpu6050()
    plain = both.read

    def read(register: int) -> int:
        if register == 0x3B:
            means = (-40, 0, 2047, 0, 0, 0)  # leans forward by a degree
            both.counts = tuple(round(noise.gauss(mean, 2.0)) for mean in means)  # type: ignore[assignment]
        return plain(register)

    both.read = read  # type: ignore[method-assign]
    chip.i2c.slaves = {both.ADDRESS: both}
    chip.run(START_S)
    return chip


def listen(session: Session, seconds: float) -> None:
    end_s = session.clock() + seconds
    while session.clock() < end_s:
        session.receive(0.002)


def test_the_firmware_leaves_the_same_behind_on_both_models(wheels_flash: bytes) -> None:
    pair = Pair(wheels_flash)
    pair.second.ports["B"].outside |= {4: 0, 5: 0}
    set_strap(pair.first, "wheels")
    assert_both_left_the_same(pair)


def test_every_step_of_an_armed_run_is_that_of_the_model_and_the_pins_follow(
    wired: Chip, connect_uart: Connect
) -> None:
    left, right = wheels_of(wired)
    wired.run(0.001)
    before = [timer.read_CNT() for timer in (wired.tim2, wired.tim4)]
    params = quantise(systems.load("wheels").TUNINGS["steered"])
    session = connect_uart(wired)
    session.begin("REALTIME_LIVE", frames=RAW_FRAMES[:4])
    capture = Capture(session, raw_frames=set(RAW_FRAMES[:4]))
    session.listener = capture.feed
    listen(session, READY_S)
    assert [motor(wired, pins) for pins in MOTORS] == [(0.0, 0, 0)] * 2, "driven low, no direction"
    said = session.telemetry["BATTERY"]
    assert said["voltage_mv"] == pytest.approx(18_810 * 1.25 / VDDA, abs=10)

    session.arm()
    seen: list[list[tuple[float | None, int, int]]] = []

    def rolls() -> None:
        left.turn(1)
        right.turn(-1)
        if left.position % 2 == 0:
            wired.after_us(EDGE_US / 2, left.sparks)
        wired.after_us(EDGE_US, rolls)

    rolls()
    for _ in range(100):
        listen(session, 0.001)
        seen.append([motor(wired, pins) for pins in MOTORS])
    wired.ports["A"].drive(3, 1)  # the rider hops off for a moment
    listen(session, 0.02)
    wired.ports["A"].drive(3, 0)
    listen(session, 0.02)

    steps = len(capture.raw)
    assert sorted(capture.raw) == list(range(steps))
    inputs = np.array([capture.raw[step] for step in range(steps)], np.int16)[:, :INPUTS]
    words = run_control(params, inputs, capture.setpoints.of_steps(steps))
    assert words.digests().tolist() == [capture.digest[step] for step in range(steps)]
    counted = [int(inputs[-1, at]) - count for at, count in zip((LEFT, RIGHT), before, strict=True)]
    assert abs(counted[0] - left.position) <= 10 and counted[0] > 100
    assert abs(counted[1] - right.position) <= 10 and counted[1] < -100
    assert sorted(set(inputs[:, RIDER].tolist())) == [0, 1] and inputs[-1, RIDER] == 1
    for motors, side in zip(zip(*seen, strict=True), ("left", "right"), strict=True):
        duties = words[f"duty_{side}_q15"].tolist()
        assert set(motors) <= {expected(duty) for duty in (0, *duties)} and len(set(motors)) > 15
        assert max(abs(duty) for duty in duties) > 300

    wired.ports["B"].drive(12, 0)
    assert [motor(wired, pins)[0] for pins in MOTORS] == [None, None], "without an instruction: pull-downs hold it"
    listen(session, 0.01)
    assert [motor(wired, pins) for pins in MOTORS] == [(0.0, 0, 0)] * 2
    wired.ports["B"].drive(12, 1)
    listen(session, 0.03)
    assert [motor(wired, pins) for pins in MOTORS] == [(0.0, 0, 0)] * 2, "and it stays so"
    assert not session.telemetry["STATUS"]["armed"]
