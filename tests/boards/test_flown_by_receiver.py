"""A pilot has armed the flash image by his receiver: it bridges a sensor that is gone for a moment, flies on without
the accelerometer, and stops the rotors when the gyro stays away."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.boards.virtual_machine import open_machine
from plumb.contract.parameters import quantise
from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.invensense import Invensense
from plumb.f103.attached.itg3205 import Itg3205
from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot
from plumb.link.identity import disarmed_text
from plumb.link.parameter_table import read_table
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.physics.battery import BATTERY_PIN, Battery
from plumb.spec import crsf
from plumb.spec.parameter_file import by_name
from plumb.systems import load
from plumb.systems.fitted_chips import part_of
from support.noise import with_noise

IMAGE = Path(__file__).parents[2] / "build/images/quadrotor/firmware.elf"
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
SYSTEM = load("quadrotor")
PINS = ("PA0", "PA1", "PA2", "PA3")
NEUTRAL_US, HOLD_MS = 1000.0, 100
SENSOR = 0x0040
FRAME_S = 0.004
START_US = 20_000
LOWEST_MV = 10_500
LOW, UNKNOWN = 1 << 8, 1 << 9


class Flown:
    """A machine, the host that listens to it, and its pilot."""

    def __init__(self, *, two_chips: bool = False) -> None:
        self.sensor: Invensense | Itg3205
        self.accel: Adxl345
        self._noise = 0

        def rates(_time_s: float) -> tuple[float, float, float]:
            return self._noisy((0.0, 0.0, 0.0), 0.08)

        def forces(_time_s: float) -> tuple[float, float, float]:
            return self._noisy((0.0, 0.0, 1.0), 0.004)

        def couple(machine: Machine) -> None:
            self.sensor = (
                Itg3205(machine, rates) if two_chips else Invensense(machine, rates, forces, part_of("mpu6050"))
            )
            machine.i2c_bus.slaves.append(self.sensor)
            if two_chips:
                self.accel = Adxl345(machine, forces)
                machine.i2c_bus.slaves.append(self.accel)

        self.machine = open_machine(IMAGE, strap="quadrotor", couple=couple)
        session = Session.open(self.machine.uart)
        params = quantise(SYSTEM.TUNINGS["two-chips" if two_chips else "hummingbird"])
        link = {**params.link_words(), **SYSTEM.LINK, "period_us": 2500, "arm_hold_ms": HOLD_MS}
        self.machine.adc[BATTERY_PIN] = Battery(11.4).input_v()
        session.upload(
            params.words(), **link, receiver=1, calibrated=1, battery_min_mv=LOWEST_MV, accel_bus=0 if two_chips else 2
        )
        session.execute("SAVE")
        session.close()
        self.machine.reset()
        self.machine.advance_us(START_US)
        self.machine.uart.reset_input_buffer()
        self.session = Session.open(self.machine.uart)
        self.session.connect()
        self.passes(4.0, crsf.sticks())

    def _noisy(self, felt: tuple[float, float, float], lsb: float) -> tuple[float, float, float]:
        """With noise of the size of a count, without which a sensor is taken for stuck."""
        self._noise += 1
        x, y, z = with_noise((0, 0, 0), self._noise, 3)
        return felt[0] + lsb * x, felt[1] + lsb * y, felt[2] + lsb * z

    def passes(self, seconds: float, frame: bytes) -> None:
        end = due = self.session.clock()
        end += seconds
        while self.session.clock() < end:
            if self.session.clock() >= due:
                self.machine.usart3.receive(frame)
                due += FRAME_S
            self.session.receive(0.002)

    @property
    def armed(self) -> bool:
        return bool(self.session.telemetry["STATUS"]["armed"])

    @property
    def pulses_us(self) -> list[float]:
        return [self.machine.pwm(pin).pulse_us for pin in PINS]


UP = crsf.sticks(throttle=0.3, on=True)


@pytest.fixture(scope="module")
def taken() -> Iterator[tuple[Flown, Snapshot]]:
    flown = Flown()
    assert not flown.armed
    flown.passes(0.25, crsf.sticks(on=True))
    flown.passes(0.25, UP)
    yield flown, flown.machine.snapshot()


@pytest.fixture
def flown(taken: tuple[Flown, Snapshot]) -> Iterator[Flown]:
    yield taken[0]
    taken[0].machine.restore(taken[1])
    taken[0].sensor.answers = True


def turn(pulses_us: list[float]) -> bool:
    return all(1200.0 < pulse < 1500.0 for pulse in pulses_us)


def test_the_switch_of_the_pilot_turns_the_rotors(flown: Flown) -> None:
    assert flown.armed and turn(flown.pulses_us)
    flown.passes(0.03, crsf.sticks(throttle=0.3))
    assert flown.pulses_us == [NEUTRAL_US] * 4


@pytest.mark.parametrize(("volts", "missing"), [(10.2, LOW), (0.0, UNKNOWN), (25.0, UNKNOWN)])
def test_a_battery_is_reported_in_the_air_and_keeps_the_vehicle_on_the_ground(
    flown: Flown, volts: float, missing: int
) -> None:
    said = flown.session.telemetry
    assert said["BATTERY"]["voltage_mv"] == pytest.approx(11_400, abs=30), "a count is 5 mV"
    assert not said["PLAUSIBILITY"]["missing"] & (LOW | UNKNOWN)
    flown.machine.adc[BATTERY_PIN] = Battery(volts).input_v()
    flown.passes(0.8, UP)
    assert flown.armed and turn(flown.pulses_us)
    assert said["PLAUSIBILITY"]["missing"] & (LOW | UNKNOWN) == missing
    flown.passes(0.8, crsf.sticks())
    flown.passes(0.3, crsf.sticks(on=True))
    assert not flown.armed


def test_a_converter_that_falls_silent_is_a_battery_that_is_not_known(flown: Flown) -> None:
    flown.machine.adc2.silent = True
    flown.passes(0.4, UP)
    assert flown.armed and flown.session.telemetry["PLAUSIBILITY"]["missing"] & UNKNOWN
    flown.machine.adc2.silent = False


def test_a_sensor_that_is_gone_for_20_ms_is_bridged(flown: Flown) -> None:
    flown.sensor.answers = False
    flown.passes(0.02, UP)
    flown.sensor.answers = True
    flown.passes(0.5, UP)
    assert flown.armed and turn(flown.pulses_us)
    assert flown.session.telemetry["SENSORS"]["bus_failures"] > 0
    assert not flown.session.telemetry["STATUS"]["faults"] & SENSOR, "it is back"


def test_a_sensor_that_stays_away_stops_the_rotors_after_50_ms(flown: Flown) -> None:
    flown.sensor.answers = False
    flown.passes(0.04, UP)
    assert turn(flown.pulses_us)
    flown.passes(0.04, UP)
    assert flown.pulses_us == [NEUTRAL_US] * 4
    flown.passes(0.3, UP)
    said = flown.session.telemetry
    why = disarmed_text(said["EVENTS"]["disarm_cause"], said["PLAUSIBILITY"], flown.session.parameters.uploaded)
    assert not flown.armed and "no samples came" in why


def test_without_the_accelerometer_it_flies_on_and_takes_it_back() -> None:
    flown = Flown(two_chips=True)
    flown.passes(0.25, crsf.sticks(on=True))
    capture = Capture(flown.session, raw_frames=set(RAW_FRAMES[:2]))
    flown.session.select(RAW_FRAMES[:2])
    flown.session.listener = capture.feed
    flown.passes(0.1, UP)
    flown.accel.answers = False
    flown.passes(0.25, UP)
    flown.accel.answers = True
    flown.passes(0.25, UP)
    assert flown.armed and turn(flown.pulses_us)
    assert not flown.session.telemetry["STATUS"]["faults"] & SENSOR, "it is back"
    raw = np.array([capture.raw[step][:6] for step in sorted(capture.raw)])
    lost = (raw[:, 3:] == -32768).all(axis=1)
    assert 90 <= lost.sum() <= 120, "0.25 s, and up to 20 ms until it is set up again"
    assert (raw[:, 0] != -32768).all(), "no step without a rate"
    assert not lost[0] and not lost[-1]


MOVES, CONVERGES = 1 << 1, 1 << 2
STOPPED_UNSURE = 1 << 12


def steps(flown: Flown, axis: int, by_dps: float) -> None:
    """The gyro's bias steps."""
    honest = flown.sensor.source

    def source(time_s: float) -> tuple[float, float, float]:
        felt = list(honest(time_s))
        felt[axis] += by_dps
        return felt[0], felt[1], felt[2]

    flown.sensor.source = source


@pytest.mark.parametrize(("axis", "by_dps"), [(0, 20.0), (0, -20.0), (1, 20.0), (2, 20.0)])
def test_a_gyro_that_steps_by_20_deg_per_s_is_reported_and_cannot_be_armed(
    flown: Flown, axis: int, by_dps: float
) -> None:
    """About z it looks like a turn for ever; about the other axes the acceleration shows that nothing turns, and the
    step is learned as a bias."""
    flown.passes(0.5, crsf.sticks())
    said = flown.session.telemetry
    steps(flown, axis, by_dps)
    flown.passes(0.5, crsf.sticks())
    assert not flown.armed and said["PLAUSIBILITY"]["missing"] & MOVES
    flown.passes(0.3, crsf.sticks(on=True))
    assert not flown.armed
    flown.passes(1.2, crsf.sticks())
    assert said["PLAUSIBILITY"]["missing"] & (MOVES if axis == 2 else CONVERGES), "2 s after the step"


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "stopped"), [(0, STOPPED_UNSURE), (2, 0)])
def test_with_the_rotors_on_a_step_of_20_deg_per_s_ends_what_stands_on_the_ground(
    flown: Flown, axis: int, stopped: int
) -> None:
    """About z nothing shows it."""
    steps(flown, axis, 20.0)
    flown.passes(3.0, UP)
    assert flown.session.telemetry["PLAUSIBILITY"]["disarmed_by"] == stopped
    assert flown.armed == (stopped == 0)


def test_the_hover_that_a_flight_has_learned_is_there_after_a_save_and_a_reset(flown: Flown) -> None:
    """1 g is felt at 0.6 of the throttle, where 0.44 was set."""
    flown.passes(2.5, crsf.sticks(throttle=0.6, on=True))
    assert flown.armed
    flown.passes(0.2, crsf.sticks())
    flown.session.execute("SAVE")
    flown.machine.reset()
    flown.machine.advance_us(START_US)
    flown.machine.uart.reset_input_buffer()
    with Session.open(flown.machine.uart) as session:
        hover_q15 = by_name(read_table(session))["attitude.aid_hover_q15"]
    assert hover_q15 == pytest.approx(0.6 * (1 << 15), rel=0.03)
