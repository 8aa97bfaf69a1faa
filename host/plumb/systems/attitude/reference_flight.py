"""Take-off, landing and the thrust of a hover in float64, once a block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray

MAYBE_LANDED_BLOCKS, LANDED_BLOCKS, TAKE_OFF_BLOCKS = 8, 67, 4
"""Carried blocks after which a vehicle may have landed, and has; blocks with the thrust of a hover that take it off."""
WEIGHT_G, HOVERS_G = (0.9, 1.1), (0.5, 4.0)
"""Length of the acceleration of a vehicle that the ground carries, and of one that determines the thrust of a hover."""
LIGHT, TAKE_OFF, IDLES = 0.75, 0.875, 0.375
"""Shares of the thrust of a hover: below the first the ground may carry it, from the second on it may take off; below
the third even the first seconds of a flight determine no hover."""
HOVER, COMMAND_MOST = (0.1, 0.85), 0.95
LIFTS_GS, FORGOTTEN = 0.03, 1.0 / 32.0
LEARNED_UP, LEARNED_DOWN, LEARNED_FIRST, FIRST_BLOCKS = 1.0 / 16.0, 1.0 / 32.0, 1.0 / 4.0, 16


@dataclass
class FlightOfBlocks:
    """thrust, hover: commands, 0 to 1; hover 0: unknown. climb_gs: vertical velocity."""

    hover: float = 0.0
    carried_blocks: int = LANDED_BLOCKS
    thrust_blocks: int = 0
    flown_blocks: int = 0
    weight_g: float = 1.0
    climb_gs: float = 0.0

    @property
    def landed(self) -> bool:
        return self.carried_blocks == LANDED_BLOCKS

    @property
    def airborne(self) -> bool:
        return self.carried_blocks < MAYBE_LANDED_BLOCKS

    def follow(self, mean_g: FloatArray, thrust: float, block_s: float, *, felt: bool) -> None:
        """One block. mean_g: acceleration in earth axes, (3,). felt: it ends below the accelerometer's limit."""
        felt_g, lifted_g = float(np.linalg.norm(mean_g)), float(np.clip(mean_g[2] - self.weight_g, -4.0, 4.0))
        weighs = felt and WEIGHT_G[0] <= felt_g <= WEIGHT_G[1]
        self.climb_gs = float(np.clip(self.climb_gs * (1.0 - FORGOTTEN) + lifted_g * block_s, -4.0, 4.0))
        if self.landed:
            self._wait(lifted_g if weighs else 0.0, thrust)
            return
        self.flown_blocks = min(self.flown_blocks + 1, 255)
        light = thrust < LIGHT * self.hover
        self.carried_blocks = self.carried_blocks + 1 if weighs and light else 0
        if thrust == 0.0 and not self.airborne:
            self.carried_blocks = LANDED_BLOCKS
        if not self.airborne:
            self.climb_gs = 0.0
        first = self.flown_blocks < FIRST_BLOCKS
        lifts = not light or (first and thrust >= IDLES * self.hover)
        if felt and lifts and HOVERS_G[0] <= felt_g <= HOVERS_G[1] and thrust <= COMMAND_MOST:
            at_1_g = thrust * felt_g ** (-2.0 / 3.0)
            share = LEARNED_FIRST if first else LEARNED_DOWN if at_1_g < self.hover else LEARNED_UP
            self.hover = float(np.clip(self.hover + share * (at_1_g - self.hover), *HOVER))

    def _wait(self, lifted_g: float, thrust: float) -> None:
        """On the ground."""
        self.weight_g += FORGOTTEN * lifted_g
        if thrust == 0.0:
            self.climb_gs = 0.0
        hovers = self.hover > 0.0 and thrust >= TAKE_OFF * self.hover
        self.thrust_blocks = min(self.thrust_blocks + 1, TAKE_OFF_BLOCKS) if hovers else 0
        if thrust > 0.0 and (self.thrust_blocks == TAKE_OFF_BLOCKS or abs(self.climb_gs) > LIFTS_GS):
            self.carried_blocks = self.thrust_blocks = self.flown_blocks = 0
            if self.hover == 0.0 or (self.climb_gs > 0.0 and thrust < self.hover):
                self.hover = float(np.clip(thrust, *HOVER))
