"""The flash image as a balancer on the pins of the bridge, armed and driving: everything that must switch it off does,
and how soon. Looked at on the gates, not in the firmware."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (plumb[virtual])")
from plumb import systems
from plumb.errors import LinkError, UsageError
from plumb.f103 import Machine, find_image
from plumb.f103.adxl345 import Adxl345
from plumb.f103.itg3205 import Itg3205
from plumb.f103.timeline import TICKS_PER_US
from plumb.motor import FORWARD
from plumb.quantise import quantise
from plumb.session import Session
from sensor_bench import world

BOOT_US = 60_000
FAULT_BRIDGE, FAULT_HALL, FAULT_SENSOR = 0x10, 0x20, 0x40
CAUSE_FAULT, CAUSE_SILENCE, CAUSE_COMMAND, CAUSE_SWITCH = 1 << 3, 1 << 5, 1 << 6, 1 << 8
TURN_US = 1500
"""The loop comes round once a millisecond at least."""


class Balancer:
    """A machine that saved what makes it a balancer, and was switched on with everything wired."""

    def __init__(self) -> None:
        try:
            self.machine = machine = Machine(find_image())
        except UsageError as error:
            pytest.skip(str(error))
        machine.advance_us(BOOT_US)
        system = systems.load("balancer")
        words = quantise(system.TUNINGS[system.DEFAULT_TUNING]).values
        with Session.open(machine.uart) as session:
            session.upload(list(words.values()), period_us=system.PERIOD_US, pins=1, arm_hold_ms=0)
            session.execute("SAVE")
        machine.power_cut()
        machine.drive("PB12", True)
        machine.set_hall(FORWARD[0])
        leaning = world((0.3, 0.0, 0.95), 0.01, 1)
        machine.i2c_bus.slaves += [Itg3205(machine, world((0.0, 0.0, 0.0), 0.5, 2)), Adxl345(machine, leaning)]
        machine.tim1.trace = []
        machine.power_on()
        machine.advance_us(BOOT_US)
        self.session: Session | None = None

    def arm(self) -> None:
        if self.session is not None:
            self.session.close()
        self.session = Session.open(self.machine.uart)
        self.session.begin("REALTIME_LIVE")
        self.keep_alive(0.2)
        self.session.arm()
        self.keep_alive(0.05)
        assert self.driving

    def keep_alive(self, seconds: float) -> None:
        assert self.session is not None
        end_s = self.session.clock() + seconds
        while self.session.clock() < end_s:
            self.session.receive(0.005)

    def switched_off(self) -> float | None:
        """When the last gate that was on went off, in us; None while one is on."""
        machine = self.machine
        machine.tim1.settle(machine.now)
        on: set[tuple[int, str]] = set()
        last = 0
        for edge in machine.tim1.trace or []:
            gate = edge.phase, edge.side
            if edge.on:
                on.add(gate)
            elif gate in on:
                on.remove(gate)
                last = edge.time
        return None if on else last / TICKS_PER_US

    @property
    def driving(self) -> bool:
        return self.switched_off() is None

    def off_after_us(self, limit_us: int) -> float:
        """How long from now until every gate is off for good, within the limit."""
        begin_us = self.machine.now_us
        self.machine.advance_us(limit_us)
        off_us = self.switched_off()
        assert off_us is not None
        return max(0.0, off_us - begin_us)

    def why(self) -> tuple[int, int]:
        """What ended the last armed time, and the faults, as the board tells them."""
        assert self.session is not None
        self.session.connect()
        self.session.telemetry.clear()
        while "EVENTS" not in self.session.telemetry or "STATUS" not in self.session.telemetry:
            self.session.receive(0.05)
        return self.session.telemetry["EVENTS"]["disarm_cause"], self.session.telemetry["STATUS"]["faults"] & 0xFF


@pytest.fixture
def rider() -> Balancer:
    balancer = Balancer()
    balancer.arm()
    return balancer


def test_armed_it_drives_and_the_duty_follows_the_lean(rider: Balancer) -> None:
    machine = rider.machine
    shares = [share for share in machine.bridge().duty if share]
    assert machine.bridge().enabled and len(shares) == 1
    edges = machine.tim1.trace or []
    assert np.unique([edge.phase for edge in edges if edge.on]).size == 2  # state 5: A against B
    assert machine.warnings == []


def test_disarming_switches_off_within_a_turn(rider: Balancer) -> None:
    assert rider.session is not None
    rider.session.disarm()
    assert rider.off_after_us(20_000) < TURN_US
    assert rider.why() == (CAUSE_COMMAND, 0)


def test_silence_switches_off_within_50_ms(rider: Balancer) -> None:
    assert 20_000 < rider.off_after_us(60_000) + 15_000 < 50_000 + 15_000
    assert rider.off_after_us(500_000) == 0
    assert rider.why() == (CAUSE_SILENCE, 0)


def test_a_break_switches_off_at_once_is_told_and_needs_a_new_run(rider: Balancer) -> None:
    rider.machine.drive("PB12", False)
    assert not rider.machine.bridge().enabled
    assert rider.off_after_us(1000) == 0
    rider.machine.drive("PB12", True)  # the driver recovers by itself; the board does not
    assert rider.off_after_us(100_000) == 0
    assert rider.why() == (CAUSE_FAULT, FAULT_BRIDGE)
    with pytest.raises(LinkError, match="the board has a fault"):
        assert rider.session and rider.session.arm()
    rider.arm()


def test_a_hall_wire_that_falls_off_switches_off_with_the_next_step(rider: Balancer) -> None:
    rider.machine.set_hall(7)
    assert rider.off_after_us(15_000) < 10_000 + TURN_US
    assert rider.why() == (CAUSE_FAULT, FAULT_HALL)


def test_a_sensor_that_is_lost_switches_off(rider: Balancer) -> None:
    rider.machine.i2c_bus.slaves.clear()
    assert rider.off_after_us(45_000) < 40_000
    assert rider.why()[0] == CAUSE_FAULT and rider.why()[1] & FAULT_SENSOR


def test_every_kind_of_reset_switches_off_at_once_and_stays_off(rider: Balancer) -> None:
    machine = rider.machine
    for reset in (machine.reset, lambda: machine.request_reset("iwdg"), lambda: machine.request_reset("software")):
        reset()
        machine.advance_us(1)
        assert not rider.driving
        begin = machine.now
        machine.advance_us(200_000)
        assert not any(edge.on for edge in machine.tim1.trace or [] if edge.time > begin)
        rider.arm()


def test_a_dying_crystal_switches_off_before_any_instruction(rider: Balancer) -> None:
    instructions = rider.machine.cpu.instructions
    rider.machine.rcc.kill_crystal()
    assert not rider.machine.bridge().enabled and rider.machine.cpu.instructions == instructions
    assert rider.off_after_us(300_000) == 0


def test_the_handle_alone_is_enough_and_letting_go_is_at_once() -> None:
    balancer = Balancer()
    balancer.machine.drive("PC14", False)
    balancer.machine.advance_us(250_000)
    assert balancer.driving
    balancer.machine.advance_us(1_000_000)
    assert balancer.driving
    balancer.machine.drive("PC14", None)
    assert balancer.off_after_us(50_000) < TURN_US
