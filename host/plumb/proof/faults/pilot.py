"""The pilot of a scene: his receiver's frames at the pin of the simulated chip, in the time of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.spec import crsf

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

FRAME_S = 1.0 / 150.0
"""Between two frames of a receiver of 150 Hz."""


@dataclass
class Pilot:
    """says: throttle 0 to 1, and whether the rotors are switched on; None: the receiver is silent. also: bytes that
    the receiver sends behind each of these frames; between: a switch position of every eighth frame, None: the same."""

    next_s: float
    says: tuple[float, bool] | None = (0.0, False)
    also: bytes = b""
    between: bool | None = None
    sent: int = 0

    def send_due(self, machine: Machine) -> None:
        """Send the frames that are due by now."""
        while machine.now_s >= self.next_s:
            self.next_s += FRAME_S
            if self.says is not None:
                throttle, on = self.says
                self.sent += 1
                if self.between is not None and self.sent % 8 == 0:
                    on = self.between
                machine.usart3.receive(crsf.sticks(throttle=throttle, on=on) + self.also)
