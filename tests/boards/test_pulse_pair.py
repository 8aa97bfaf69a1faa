"""Both pulses of a frame belong to one step: on the flash image, with the end of the frame between the two writes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("unicorn")

from plumb.errors import UsageError
from plumb.f103.machine import Machine
from plumb.flash.image import find_image
from plumb.link.session import Session
from plumb.spec import parameters
from support.pins import at_rest

CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 30_000
CCR1, CCR2 = 0x40000834, 0x40000838


class Watched:
    """The image on the virtual board. written: pairs of compare values after each write of the second; begun: pairs
    that a frame began with, in half-microseconds. tear(): from now on the frame ends right behind every write of
    the first."""

    def __init__(self) -> None:
        try:
            self.machine = machine = Machine(find_image())
        except UsageError as error:
            pytest.skip(str(error))
        at_rest(machine)
        self.written: set[tuple[int, int]] = set()
        self.begun: list[tuple[int, int]] = []
        self._tears = False
        preload = machine.tim4._preload

        def frame() -> None:
            preload()
            self.begun.append((machine.tim4.active_ccr[0], machine.tim4.active_ccr[1]))

        machine.tim4._preload = frame  # type: ignore[method-assign]
        (timer, first), (_, second) = machine.bus.writers[CCR1], machine.bus.writers[CCR2]
        machine.bus.writers[CCR1] = timer, lambda value: self._first(first, value)
        machine.bus.writers[CCR2] = timer, lambda value: self._second(second, value)
        machine.advance_us(BOOT_US)

    def tear(self) -> None:
        self._tears = True
        self.begun.clear()

    def _first(self, write: Callable[[int], None], value: int) -> None:
        write(value)
        if self._tears:
            timer = self.machine.tim4
            timer.zero_at = self.machine.now + 1 - timer.period_ticks

    def _second(self, write: Callable[[int], None], value: int) -> None:
        write(value)
        self.written.add((self.machine.tim4.ccr1, self.machine.tim4.ccr2))


def test_a_frame_that_ends_between_the_two_writes_keeps_the_pair_before() -> None:
    """Both pulses change in the same frame: without update disable the first is a frame ahead of the second."""
    board = Watched()
    session = Session.open(board.machine.uart)
    session.upload(CONTROL, period_us=3000, esc_period_us=2500, arm_hold_ms=0)
    session.begin("REALTIME_LIVE")
    session.arm()
    for _ in range(10):
        session.receive(0.005)
    board.tear()
    for _ in range(20):
        session.receive(0.005)
    assert len(set(board.begun)) > 5, "the pulses follow the noise of the sensors"
    assert set(board.begun) <= board.written
    session.disarm()
    board.machine.advance_us(10_000)
    board.machine.pwm("PB6")
    assert set(board.begun) <= board.written
    assert board.begun[-1] == (2000, 2000)
