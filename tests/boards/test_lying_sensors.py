"""Sensors that answer and are wrong, on the pins of the virtual board with the flash image: held volts with the
converter's noise, swapped axes, garbage from a chip. The board disarms within 500 ms and names the check; and a board
that is not ready refuses to be armed and says why."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.link.identity import BLOCKED, plausibility_text
from plumb.link.monitor import watch
from plumb.link.realtime import Capture
from plumb.link.session import Session
from support.pins import LSB_V, at_rest
from support.sensor_bench import BOOT_US, DIGITAL_CONTROL, Bench, DigitalBench, bench_as_made, boot_digital, fit, image

WITHIN_S = 0.5
IMPLAUSIBLE = 1 << 11
INNOVATION = 2
"""May be reported first: soon after arming its time counts fourfold. The rows of `plumb faults` hold each check
alone."""
LEVEL_V = (1.35, 1.65, 2.45)
"""Gyro, y and z of an axis that is level and still."""
TURN_Q32 = 2**32


def analog_bench() -> Bench:
    machine = image()
    at_rest(machine)
    machine.advance_us(BOOT_US)
    return Bench(machine, Session.open(machine.uart))


def digital_bench() -> DigitalBench:
    machine = image()
    gyro, accel = fit(machine)
    boot_digital(machine)
    return DigitalBench(machine, Session.open(machine.uart), gyro=gyro, accel=accel, control=DIGITAL_CONTROL)


@pytest.fixture
def analog() -> Bench:
    return bench_as_made("analog", analog_bench)


@pytest.fixture
def digital() -> DigitalBench:
    return bench_as_made("i2c", digital_bench)


def disarms(bench: Bench, capture: Capture, check: int) -> None:
    """Outputs neutral within the limit, the cause and the check named; steps go on."""
    assert bench.driving()
    begin_s = bench.session.clock()
    while bench.driving():
        bench.run(capture, 0.005)
        assert bench.session.clock() - begin_s < WITHIN_S
    bench.session.telemetry.clear()
    while not {"EVENTS", "PLAUSIBILITY"} <= set(bench.session.telemetry):
        bench.session.receive(0.02)
    assert bench.session.telemetry["EVENTS"]["disarm_cause"] & IMPLAUSIBLE
    assert bench.session.telemetry["PLAUSIBILITY"]["disarmed_by"] & (check | INNOVATION)
    assert bench.reported() == [], "no sensor is stuck, at a rail or lost"
    shown = next(iter(watch(bench.session, 0.3)))
    assert BLOCKED[11] in shown["disarm_cause"] and len(shown["disarm_cause"]) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pin", "volts", "check"),
    [
        ("PA1", 3.0, 4), ("PA1", 0.3, 4), ("PA2", 3.2, 1), ("PA2", 1.65, 4),
        ("PA0", 3.0, 4), ("PA0", 0.4, 4), ("PA0", 1.45, 2),
    ],
)  # fmt: skip
def test_held_volts_with_noise(analog: Bench, pin: str, volts: float, check: int) -> None:
    capture = analog.armed()
    chance = random.Random(f"{pin} {volts}")
    analog.machine.adc[pin] = lambda _t_s: volts + LSB_V * chance.gauss(0.0, 0.7)
    disarms(analog, capture, check)


def test_gyro_and_accelerometer_swapped(analog: Bench) -> None:
    capture = analog.armed()
    adc = analog.machine.adc
    adc["PA0"], adc["PA1"] = adc["PA1"], adc["PA0"]
    disarms(analog, capture, 4)
    analog.session.end()
    analog.session.telemetry.clear()
    analog.run(analog.begin(), 0.3)
    assert analog.session.telemetry["PLAUSIBILITY"]["disarmed_by"] == 0, "that was the run before"


def garbage(_time_s: float, chance: random.Random = random.Random(3)) -> tuple[float, float, float]:  # noqa: B008
    return chance.uniform(-16.0, 16.0), chance.uniform(-16.0, 16.0), chance.uniform(-16.0, 16.0)


def test_a_chip_that_returns_garbage(digital: DigitalBench) -> None:
    capture = digital.armed()
    digital.accel.source = garbage
    disarms(digital, capture, 4)  # it turns by any angle at once


def test_the_axes_of_a_chip_swapped(digital: DigitalBench) -> None:
    """x where z was: 84 deg at once."""
    capture = digital.armed()
    honest = digital.accel.source
    digital.accel.source = lambda t_s: (honest(t_s)[2], honest(t_s)[1], honest(t_s)[0])
    disarms(digital, capture, 4)


def test_a_gyro_that_turns_alone(digital: DigitalBench) -> None:
    capture = digital.armed()
    honest = digital.gyro.source
    digital.gyro.source = lambda t_s: (honest(t_s)[0], 250.0 + honest(t_s)[1], honest(t_s)[2])
    disarms(digital, capture, 4)


def lifted(bench: Bench) -> None:
    at_rest(bench.machine, (LEVEL_V[0], LEVEL_V[1], 2.7))


def tilted(bench: Bench) -> None:
    at_rest(bench.machine, (LEVEL_V[0], 1.65 + 0.8 * 0.3420, 1.65 + 0.8 * 0.9397))


def given_a_setpoint(bench: Bench) -> None:
    bench.session.set_setpoint(TURN_Q32 // 72)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        (lifted, "it moves: hold it still"),
        (tilted, "it is tilted too far: bring it level or upright"),
        (given_a_setpoint, "the setpoint is not 0"),
    ],
)
def test_not_ready_is_refused_and_said(analog: Bench, how: Callable[[Bench], None], sentence: str) -> None:
    capture = analog.begin()
    how(analog)
    analog.run(capture, 1.0)
    with pytest.raises(LinkError, match=f"not ready to be armed; {sentence}"):
        analog.session.arm(ready_wait_s=0.2)
    shown = next(iter(watch(analog.session, 0.3)))["blocked"]
    assert sentence in shown


def test_ready_a_moment_later_is_armed_by_the_same_command(analog: Bench) -> None:
    """arm() waits: the run begins, the filter settles, and then it is armed."""
    capture = analog.begin()
    begin_s = analog.session.clock()
    analog.session.arm()
    assert 0.3 < analog.session.clock() - begin_s < 1.0
    analog.run(capture, 0.1)
    assert analog.driving()
    assert plausibility_text(analog.session.telemetry["PLAUSIBILITY"], "balancer") == []


@pytest.mark.slow
def test_the_arm_switch_waits_for_rest_too(analog: Bench) -> None:
    lifted(analog)
    machine = analog.machine
    machine.advance_us(50_000)
    machine.drive("PC14", False)
    machine.advance_us(2_500_000)
    assert not analog.driving()
    at_rest(machine)
    machine.advance_us(2_500_000)
    assert analog.driving()
