"""The native board over its UART, in this process: the shipped main loop on simulated hardware, with a plant.

Simulated time passes only while the host waits for an answer, so that two runs give the same bytes.
"""

from __future__ import annotations

import functools

from plumb import systems
from plumb.boards import plant_on_pins
from plumb.boards.link import LinkBoard
from plumb.boards.native_mcu import NativeUart
from plumb.boards.native_served import ServedNative, open_native
from plumb.link.session import Session
from plumb.systems.contracts import PINS, Plant, fitted, link_words
from plumb.tuning.quantise import quantise


class FollowingUart(NativeUart):
    """The UART of a board whose plant follows while time passes."""

    def __init__(self, served: ServedNative) -> None:
        super().__init__(served.mcu)
        self._served = served

    def pass_us(self, time_us: int) -> None:
        end_us = self._mcu.now_us + time_us
        while (left_us := end_us - self._mcu.now_us) > 0:
            super().pass_us(min(left_us, self._served.let_follow()))


class NativePort(LinkBoard):
    """A board that comes up as a system, with the tuning for its own sensors and a plant on its wires; without one its
    wires stay as they are."""

    runs_on = "the native port"
    slow_remedy = "this machine is too slow or too busy for it"

    def __init__(self, system: str, plant: Plant | None) -> None:
        self.served = open_native(systems.load(system).LINK.get("pins", 0), b"", system, plant)
        self.mcu = self.served.mcu
        super().__init__("native", Session.open(FollowingUart(self.served)))


class PlantOfNativeRuns:
    """A plant that stands anew at the beginning of every run of a NativePort of the same system."""

    def __init__(self, system: str, scenario: str | None, seed: int, *, open_loop: bool) -> None:
        self._choice = functools.partial(plant_on_pins.plant_of, system, scenario, seed, open_loop=open_loop)
        self._choice()  # raises UsageError for a name that there is not
        self._system = system
        self._configured = False

    def attach(self, board: LinkBoard) -> None:
        """Put the plant on the wires; the first time, configure the board for the scenario."""
        assert isinstance(board, NativePort)
        chosen, plant = self._choice()
        if not self._configured:
            self._configured = True
            system = systems.load(self._system)
            params = quantise(fitted(chosen, system.TUNINGS[systems.load(self._system, PINS).TUNING]))
            words = {**params.link_words(), **link_words(system, chosen), "period_us": chosen.period_us}
            board.session.upload(params.words(), **words)
        board.served.attach(plant)
