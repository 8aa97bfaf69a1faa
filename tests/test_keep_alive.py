"""A host that falls silent loses the board: outputs safe within 50 ms and for good, whatever moves, however samples
come, over either link. Looked at on the pins of the virtual board."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from balancer_bench import Balancer
from pins import at_rest
from plumb import parameters, systems
from plumb.errors import LinkError, UsageError
from plumb.f103 import find_image
from plumb.f103.canbus import MachineBus
from plumb.f103.machine import Machine
from plumb.lockstep import sample_frames
from plumb.quantise import quantise
from plumb.session import Session

SAFE_US = 50_000
NEUTRAL_US = 1000.0
SILENCE = 1 << 5
LINKS = ["serial", "can"]
RUNS = ["REALTIME_LIVE", "REALTIME_INJECTED"]
QUAD_PERIOD_US, BALANCER_PERIOD_US = 5000, 10_000
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


def opened(machine: Machine, link: str) -> Session:
    return Session.over(MachineBus(machine)) if link == "can" else Session.open(machine.uart)


def drive(session: Session, run: str, period_us: int, raw: tuple[int, ...]) -> Callable[[bool], None]:
    """Begin and arm; returns what lets one period pass: True with the host alive, False with samples alone."""
    session.begin(run)
    numbers = count()

    def one_period(alive: bool) -> None:
        if run == "REALTIME_INJECTED":
            session.frames.write_frames(sample_frames(session.protocol, next(numbers), raw, 0, 0))
        if alive:
            session.receive(period_us * 1e-6)
        else:
            session.frames.read_frames(period_us * 1e-6)

    for _ in range(20):
        one_period(True)
    session.arm()
    for _ in range(20):
        one_period(True)
    return one_period


def fall_silent(machine: Machine, one_period: Callable[[bool], None], safe: Callable[[], bool]) -> float:
    """How long after the host's last keep-alive, or a little less, the outputs are safe; they must stay so."""
    assert not safe()
    begin_us = machine.now_us
    while not safe():
        one_period(False)
        assert machine.now_us - begin_us < 2 * SAFE_US
    took_us = machine.now_us - begin_us
    for _ in range(50):
        one_period(False)
        assert safe()
    return took_us


def assert_latched(session: Session, one_period: Callable[[bool], None], safe: Callable[[], bool]) -> None:
    """A host that is back, keep-alives and all, moves nothing, and is told why."""
    for _ in range(100):
        one_period(True)
        assert safe()
    assert session.telemetry["STATUS"]["armed"] == 0
    assert session.telemetry["EVENTS"]["disarm_cause"] == SILENCE


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("run", RUNS)
def test_the_pulses_of_quad(link: str, run: str) -> None:
    machine = Machine(find_image())
    at_rest(machine)
    machine.advance_us(30_000)
    session = opened(machine, link)
    session.upload(CONTROL, period_us=QUAD_PERIOD_US, arm_hold_ms=0)
    one_period = drive(session, run, QUAD_PERIOD_US, (1700, 2400, 3000))

    def safe() -> bool:
        return all(machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))

    assert fall_silent(machine, one_period, safe) < SAFE_US
    assert_latched(session, one_period, safe)
    assert machine.warnings == []


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("run", RUNS)
def test_the_bridge_of_balancer(link: str, run: str) -> None:
    balancer = Balancer(link)
    session = balancer.open()
    one_period = drive(session, run, BALANCER_PERIOD_US, (0, 80, 240, 0, 0, 0))
    assert fall_silent(balancer.machine, one_period, lambda: not balancer.driving) < SAFE_US
    assert_latched(session, one_period, lambda: not balancer.driving)
    assert balancer.machine.warnings == []


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("name", sorted(set(systems.SYSTEMS) - {"quad", "balancer"}))
def test_what_moves_nothing_cannot_be_armed(link: str, name: str) -> None:
    machine = Machine(find_image())
    machine.advance_us(30_000)
    system = systems.load(name)
    session = opened(machine, link)
    session.upload(list(quantise(system.TUNINGS[system.DEFAULT_TUNING]).values.values()), period_us=system.PERIOD_US)
    session.begin("REALTIME_INJECTED")
    with pytest.raises(LinkError):
        session.arm()
