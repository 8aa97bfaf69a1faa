"""Samples that wait in the queue do not outlive their source: an armed injected run disarms when no more arrive."""

from __future__ import annotations

from itertools import count

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.errors import UsageError
from plumb.f103.machine import Machine
from plumb.flash.image import find_image
from plumb.link.sample_codec import sample_frames
from plumb.link.session import Session
from plumb.spec import parameters
from support.noise import with_noise
from support.pins import at_rest

QUEUE = 16
SAFE_US, FRAME_US = 50_000, 2500
NEUTRAL_US = 1000.0
SAMPLES = 1 << 7
READY_US = 2_000_000
SAMPLE = (1700, 2100, 3000)
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


@pytest.mark.slow
@pytest.mark.parametrize("period_us", [5000, 20_000])
def test_a_full_queue_does_not_outlive_its_source(period_us: int) -> None:
    machine = Machine(find_image())
    at_rest(machine)
    machine.advance_us(30_000)
    session = Session.open(machine.uart)
    session.upload(CONTROL, period_us=period_us, arm_hold_ms=0, esc_period_us=FRAME_US)
    session.begin("REALTIME_INJECTED")
    numbers = count()

    def inject() -> None:
        number = next(numbers)
        session.frames.write_frames(sample_frames(session.protocol, number, with_noise(SAMPLE, number)))

    def listen(duration_us: int) -> None:
        end_us = machine.now_us + duration_us
        while machine.now_us < end_us:
            session.receive(0.001)

    for _ in range(READY_US // period_us):
        inject()
        listen(period_us)
    session.arm()
    for _ in range(5):
        inject()
        listen(period_us)
    assert any(machine.pwm(pin).pulse_us != NEUTRAL_US for pin in ("PB6", "PB7"))

    for _ in range(QUEUE):
        inject()
    listen(SAFE_US + period_us + 2 * FRAME_US + 2000)
    assert all(machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))
    listen(period_us + 100_000)
    assert session.telemetry["EVENTS"]["disarm_cause"] == SAMPLES
    session.close()
