"""The flash image as a balancer on the pins of the bridge, armed and driving: everything that must switch it off does,
and how soon. Looked at on the gates, not in the firmware."""

from __future__ import annotations

import random

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.errors import LinkError
from plumb.f103.core.timeline import TICKS_PER_US
from support.balancer_bench import BOOT_US, Balancer
from support.campaigns import campaign
from support.kept import as_made
from support.power import lose_power

FAULT_BRIDGE, FAULT_HALL, FAULT_SENSOR = 0x10, 0x20, 0x40
CAUSE_FAULT, CAUSE_SILENCE, CAUSE_COMMAND, CAUSE_SWITCH = 1 << 3, 1 << 5, 1 << 6, 1 << 8
TURN_US = 1500
"""The loop comes round once a millisecond at least."""


@pytest.fixture
def rider() -> Balancer:
    return as_made("armed bridge", armed_bridge)


def armed_bridge() -> Balancer:
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
    # The promise, and no sooner than a value that was answered may be late: then it would be another cause.
    assert 5_000 < rider.off_after_us(60_000) < 50_000
    assert rider.off_after_us(500_000) == 0
    assert rider.why() == (CAUSE_SILENCE, 0)


@pytest.mark.slow
def test_a_break_switches_off_at_once_is_reported_and_needs_a_new_run(rider: Balancer) -> None:
    rider.machine.drive("PB12", False)
    assert not rider.machine.bridge().enabled
    assert rider.off_after_us(1000) == 0
    rider.machine.drive("PB12", True)  # the driver recovers by itself; the board does not
    assert rider.off_after_us(100_000) == 0
    assert rider.why() == (CAUSE_FAULT, FAULT_BRIDGE)
    assert rider.session is not None
    with pytest.raises(LinkError, match="the board has a fault"):
        rider.session.arm()
    rider.arm()


def test_a_hall_wire_that_falls_off_switches_off_with_the_next_step(rider: Balancer) -> None:
    rider.machine.set_hall(7)
    assert rider.off_after_us(15_000) < 10_000 + TURN_US
    assert rider.why() == (CAUSE_FAULT, FAULT_HALL)


def test_a_sensor_that_is_lost_switches_off(rider: Balancer) -> None:
    rider.machine.i2c_bus.slaves.clear()
    # Found with the next sample, 10 ms, whose accesses end within 2 ms each.
    assert rider.off_after_us(45_000) < 10_000 + 2 * 2_000 + TURN_US
    assert rider.why()[0] == CAUSE_FAULT and rider.why()[1] & FAULT_SENSOR


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("brown", [False, True], ids=["power cut", "brown-out"])
def test_power_loss_at_any_cycle_switches_the_bridge_off(brown: bool) -> None:
    """With I2C, Hall sensors, bridge and CAN all at work; and the next start can be armed like the first."""
    balancer, chance = Balancer.as_made("can"), random.Random(9)
    machine = balancer.machine
    for _ in range(campaign(2, 10)):
        balancer.arm()
        machine.run_to(machine.now + chance.randrange(20_000 * TICKS_PER_US))
        lose_power(machine, brown)
        machine.advance_us(1)
        assert not balancer.driving
        begin = machine.now
        machine.advance_us(BOOT_US)
        assert not any(edge.on for edge in machine.tim1.trace or [] if edge.time > begin)
        balancer.session = None
    assert machine.warnings == []


def test_a_dying_crystal_switches_off_before_any_instruction(rider: Balancer) -> None:
    instructions = rider.machine.cpu.instructions
    rider.machine.rcc.kill_crystal()
    assert not rider.machine.bridge().enabled and rider.machine.cpu.instructions == instructions
    assert rider.off_after_us(300_000) == 0


@pytest.mark.slow
def test_the_handle_alone_is_enough_and_letting_go_is_at_once() -> None:
    balancer = Balancer.as_made()
    balancer.machine.drive("PC14", False)
    balancer.machine.advance_us(1_000_000)  # at rest for 0.6 s first
    assert balancer.driving
    balancer.machine.advance_us(1_000_000)
    assert balancer.driving
    balancer.machine.drive("PC14", None)
    assert balancer.off_after_us(50_000) < TURN_US
