"""A run in real time with the board's own sensors: sampling instants, counts, pulses, and what happens in silence."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec.parameters import table
from support.flash_image import image_path
from support.pins import at_rest

SUPPLY_V = 3.3
NEUTRAL_US = 1000.0
CONTROL_WORDS = sum(row.owner == "control" for row in table())


@dataclass
class Bench:
    machine: Machine
    session: Session

    def begin(self, period_us: int, esc_period_us: int = 2500) -> Capture:
        words = self.session.read_parameters()
        self.session.upload(words[:CONTROL_WORDS], period_us=period_us, esc_period_us=esc_period_us, arm_hold_ms=0)
        self.session.begin("REALTIME_LIVE", frames=["RAW_A"])
        return Capture(self.session, raw_frames=("RAW_A",))

    def run(self, capture: Capture, seconds: float) -> None:
        end = self.session.clock() + seconds
        while self.session.clock() < end:
            capture.feed(self.session.receive(0.005))

    def pulses_us(self) -> tuple[float, float]:
        return self.machine.pwm("PB6").pulse_us, self.machine.pwm("PB7").pulse_us


@pytest.fixture
def bench() -> Iterator[Bench]:
    machine = Machine(image_path())
    at_rest(machine)
    machine.advance_us(30_000)
    with Session.open(machine.uart) as session:
        yield Bench(machine, session)


@pytest.mark.slow
@pytest.mark.parametrize("period_us", [500, 1000, 3331, 20_000, 100_000])
def test_samples_are_a_period_apart_and_arrive_as_converted(bench: Bench, period_us: int) -> None:
    """The timer samples, no instruction does: the instants repeat to within a tick of the simulation. In between the
    inputs are scanned at 1 kHz or more, whatever the period, and the last scan of a period is the sample."""
    scans = -(-period_us // 1000)
    seen: dict[str, list[float]] = {"PA0": [], "PA1": [], "PA2": []}
    """Pin -> when it was sampled."""

    def volts(t_s: float, phase: float) -> float:
        return 1.65 + 0.4 * math.sin(7 * t_s + phase)

    for phase, (pin, instants) in enumerate(seen.items()):

        def source(t_s: float, phase: int = phase, instants: list[float] = instants) -> float:
            instants.append(t_s)
            return volts(t_s, phase)

        bench.machine.adc[pin] = source
    capture = bench.begin(period_us)
    bench.run(capture, 20.5 * period_us * 1e-6 + 0.02)
    assert capture.steps >= 20
    raw = capture.raw_counts(20)
    for phase, instants in enumerate(seen.values()):
        assert np.max(np.diff(instants)) <= 1000.01e-6
        sampled = instants[scans - 1 :: scans]
        assert np.max(np.abs(np.diff(sampled) * 1e6 - period_us)) < 0.01
        counts = [round(volts(t_s, phase) / SUPPLY_V * 4096) for t_s in sampled[:20]]
        assert raw[:, phase].tolist() == counts
    assert not raw[:, 3:].any()
    assert bench.machine.warnings == []


def test_disarmed_means_neutral_and_armed_means_commanded(bench: Bench) -> None:
    capture = bench.begin(1000)
    bench.run(capture, 0.02)
    assert bench.pulses_us() == (NEUTRAL_US, NEUTRAL_US)
    bench.session.arm()
    bench.run(capture, 0.1)
    assert bench.pulses_us() != (NEUTRAL_US, NEUTRAL_US)
    bench.session.disarm()
    bench.run(capture, 0.01)
    assert bench.pulses_us() == (NEUTRAL_US, NEUTRAL_US)


def test_disarmed_nothing_but_neutral_is_ever_written(bench: Bench) -> None:
    """Not even for the moment until the end of the loop's turn: the frame could end in between."""
    written = set()
    honest = bench.machine.tim4._write_ccr

    def spy(index: int, value: int) -> None:
        written.add(value)
        honest(index, value)

    bench.machine.tim4._write_ccr = spy  # type: ignore[method-assign]
    bench.run(bench.begin(1000), 0.05)
    assert written == {2 * NEUTRAL_US}


def test_a_run_begins_with_the_neutral_pulse_it_was_given(bench: Bench) -> None:
    words = bench.session.read_parameters()
    words[[row.name for row in table()].index("esc.neutral_halfus")] = 1888
    bench.session.upload(words[:CONTROL_WORDS], period_us=1000, esc_period_us=2500)
    bench.session.begin("LOCKSTEP")
    bench.machine.advance_us(20_000)
    assert bench.pulses_us() == (944.0, 944.0)


@pytest.mark.slow
def test_a_missed_period_blocks_arming_until_the_next_run(bench: Bench) -> None:
    bench.run(bench.begin(1000), 0.02)
    assert bench.session.connect()["FAULTS"] == 0
    bench.machine.tim3.write_arr(29)  # 30 us: shorter than a turn of the loop
    bench.machine.advance_us(70_000)  # the counter, past its new end already, goes round first
    with pytest.raises(LinkError, match="the board has a fault"):
        bench.session.arm()
    faults = bench.session.connect()["FAULTS"]
    assert faults & 2 and faults >> 24
    bench.session.begin("REALTIME_LIVE")
    assert bench.session.connect()["FAULTS"] == 0
    bench.session.arm()


def test_counts_of_an_uncalibrated_converter_are_not_used(bench: Bench) -> None:
    honest = bench.machine.adc1._calibrate
    bench.machine.adc1._calibrate = lambda *_: None  # type: ignore[method-assign]
    capture = bench.begin(1000)
    bench.run(capture, 0.05)
    assert capture.steps == 0
    with pytest.raises(LinkError, match="the board has a fault"):
        bench.session.arm()
    bench.machine.adc1._calibrate = honest  # type: ignore[method-assign]
    capture = bench.begin(1000)
    bench.run(capture, 0.05)
    assert capture.steps > 0


@pytest.mark.slow
@pytest.mark.parametrize("esc_period_us", [2500, 20_000])
def test_silence_makes_it_safe_within_50_ms_for_good(bench: Bench, esc_period_us: int) -> None:
    capture = bench.begin(1000, esc_period_us)
    bench.session.arm()
    bench.run(capture, 0.2)
    assert bench.pulses_us() != (NEUTRAL_US, NEUTRAL_US)
    silent_us = bench.machine.now_us
    assert bench.machine.run_until(lambda: bench.pulses_us() == (NEUTRAL_US, NEUTRAL_US), 100_000)
    assert bench.machine.now_us - silent_us < 50_000
    bench.session.pump()  # a keep-alive that comes too late revives nothing
    bench.run(capture, 0.1)
    assert bench.pulses_us() == (NEUTRAL_US, NEUTRAL_US)


def test_a_crash_in_flight_sends_neutral_pulses(bench: Bench) -> None:
    """Before the reset, and instead of it should it fail: here the reset request is ignored, the watchdog acts."""
    machine = bench.machine
    capture = bench.begin(1000)
    bench.session.arm()
    bench.run(capture, 0.1)
    assert bench.pulses_us() != (NEUTRAL_US, NEUTRAL_US)
    honest = machine.request_reset
    machine.request_reset = lambda cause: honest(cause) if cause != "software" else None  # type: ignore[method-assign]
    machine.rcc.kill_crystal()
    # The clock has dropped from 72 to 8 MHz: the timer counts nine times slower until the reset.
    assert machine.run_until(lambda: bench.pulses_us() == (9 * NEUTRAL_US, 9 * NEUTRAL_US), 30_000)
    assert machine.run_until(lambda: machine.reset_count == 2, 400_000)
    machine.advance_us(200_000)
    assert bench.pulses_us() == (NEUTRAL_US, NEUTRAL_US)


def test_a_reset_in_flight_ends_disarmed(bench: Bench) -> None:
    capture = bench.begin(1000)
    bench.session.arm()
    bench.run(capture, 0.1)
    bench.machine.reset()
    for _ in range(100):
        bench.machine.advance_us(500)
        for pin in ("PB6", "PB7"):
            wave = bench.machine.pwm(pin)
            assert not wave.enabled or wave.pulse_us in (0.0, NEUTRAL_US)
