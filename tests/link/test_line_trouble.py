"""The whole image on a bad UART: framing errors, noise, overruns, floods of garbage. Steps go on, outputs stay safe,
what was lost is counted, and the link is there again when the line is."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("unicorn")

from plumb.f103.machine import Machine
from plumb.link.session import Session
from plumb.spec.parameters import control_part
from support.flash_image import image_path
from support.pins import at_rest

NEUTRAL_US = 1000.0
PERIOD_US = 2000
FAULT_UART = 0x200
COUNTED_TO = 255
"""Every damaged byte is counted, up to here; a burst that is looked at once it is over would count once."""

Trouble = Callable[[Machine, bytes], object]
TROUBLES: dict[str, Trouble] = {
    "garbage": lambda machine, data: machine.uart.write(data),
    "framing errors": lambda machine, data: machine.uart.write_with_framing_error(data),
    "noise": lambda machine, data: machine.uart.write_with_noise(data),
    "overruns": lambda machine, data: machine.uart.write_overrun(data),
    "bells": lambda machine, data: machine.uart.write(b"\a" * len(data)),
    "an endless line": lambda machine, data: machine.uart.write(b"t" * len(data)),
}


@pytest.fixture
def machine() -> Iterator[Machine]:
    machine = Machine(image_path())
    at_rest(machine)
    machine.advance_us(30_000)
    yield machine
    assert machine.warnings == []


def armed_run(machine: Machine) -> Session:
    session = Session.open(machine.uart)
    control = control_part(session.read_parameters())
    session.upload(control, period_us=PERIOD_US, esc_period_us=2500, arm_hold_ms=0)
    session.begin("REALTIME_LIVE")
    session.receive(0.1)
    session.arm()
    return session


@pytest.mark.slow
@pytest.mark.parametrize("trouble", TROUBLES)
def test_a_bad_line_ends_in_neutral_outputs_and_the_link_comes_back(machine: Machine, trouble: str) -> None:
    session = armed_run(machine)
    end = session.clock() + 0.3
    while session.clock() < end:
        session.receive(0.005)
    assert session.telemetry["STATUS"]["faults"] == 0
    assert pulses_us(machine) != (NEUTRAL_US, NEUTRAL_US)
    TROUBLES[trouble](machine, random.Random(trouble).randbytes(8000))  # 87 ms: no keep-alive gets through
    machine.advance_us(50_000)
    assert pulses_us(machine) == (NEUTRAL_US, NEUTRAL_US)
    machine.advance_us(150_000)
    assert pulses_us(machine) == (NEUTRAL_US, NEUTRAL_US)
    again = Session.open(machine.uart)
    assert again.identity is not None and again.identity.mismatch is None
    end = again.clock() + 0.3  # reports of every 100 ms are from now
    while again.clock() < end:
        again.receive(0.005)
    status, said = again.telemetry["STATUS"], again.identity["FAULTS"]
    assert status["mode"] == again.protocol["STATUS"].value("mode", "REALTIME")  # the run went on
    assert status["faults"] & 0xFF == 0  # and no step was late
    if trouble in ("framing errors", "noise", "overruns"):
        assert said & FAULT_UART and said >> 16 & 0xFF == COUNTED_TO
    else:
        assert (again.telemetry["COUNTERS"]["rejected"] > 0) == (trouble != "bells")  # a bell is an answer
    again.end()


def pulses_us(machine: Machine) -> tuple[float, float]:
    return machine.pwm("PB6").pulse_us, machine.pwm("PB7").pulse_us
