"""The native board over its UART, in this process: the shipped main loop on simulated hardware, with a plant.

Simulated time passes only while the host waits for an answer, so that two runs give the same bytes.
"""

from __future__ import annotations

from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.boards.native.mcu import NativeUart
from plumb.boards.native.served import ServedNative, open_native
from plumb.contract.scenario import Plant
from plumb.link.session import Session


class FollowingUart(NativeUart):
    """The UART of a board whose plant advances together with simulated time."""

    def __init__(self, served: ServedNative) -> None:
        super().__init__(served.mcu)
        self._served = served

    def pass_us(self, time_us: int) -> None:
        end_us = self._mcu.now_us + time_us
        while (left_us := end_us - self._mcu.now_us) > 0:
            super().pass_us(min(left_us, self._served.let_follow()))


class NativePort(LinkBoard):
    """A board that starts as a system, with the tuning for its own sensors and a plant on its wires. Without a plant
    the wires keep their values."""

    def __init__(self, system: str, plant: Plant | None) -> None:
        self.served = open_native(systems.load(system).LINK.get("pins", 0), b"", system, plant)
        self.mcu = self.served.mcu
        self.uart = FollowingUart(self.served)
        super().__init__("native", Session.open(self.uart))
