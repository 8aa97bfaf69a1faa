"""The three-phase bridge: the port's own driver on the model of TIM1 and TIM2, every edge of every output looked at."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.peripherals.tim1 import HIGH_PINS, LOW_PINS, MOE, Edge
from plumb.physics.motor import FORWARD, share_of_supply
from support.f103_program import RunningProgram

ARM, DUTY, OFF, CLEAR, RAPID = 1, 2, 3, 4, 5
FAULT_BRIDGE, FAULT_HALL = 0x10, 0x20
NO_BREAK = True
"""Level of PB12 while all is well."""
START_US = 5000


class Driver(RunningProgram):
    """The program bridge.c: rotor in state 5, bridge fed, driver happy; every edge is traced from power-up on."""

    def __init__(self, elf: Path, dead_time_ns: int = 1000, **options: object) -> None:
        super().__init__(elf, **options)
        machine = self.machine
        machine.tim1.trace = []
        machine.drive("PB12", NO_BREAK)
        machine.set_hall(5)
        self.ask(1, dead_time_ns)
        machine.advance_us(START_US if options.get("crystal", True) else 200_000)
        self.say(CLEAR)

    def say(self, command: int, duty: int = 0) -> None:
        self.ask(2, duty & 0xFFFFFFFF)
        self.ask(0, command)
        turns = self.result(5)
        assert self.machine.run_until(lambda: self.result(0) == 0 and self.result(5) != turns, 1000)

    def hall(self, state: int, rest_us: float = 200) -> None:
        self.machine.set_hall(state)
        self.machine.advance_us(rest_us)

    @property
    def trace(self) -> list[Edge]:
        trace = self.machine.tim1.trace
        assert trace is not None
        self.machine.tim1.settle(self.machine.now)
        return trace

    @property
    def faults(self) -> int:
        self.machine.advance_us(50)
        return self.result(4)

    @property
    def count(self) -> int:
        self.machine.advance_us(50)
        return self.result(3) - (self.result(3) >> 31 << 32)


@pytest.fixture
def driver(build: Callable[[str], Path]) -> Callable[..., Driver]:
    return lambda **options: Driver(build("bridge"), **options)


def smallest_gap_ns(edges: Iterable[Edge]) -> float:
    """Over every phase: from one side of it going off until the other goes on. Both on at once is a failure."""
    smallest = float("inf")
    for phase in range(3):
        on, off_at = {"high": False, "low": False}, {"high": -1e18, "low": -1e18}
        for edge in (edge for edge in edges if edge.phase == phase):
            other = "low" if edge.side == "high" else "high"
            if edge.on and not on[edge.side]:
                assert not on[other], f"both switches of phase {phase} are on at {edge.time}"
                smallest = min(smallest, (edge.time - off_at[other]) / TICKS_PER_US * 1000)
            elif not edge.on and on[edge.side]:
                off_at[edge.side] = edge.time
            on[edge.side] = bool(edge.on)
    return smallest


@pytest.mark.parametrize("dead_time_ns", [200, 1000, 1763, 1764, 1790, 3500])
def test_no_edge_of_a_wild_ride_shoots_through(driver: Callable[..., Driver], dead_time_ns: int) -> None:
    """Both directions, signs that change, jumps of the rotor, contacts that ring, arming and disarming in between."""
    board, chance = driver(dead_time_ns=dead_time_ns), random.Random(dead_time_ns)
    place = 0
    board.say(ARM)
    for _ in range(150):
        kind = chance.randrange(10)
        if kind < 4:
            board.say(DUTY, chance.randint(-32767, 32767))
        elif kind < 8:
            place += chance.choice((1, 1, 1, -1, -1, 2, 3))
            board.hall(FORWARD[place % 6], chance.uniform(0, 60))
        elif kind < 9:
            for _ in range(chance.randrange(6)):
                board.hall(FORWARD[(place + chance.randrange(2)) % 6], chance.uniform(0, 5))
            board.hall(FORWARD[place % 6], 40)
        else:
            board.say(OFF)
            board.say(CLEAR)
            board.say(ARM)
    edges = board.trace
    assert sum(edge.on is True for edge in edges) > 200
    assert dead_time_ns <= smallest_gap_ns(edges) < dead_time_ns + 60, "rounded up to two steps of the clock at most"
    assert board.faults == 0 and board.machine.warnings == []


def test_a_phase_that_floats_for_a_moment_keeps_the_dead_time_too(driver: Callable[..., Driver]) -> None:
    """Low side on, floating, high side on: the timer keeps no dead time there, and commutations can come faster."""
    board, chance = driver(dead_time_ns=3500), random.Random(7)
    board.say(ARM)
    place = 0
    for duty in (30_000, -30_000):
        for _ in range(20):
            board.ask(2, duty & 0xFFFFFFFF)
            board.ask(0, RAPID)
            for _ in range(60):
                place += 1
                board.hall(FORWARD[place % 6], chance.uniform(0.5, 2))
    assert sum(edge.on is True for edge in board.trace) > 200
    assert smallest_gap_ns(board.trace) >= 3500


def test_from_power_up_to_arming_no_switch_goes_on(driver: Callable[..., Driver]) -> None:
    board = driver()
    board.say(DUTY, 20_000)
    board.hall(FORWARD[1])
    assert not any(edge.on for edge in board.trace)
    assert board.machine.bridge() == ((None, None, None), False)
    board.say(ARM)
    board.say(DUTY, 20_000)
    board.machine.advance_us(100)
    assert any(edge.on for edge in board.trace)


def test_armed_or_not_the_timer_drives_every_gate(driver: Callable[..., Driver]) -> None:
    """Never left floating once the pins are set up: a phase that floats, and all of them when off, are driven low."""
    board = driver()
    begin = board.machine.now
    for command in (ARM, OFF, ARM):
        board.say(command)
        for state in FORWARD:
            board.hall(state)
    assert not [edge for edge in board.trace if edge.time > begin and edge.on is None]
    for pin in HIGH_PINS + LOW_PINS:
        assert board.machine.port(pin).is_alternate_output(int(pin[2:]))


@pytest.mark.parametrize("duty", [3277, 16384, 29491, 32767, -16384])
def test_frequency_duty_and_dead_time_of_the_waveform(driver: Callable[..., Driver], duty: int) -> None:
    """In state 5 phase A is switched for positive duty, against phase B held low; C floats."""
    board = driver(dead_time_ns=500)
    board.say(ARM)
    board.say(DUTY, duty)
    board.machine.advance_us(100)
    begin = len(board.trace)
    board.machine.advance_us(1000)
    switched = 0 if duty > 0 else 1
    edges = [edge for edge in board.trace[begin:] if edge.phase == switched]
    assert {edge.phase for edge in board.trace[begin:]} == {switched}
    rising = [edge.time for edge in edges if edge.side == "high" and edge.on]
    assert {later - earlier for earlier, later in pairwise(rising)} == {50 * TICKS_PER_US}
    high_us = [(b.time - a.time) / TICKS_PER_US for a, b in pairwise(e for e in edges if e.side == "high") if a.on]
    low_us = [(b.time - a.time) / TICKS_PER_US for a, b in pairwise(e for e in edges if e.side == "low") if a.on]
    wanted_us = min(abs(duty) / 32768 * 50, 50 - 2 * 0.5 - 1)
    # Duty and dead time are whole steps of the clock, 14 ns, and of two: four of them.
    assert max(high_us) == pytest.approx(wanted_us - 0.5, abs=0.06)
    assert min(low_us) >= 1.0  # always time to fill the bootstrap capacitors
    shares = board.machine.bridge().duty
    # A period is 3600 steps of the clock: 0.0003 each, three of them.
    assert shares[switched] == pytest.approx(wanted_us / 50, abs=0.001)
    assert shares[1 - switched] == 0.0 and shares[2] is None


def test_every_hall_state_drives_the_way_that_the_duty_says(driver: Callable[..., Driver]) -> None:
    board = driver()
    board.say(ARM)
    for duty in (16384, -16384):
        board.say(DUTY, duty)
        for place, state in enumerate(FORWARD):
            board.hall(state)
            for part in (0.1, 0.5, 0.9):
                share = share_of_supply(board.machine.bridge().duty, (place + part) / 6)
                # A period is 3600 steps of the clock: 0.0003 each, three of them.
                assert share == pytest.approx(duty / 32768, abs=0.001)


def test_the_break_input_acts_without_an_instruction(driver: Callable[..., Driver]) -> None:
    board = driver()
    machine = board.machine
    board.say(ARM)
    board.say(DUTY, 16384)
    machine.advance_us(137)
    now, instructions = machine.now, machine.cpu.instructions
    assert machine.tim1.bdtr & MOE
    machine.drive("PB12", not NO_BREAK)
    assert (machine.now, machine.cpu.instructions) == (now, instructions)
    assert not machine.tim1.bdtr & MOE and machine.bridge() == ((None, None, None), False)
    assert board.trace[-1].time == now
    on = {(edge.phase, edge.side): edge.on for edge in board.trace}
    assert not any(on.values())


def test_a_broken_wire_to_the_break_input_breaks(driver: Callable[..., Driver]) -> None:
    board = driver()
    board.say(ARM)
    board.machine.drive("PB12", None)  # the pin's own pull-down is left
    assert not board.machine.bridge().enabled


def test_after_a_break_only_arming_switches_on_again(driver: Callable[..., Driver]) -> None:
    board = driver()
    board.say(ARM)
    board.machine.drive("PB12", not NO_BREAK)
    assert board.faults == FAULT_BRIDGE
    board.say(CLEAR)
    assert board.faults == FAULT_BRIDGE  # it is still so
    board.say(ARM)
    assert not board.machine.bridge().enabled  # nor does arming help
    board.machine.drive("PB12", NO_BREAK)
    for state in FORWARD:
        board.say(DUTY, 20_000)
        board.hall(state)
    board.machine.advance_us(10_000)
    assert not board.machine.bridge().enabled
    assert board.faults == FAULT_BRIDGE  # reported until it is cleared
    board.say(CLEAR)
    assert board.faults == 0 and not board.machine.bridge().enabled
    board.say(ARM)
    assert board.machine.bridge().enabled


def test_a_dying_crystal_breaks_too(driver: Callable[..., Driver]) -> None:
    board = driver()
    board.say(ARM)
    instructions = board.machine.cpu.instructions
    board.machine.rcc.kill_crystal()
    assert not board.machine.bridge().enabled
    assert board.machine.cpu.instructions == instructions


def test_break_and_dead_time_cannot_be_written_away(driver: Callable[..., Driver]) -> None:
    board = driver()
    tim1 = board.machine.tim1
    before = tim1.bdtr
    tim1.write_bdtr(0)
    assert tim1.bdtr == before
    tim1.write_bdtr(0xFFFF & ~MOE)
    assert tim1.bdtr == before  # no automatic output enable either


@pytest.mark.parametrize("state", [0, 7])
def test_a_hall_state_that_cannot_be_switches_off_until_it_is_cleared(
    driver: Callable[..., Driver], state: int
) -> None:
    board = driver()
    board.say(ARM)
    board.say(DUTY, 20_000)
    assert board.machine.bridge().enabled
    board.hall(state)
    board.say(DUTY, 20_000)  # state 7 is no edge of the exclusive or: the next step's duty notices
    assert not board.machine.bridge().enabled and board.faults == FAULT_HALL
    board.hall(3)
    board.say(DUTY, 10_000)
    board.say(ARM)
    assert not board.machine.bridge().enabled and board.faults == FAULT_HALL
    board.say(CLEAR)
    board.say(ARM)
    assert board.machine.bridge().enabled and board.faults == 0


def test_hall_edges_are_counted_with_their_sign(driver: Callable[..., Driver]) -> None:
    board = driver()
    for turn in range(3):
        for state in (*FORWARD[1:], FORWARD[0]):
            board.hall(state, 50)
        assert board.count == 6 * (turn + 1)
    for state in reversed(FORWARD):
        board.hall(state, 50)
    assert board.count == 12
    for state in (*reversed(FORWARD), *reversed(FORWARD), *reversed(FORWARD)):
        board.hall(state, 50)
    assert board.count == -6


def test_spikes_on_the_hall_lines_are_filtered(driver: Callable[..., Driver]) -> None:
    board = driver()
    for _ in range(50):
        board.hall(1, 14)
        assert board.result(3) == 0, "forward and back again would cancel in the count"
        board.hall(5, 1)
    assert board.count == 0
    board.hall(1, 15)
    assert board.count == 1


def test_without_a_crystal_the_dead_time_is_kept_too(driver: Callable[..., Driver]) -> None:
    board = driver(crystal=False, dead_time_ns=1000)
    board.say(ARM)
    for state in FORWARD:
        board.say(DUTY, 15_000)
        board.hall(state)
        board.say(DUTY, -15_000)
    # Rounded up to two steps of the clock, of 16 ns, at most, and the next edge of it.
    assert 1000 <= smallest_gap_ns(board.trace) < 1060
