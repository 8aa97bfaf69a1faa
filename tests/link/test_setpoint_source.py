"""A source of setpoints that falls silent while the actuator moves: the setpoint becomes 0 within 200 ms, which is
reported. On the flash image, over both links."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn")

from plumb.boards.virtual_can import MachineBus
from plumb.errors import LinkError
from plumb.f103.machine import Machine
from plumb.link.realtime import Capture
from plumb.link.session import Session
from support.sessions import CONTROL, STEER, booted, listen, opened

PERIOD_US = 5000
LIMIT_S = 0.2


class Reports:
    """SETPOINT_USED as it comes: when, and its words by name."""

    def __init__(self, session: Session) -> None:
        self._session, self._message = session, session.protocol["SETPOINT_USED"]
        self.received: list[tuple[float, dict[str, int]]] = []
        self.capture = Capture(session)
        session.listener = self.feed

    def feed(self, frames: list[tuple[int, bytes]]) -> None:
        self.capture.feed(frames)
        for identifier, data in frames:
            if identifier == self._message.identifier:
                self.received.append((self._session.clock(), self._message.decode(data)))


@pytest.fixture
def machine() -> Machine:
    return booted()


def flying(session: Session, hold_ms: int = 0) -> Reports:
    session.upload(CONTROL, period_us=PERIOD_US, esc_period_us=2500, arm_hold_ms=hold_ms)
    session.begin("REALTIME_LIVE")
    reports = Reports(session)
    session.arm()
    return reports


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_silent_source_sets_the_setpoint_to_0_and_is_reported(machine: Machine, link: str) -> None:
    session = opened(machine, link)
    reports = flying(session)
    listen(session, 0.1)
    session.set_setpoint(STEER)
    said_s = session.clock()
    session.setpoint.stop()  # a host that does not repeat it
    listen(session, 0.5)
    assert [(words["setpoint"], words["timed_out"], words["repeated"]) for _, words in reports.received] == [
        (STEER, 0, 0),
        (0, 1, 0),
    ]
    assert LIMIT_S < reports.received[1][0] - said_s < LIMIT_S + 0.02
    assert session.telemetry["STATUS"]["armed"] == 1  # it stays armed, level
    assert [value for _, value in reports.capture.setpoints.changes] == [0, STEER, 0]
    assert reports.capture.setpoints.doubt is None
    session.set_setpoint(STEER)  # received again, it counts again
    listen(session, 0.1)
    assert reports.received[-1][1]["setpoint"] == STEER


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_living_host_repeats_its_setpoint(machine: Machine, link: str) -> None:
    session = opened(machine, link)
    reports = flying(session)
    session.set_setpoint(STEER)
    listen(session, 1.0)
    assert {words["setpoint"] for _, words in reports.received} == {STEER}
    assert not any(words["timed_out"] for _, words in reports.received)
    assert [value for _, value in reports.capture.setpoints.changes] == [0, STEER]
    assert reports.capture.setpoints.doubt is None


@pytest.mark.slow
def test_silence_counts_only_while_the_actuator_may_move(machine: Machine) -> None:
    """Disarmed, and in the hold after arming, a setpoint stays; then it has 200 ms."""
    session = Session.open(machine.uart)
    reports = flying(session, hold_ms=500)
    session.disarm()
    session.set_setpoint(STEER)
    listen(session, 0.5)
    with pytest.raises(LinkError, match="the setpoint is not 0"):
        session.arm(ready_wait_s=0.0)
    session.set_setpoint(0)
    listen(session, 0.5)
    session.arm()
    armed_s = session.clock()
    session.set_setpoint(STEER)
    session.setpoint.stop()
    listen(session, 1.0)
    assert [words["timed_out"] for _, words in reports.received] == [0, 0, 0, 1]
    assert reports.received[3][0] - armed_s == pytest.approx(0.5 + LIMIT_S, abs=0.03)


@pytest.mark.slow
def test_the_source_is_the_link_that_was_named(machine: Machine) -> None:
    """The owner lives and says setpoints; the source it named does not."""
    session, other = Session.open(machine.uart), Session.over(MachineBus(machine))
    session.upload(CONTROL, period_us=PERIOD_US, esc_period_us=2500, arm_hold_ms=0)
    session.begin("REALTIME_LIVE", elsewhere=("setpoints",))
    reports = Reports(session)
    session.arm()
    other.run_tag = session.run_tag
    for _ in range(20):
        other.set_setpoint(STEER)
        listen(session, 0.05)
        other.receive(0.0)
    assert not any(words["timed_out"] for _, words in reports.received)
    for _ in range(6):
        session.set_setpoint(STEER)
        listen(session, 0.05)
        other.receive(0.0)
    assert reports.received[-1][1]["timed_out"] == 1
    assert session.telemetry["STATUS"]["armed"] == 1


def test_a_report_that_got_lost_puts_what_follows_in_doubt(machine: Machine) -> None:
    session = Session.open(machine.uart)
    reports = flying(session)
    listen(session, 0.1)
    session.listener = None
    session.set_setpoint(STEER)
    end_us = machine.now_us + 40_000.0
    while machine.now_us < end_us:
        session.receive(0.01)
    session.listener = reports.feed
    listen(session, 0.2)  # the repetitions say that the step before used the same
    assert reports.capture.setpoints.doubt == 0
