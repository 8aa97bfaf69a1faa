"""A vehicle's battery and the divider that brings its voltage to an analog input of the board.

Assumed: three lithium cells at 3.8 V, which lose 12 % under the full command of all motors.
"""

from __future__ import annotations

from dataclasses import dataclass

RAIL_V = 3.3
"""Full scale of the input."""
UPPER_KOHM, LOWER_KOHM = 47.0, 10.0
DIVIDER = (UPPER_KOHM + LOWER_KOHM) / LOWER_KOHM
SAG = 0.12
BATTERY_PIN = "PB0"
COUNTS = 4096


@dataclass
class Battery:
    """rest_v: its voltage without a load."""

    rest_v: float = 11.4

    def volts(self, share: float = 0.0) -> float:
        """Its voltage while the motors have this share of their full command, 0 to 1."""
        return self.rest_v * (1.0 - SAG * share)

    def input_v(self, share: float = 0.0) -> float:
        """At the input of the board, behind the divider; it does not leave the board's supply."""
        return min(max(self.volts(share) / DIVIDER, 0.0), RAIL_V)

    def counts(self, share: float = 0.0) -> int:
        """Count of the input."""
        return min(round(self.input_v(share) / RAIL_V * COUNTS), COUNTS - 1)
