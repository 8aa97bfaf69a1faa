"""The analog inputs of a live board, on the virtual board with the flash image: oversampling, inputs and a converter
that fail, and interrupts that come late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.link.identity import NackError
from plumb.link.monitor import watch
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec.parameters import SCAN_US, table
from plumb.systems.quad import scenarios as quad
from plumb.systems.turntable import scenarios as turntable
from support.pins import LSB_V, PINS, at_rest
from support.sensor_bench import (
    BOOT_US,
    CONTROL_WORDS,
    NO_CONVERSIONS,
    PERIOD_US,
    SENSOR,
    STEPS_MISSED,
    Bench,
    bench_as_made,
    image,
)

SIX_VOLTS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
NO_SAMPLE = -32768
SCANS = PERIOD_US // 1000
"""Per period: one per millisecond."""
RAIL_S, STUCK_S = 0.050, 0.100
SCAN_DONE = 1 << (16 + 11)
"""Of DMA1 channel 1, in the interrupt controller."""


def analog_bench() -> Bench:
    machine = image()
    at_rest(machine)
    machine.advance_us(BOOT_US)
    return Bench(machine, Session.open(machine.uart))


def six_bench() -> Bench:
    machine = image()
    at_rest(machine, SIX_VOLTS)
    machine.advance_us(BOOT_US)
    bench = Bench(machine, Session.open(machine.uart))
    words = quantise(turntable.TUNINGS[turntable.DEFAULT_TUNING]).words()
    bench.begin = lambda **link: bench.begin_with(words, **link)  # type: ignore[method-assign]
    return bench


@pytest.fixture
def analog() -> Bench:
    return bench_as_made("analog", analog_bench)


@pytest.fixture
def six() -> Bench:
    """A turntable, each of its inputs at a level of its own."""
    return bench_as_made("six", six_bench)


def after_a_scan(bench: Bench) -> None:
    bench.machine.advance_us(1000 - bench.machine.tim3.count(bench.machine.now) + 200)


@pytest.mark.slow
def test_an_input_at_a_rail(analog: Bench) -> None:
    """49 ms of a knock are no fault, 50 are."""
    capture = analog.armed()
    for pin, volts in (("PA1", 3.3), ("PA0", 0.0)):
        honest = analog.machine.adc[pin]
        after_a_scan(analog)
        until_s = analog.machine.now_s + RAIL_S - 0.001
        analog.machine.adc[pin] = lambda t_s, v=volts, s=honest, end=until_s: v if t_s < end else s(t_s)  # type: ignore[misc]
        analog.run(capture, RAIL_S + 0.01)
        assert analog.driving()
        after_a_scan(analog)
        analog.machine.adc[pin] = volts
        analog.run(capture, RAIL_S + 0.006)
        assert not analog.driving()
        assert analog.reported()[0] == f"input {pin} is at a rail"
        assert analog.faults() & SENSOR
        shown = next(iter(watch(analog.session, 0.2)))["faults"]
        assert shown[:2] == ["a sensor is lost or not to be trusted", f"input {pin} is at a rail"]
        analog.session.listener = None
        assert analog.run(capture, 0.1) > 15, "the steps go on: the host sees what the input does"
        analog.machine.adc[pin] = honest
        analog.recovers(capture)


@pytest.mark.slow
@pytest.mark.parametrize("log2", [0, 2, 4])
def test_a_rail_is_where_every_conversion_is(analog: Bench, log2: int) -> None:
    """One away from it in 25 ms says that the input still moves."""
    capture = analog.begin(adc_oversample_log2=log2)
    for volts in (3.3, 0.0):
        analog.machine.adc["PA1"] = lambda t_s, at=volts: 1.6 if t_s % 0.025 < 0.001 else at  # type: ignore[misc]
        analog.run(capture, 0.2)
        assert analog.reported() == []
        analog.machine.adc["PA1"] = volts
        analog.run(capture, RAIL_S + 0.01)
        assert "input PA1 is at a rail" in analog.reported()


@pytest.mark.slow
@pytest.mark.parametrize("period_us", [1000, 5000, 20_000, 100_000])
def test_a_rail_and_a_stuck_input_are_found_in_time_whatever_the_period(analog: Bench, period_us: int) -> None:
    """Within 50 and 100 ms and what asking takes, where limits of 5 and 100 steps took up to 10 s."""
    capture = analog.begin(period_us=period_us)
    honest = analog.machine.adc["PA0"]
    analog.run(capture, 0.12)
    for volts, limit_s, bit in ((3.3, RAIL_S, 1), (1.35, STUCK_S, 1 << 8)):
        assert analog.faults() & SENSOR == 0
        analog.machine.adc["PA0"] = volts
        begin_s = analog.session.clock()
        while not analog.faults() & SENSOR:
            assert analog.session.clock() - begin_s < limit_s + 0.03
            analog.run(capture, 0.001)
        assert analog.session.clock() - begin_s > limit_s - 0.005
        assert analog.reported()
        assert analog.session.telemetry["SENSORS"]["analog"] & bit
        analog.machine.adc["PA0"] = honest
        analog.run(capture, 0.02)


def test_six_inputs_in_their_order(six: Bench) -> None:
    capture = six.begin()
    assert six.run(capture, 0.2) >= 0.2e6 / PERIOD_US - 2
    means = capture.raw_counts(30)[5:].mean(0)
    assert means[: len(SIX_VOLTS)].tolist() == pytest.approx([volts / LSB_V for volts in SIX_VOLTS], abs=2.0)
    assert six.machine.warnings == []


@pytest.mark.slow
@pytest.mark.parametrize("index", range(6))
def test_of_six_inputs_the_bad_one_has_no_sample(six: Bench, index: int) -> None:
    """At a rail, or without change: -32768 in its place; the others and the steps go on."""
    pin = PINS[index]
    capture = six.begin()
    honest = six.machine.adc[pin]
    for volts, said in ((3.3, f"input {pin} is at a rail"), (SIX_VOLTS[index], f"input {pin} does not change")):
        six.run(capture, 0.05)
        assert six.reported() == []
        assert NO_SAMPLE not in last(capture)
        six.machine.adc[pin] = volts
        assert six.run(capture, 0.15) >= 28
        assert six.reported()[0] == said
        assert [place for place, count in enumerate(last(capture)) if count == NO_SAMPLE] == [index]
        six.machine.adc[pin] = honest


def test_inputs_that_a_system_does_not_have_read_0(six: Bench) -> None:
    """Whatever was on them in the run of another one."""
    six.run(six.begin(), 0.1)
    defaults = [row.default for row in table()][:CONTROL_WORDS]
    capture = six.begin_with(defaults)
    six.run(capture, 0.1)
    assert capture.raw_counts(15)[:, :3].all() and not capture.raw_counts(15)[:, 3:].any()


def last(capture: Capture) -> list[int]:
    """Raw counts of a step a moment ago, all of them."""
    return [int(count) for count in capture.raw_counts(capture.steps)[capture.steps - 4]]


@pytest.mark.slow
def test_an_input_that_hangs(analog: Bench) -> None:
    capture = analog.armed()
    honest = analog.machine.adc["PA2"]
    assert callable(honest)
    analog.machine.adc["PA2"] = honest(analog.machine.now_s)
    analog.run(capture, STUCK_S - 0.01)
    assert analog.driving()
    analog.run(capture, 0.02)
    assert not analog.driving()
    assert analog.reported() == ["input PA2 does not change"]
    analog.machine.adc["PA2"] = honest
    analog.recovers(capture)


@pytest.mark.parametrize("limit", ["rail_ms", "stuck_ms"])
def test_a_board_whose_detection_is_switched_off_is_not_armed(analog: Bench, limit: str) -> None:
    with pytest.raises(NackError, match=f"{limit}: 0 .* would break promise 7"):
        analog.armed(**{limit: 0})


def test_a_noisy_input_is_no_reason_to_stop(analog: Bench) -> None:
    """0.1 V rms, 124 counts: what is beyond the sensor's range is clamped and counted, and R grows with |a|. With the
    parameters of this period: those of 20 ms would turn by four times what the gyro's noise says."""
    analog.name, analog.control = "", quantise(replace(quad.ADAPTIVE, period_us=PERIOD_US)).words()
    capture = analog.armed()
    at_rest(analog.machine, noise_lsb=0.1 / LSB_V)
    assert analog.run(capture, 2.0) >= 2e6 / PERIOD_US - 2  # some 7 of 200 steps a second are clamped
    assert analog.driving() and analog.reported() == []
    assert analog.session.telemetry["EVENTS"]["saturated"] > 0


@pytest.mark.slow
def test_a_converter_that_falls_silent(analog: Bench) -> None:
    capture = analog.armed()
    analog.machine.adc1.silent = True
    analog.run(capture, 4 * PERIOD_US * 1e-6)
    assert not analog.driving()
    assert analog.faults() & NO_CONVERSIONS
    assert analog.run(capture, 0.2) == 0
    analog.machine.adc1.silent = False
    analog.recovers(capture)
    assert analog.faults() & NO_CONVERSIONS == 0


@pytest.mark.slow
def test_counts_of_a_converter_that_could_not_be_calibrated_are_no_samples(analog: Bench) -> None:
    calibrate, analog.machine.adc1._calibrate = analog.machine.adc1._calibrate, lambda *_: None  # type: ignore[method-assign]
    capture = analog.begin()
    scans = analog.machine.adc1.scans
    assert analog.run(capture, 0.2) == 0
    assert analog.machine.adc1.scans > scans
    assert analog.faults() & NO_CONVERSIONS
    analog.machine.adc1._calibrate = calibrate  # type: ignore[method-assign]
    analog.recovers(capture)


@pytest.mark.parametrize("log2", [0, 1, 2, 3, 4])
def test_oversampling_is_the_rounded_mean_of_scans_in_a_row(analog: Bench, log2: int) -> None:
    seen: dict[str, list[tuple[float, float]]] = {"PA0": [], "PA1": [], "PA2": []}
    for pin, rows in seen.items():

        def source(
            t_s: float,
            rows: list[tuple[float, float]] = rows,
            honest: float | Callable[[float], float] = analog.machine.adc[pin],
        ) -> float:
            volts = honest(t_s) if callable(honest) else honest
            rows.append((t_s, volts))
            return volts

        analog.machine.adc[pin] = source
    capture = analog.begin(adc_oversample_log2=log2)
    analog.run(capture, 0.2)
    scans, triggers = 1 << log2, SCANS - 1
    """Of a sample, and single ones between two samples."""
    raw = capture.raw_counts(20)
    for index, rows in enumerate(seen.values()):
        own = np.array(rows)[: 20 * (triggers + scans)].reshape(20, triggers + scans, 2)[:, triggers:]
        times, counts = own[:, :, 0], np.rint(own[:, :, 1] / LSB_V).astype(int)
        assert raw[:, index].tolist() == ((counts.sum(1) + scans // 2) >> log2).tolist()
        assert np.abs(np.diff(times[:, 0]) - PERIOD_US * 1e-6).max() < 1e-8, "the timer begins every period"
        assert times[:, -1].max() - times[:, 0].min() < 20 * PERIOD_US * 1e-6
        spread = times[:, -1] - times[:, 0]
        assert np.all(spread <= (scans - 1) * SCAN_US * 1e-6), "one scan after the other, in the time of each"
    assert analog.machine.warnings == []


def test_scans_that_do_not_fit_the_period_are_refused(analog: Bench) -> None:
    with pytest.raises(UsageError, match="adc_oversample_log2 = 4 takes 800 us"):
        analog.begin(adc_oversample_log2=4, period_us=500)
    analog.begin(adc_oversample_log2=3, period_us=500)


@pytest.mark.parametrize("late_periods", [1.2, 1.6])
def test_a_scan_that_was_overwritten_is_counted(analog: Bench, late_periods: float) -> None:
    """The interrupt comes late by more than a period: two scans are there, one of them is lost."""
    capture = analog.begin()
    analog.run(capture, 0.05)
    assert analog.faults() == 0
    nvic, machine = analog.machine.nvic, analog.machine
    after_a_scan(analog)
    machine.advance_us(PERIOD_US - 1000)
    assert machine.run_until(lambda: not nvic.pending & SCAN_DONE and machine.adc1.busy, 2 * PERIOD_US)
    nvic.enabled &= ~SCAN_DONE
    machine.advance_us(late_periods * PERIOD_US)
    nvic.enabled |= SCAN_DONE
    nvic.changed()
    machine.advance_us(1000)
    faults = analog.faults()
    assert faults & STEPS_MISSED
    assert faults >> 24 == 1
    analog.session.begin("REALTIME_LIVE")
    machine.advance_us(2 * PERIOD_US)
    assert analog.faults() == 0, "what was missed belongs to the run before"


def test_no_tick_of_the_run_before_comes_with_the_next(analog: Bench) -> None:
    """A scan ends while interrupts wait and the run is begun anew: its sample belongs to nobody."""
    capture = analog.begin()
    analog.run(capture, 0.05)
    nvic = analog.machine.nvic
    nvic.enabled &= ~SCAN_DONE
    analog.machine.advance_us(1.5 * PERIOD_US)
    assert nvic.pending & SCAN_DONE
    analog.session.begin("REALTIME_LIVE", frames=["RAW_A"])
    begun_us = analog.machine.now_us
    times: list[float] = []
    honest = analog.machine.adc["PA0"]
    assert callable(honest)

    def noted(t_s: float) -> float:
        times.append(t_s)
        return honest(t_s)

    analog.machine.adc["PA0"] = noted
    capture = Capture(analog.session)
    while capture.steps == 0:
        capture.feed(analog.session.receive(0.001))
    assert capture.steps == len(times) // SCANS, "a step for each period's last scan, and none more"
    assert analog.machine.now_us - begun_us > PERIOD_US * 0.9
