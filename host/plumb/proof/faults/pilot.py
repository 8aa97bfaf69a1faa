"""Who holds a receiver's sticks in a scene, a pilot or a rider: the receiver's frames at the pin of the simulated chip,
in the time of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.spec import crsf, declarations
from plumb.spec.system import FLIGHT, RIDE

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

PILOT = "pilot"
"""A feature: a pilot's receiver may arm it, and it flies."""
RIDER = "rider"
"""A feature: a rider's receiver may arm it, and it rolls."""
FRAME_S = 1.0 / 150.0
"""Between two frames of a receiver of 150 Hz."""
STANDS_S, HELD_S = 3.0, 2.4
"""Time before the switch: a vehicle stands on the ground, or a hand holds it upright for some time longer."""
SWITCH_S = 0.5
"""Longest time from the switch until the host hears that the board is armed."""
RIDES_S, RIDDEN = 1.5, 0.4
"""A rider goes ahead for so long, his stick of pitch at this share of its way."""
BATTERY_MIN_MV = 10_000
"""Of a battery of three cells."""


@dataclass
class Pilot:
    """says: throttle 0 to 1, and whether the motors are switched on; None: the receiver is silent. also: bytes that
    the receiver sends behind each of these frames; between: a switch position of every eighth frame, None: the same.
    pitch: of that stick, -1 to 1."""

    next_s: float
    says: tuple[float, bool] | None = (0.0, False)
    also: bytes = b""
    between: bool | None = None
    sent: int = 0
    pitch: float = 0.0

    def send_due(self, machine: Machine) -> None:
        """Send the frames that are due by now."""
        while machine.now_s >= self.next_s:
            self.next_s += FRAME_S
            if self.says is not None:
                throttle, on = self.says
                self.sent += 1
                if self.between is not None and self.sent % 8 == 0:
                    on = self.between
                machine.usart3.receive(crsf.sticks(throttle=throttle, pitch=self.pitch, on=on) + self.also)


def flies(system: str) -> bool:
    """Whether a pilot's receiver may arm the system, and it flies."""
    return declarations.system(system).checks == FLIGHT


def rides(system: str) -> bool:
    """Whether a rider's receiver may arm the system, and it rolls."""
    return declarations.system(system).checks == RIDE


def words(system: str) -> dict[str, int]:
    """Parameters of the board that a receiver arms."""
    return {"receiver": 1, "calibrated": 1} | ({"battery_min_mv": BATTERY_MIN_MV} if flies(system) else {})
