"""A radio receiver with a pulse train (PPM) in place of a serial line, on a simulated board.

It takes the frames of CRSF that another receiver would send, and plays the newest one as pulses, one frame every
22.5 ms at most. While the link statistics say a quality of 0 it plays its failsafe, and without frames nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from plumb.f103.core.timeline import TICKS_PER_US
from plumb.spec import crsf, ppm

if TYPE_CHECKING:
    from plumb.boards.native.mcu import NativeMcu
    from plumb.f103.machine import Machine

PIN = "PA8"


class PulseTrain:
    """now_us: the board's time; play: takes the instants of the rising edges of a frame, in order."""

    def __init__(self, now_us: Callable[[], int], play: Callable[[Sequence[int]], None]) -> None:
        self._now_us, self._play = now_us, play
        self._reader = crsf.Reader()
        self._lost = False
        self._next_us = 0

    def receive(self, data: bytes) -> None:
        """Bytes of CRSF, now."""
        for kind, payload in self._reader.push(data):
            if kind == crsf.STATISTICS:
                self._lost = crsf.link_quality(payload) == 0
                continue
            now_us = self._now_us()
            if now_us >= self._next_us:
                self._next_us = now_us + ppm.FRAME_US
                widths = ppm.widths_us(crsf.values(payload), lost=self._lost)
                self._play([now_us + edge for edge in ppm.edges_us(widths)])


def on_pin(machine: Machine) -> PulseTrain:
    """On PA8 of a simulated chip."""

    def play(edges_us: Sequence[int]) -> None:
        changes = [(at + later, level) for at in edges_us for later, level in ((0, True), (ppm.PULSE_US, False))]

        def change(_time: int) -> None:
            _, level = changes.pop(0)
            machine.drive(PIN, level)
            if changes:
                machine.timeline.at("receiver", changes[0][0] * TICKS_PER_US, change)

        machine.timeline.at("receiver", max(changes[0][0] * TICKS_PER_US, machine.now), change)

    return PulseTrain(lambda: -(-machine.now // TICKS_PER_US), play)


def on_native(mcu: NativeMcu) -> PulseTrain:
    """On the native board."""

    def play(edges_us: Sequence[int]) -> None:
        for at_us in edges_us:
            mcu.receiver_edge(at_us)

    return PulseTrain(lambda: mcu.now_us, play)
