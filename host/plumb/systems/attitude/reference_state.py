"""What the float64 model of `attitude` remembers: samples of a block, its sums, and the filter between two steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.attitude.reference_flight import FlightOfBlocks

VARIANCE_LIMIT = 0.2
VELOCITY_ADDED_G2S2 = 0.2
DONE, CORRECTS, JUDGES = range(3)
"""What is left to do of the last block: one of it a step."""


@dataclass
class Sums:
    """What the filter needs of a block: sums of half angles (3,), of their squares, of the acceleration in earth axes
    (3,) and of the part along the body's z (2,), of the rows of the attitude's matrix (2, 3), of those by the half
    angles (2, 3); whether it moved; thrust: the last command; variances by gaps and by samples at a limit."""

    half: FloatArray = field(default_factory=lambda: np.zeros(3))
    square: float = 0.0
    force: FloatArray = field(default_factory=lambda: np.zeros(3))
    thrust_force: FloatArray = field(default_factory=lambda: np.zeros(2))
    rows: FloatArray = field(default_factory=lambda: np.zeros((2, 3)))
    turned: FloatArray = field(default_factory=lambda: np.zeros((2, 3)))
    moved: bool = False
    thrust: float = 0.0
    tilt_added_rad2: float = 0.0
    velocity_added_g2s2: float = 0.0

    def add_variance(self, tilt_rad2: float, velocity_g2s2: float) -> None:
        self.tilt_added_rad2 = min(self.tilt_added_rad2 + tilt_rad2, VARIANCE_LIMIT)
        self.velocity_added_g2s2 = min(self.velocity_added_g2s2 + velocity_g2s2, VELOCITY_ADDED_G2S2)


@dataclass
class Filter:
    """One run's state between two steps. correction: of the last measured block, applied after the end of the next;
    transition, growth, mean_radps: of the last block;
    turning_rad: low-pass of the half angles of a block about horizontal axes; held_blocks: in which the gyro alone
    turned; rested: since the start; sums: of the block so far, block_step its steps."""

    covariance: FloatArray
    attitude: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    bias_radps: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale: FloatArray = field(default_factory=lambda: np.zeros(3))
    velocity_gs: FloatArray = field(default_factory=lambda: np.zeros(2))
    square_g2s2: float = 0.0
    correction: FloatArray = field(default_factory=lambda: np.zeros(10))
    tilt_rad2: float = 0.0
    upwards_gs: float = 0.0
    half_before: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_before: FloatArray = field(default_factory=lambda: np.zeros(3))
    half_mean: FloatArray = field(default_factory=lambda: np.zeros(3))
    force_before: FloatArray = field(default_factory=lambda: np.zeros(3))
    travel_gs: FloatArray = field(default_factory=lambda: np.zeros(2))
    travel_excess_g2s2: float = 0.0
    corrected_rad: FloatArray = field(default_factory=lambda: np.zeros(2))
    rise_g: float = 0.0
    turning_rad: float = 0.0
    held_blocks: int = 0
    rested: bool = False
    measured_gs: FloatArray = field(default_factory=lambda: np.zeros(2))
    flight: FlightOfBlocks = field(default_factory=FlightOfBlocks)
    aided: bool = False
    gap: int = 0
    runs: list[int] = field(default_factory=lambda: [0, 0])
    slopes: list[float] = field(default_factory=lambda: [0.0, 0.0])
    still_blocks: int = 0
    aligned_blocks: int = 0
    started: bool = False
    sums: Sums = field(default_factory=Sums)
    block_step: int = 0
    left: int = DONE
    bridged: bool = False
    transition: FloatArray = field(default_factory=lambda: np.eye(10))
    growth: FloatArray = field(default_factory=lambda: np.zeros(10))
    mean_radps: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def airborne(self) -> bool:
        return self.aided and self.flight.airborne


@dataclass(frozen=True)
class Samples:
    """A block of samples in body axes: rates in rad/s, accelerations in g, (n, 3); flags (n,)."""

    rate: FloatArray
    accel: FloatArray
    thrust: FloatArray
    missing: BoolArray
    gyro_clipped: BoolArray
    accel_clipped: BoolArray
    rates_alone: BoolArray
    """No acceleration came: taken for 1 g upwards."""

    def miss(self, step: int) -> None:
        """A sample that is not taken: the acceleration of the step before stays, as long as samples are missing."""
        self.missing[step] = True
        self.gyro_clipped[step] = self.accel_clipped[step] = self.rates_alone[step] = False
        while step < len(self.missing) and self.missing[step]:
            self.accel[step] = self.accel[step - 1]
            step += 1

    def part(self, begin: int, end: int) -> Samples:
        cut = slice(begin, end)
        flags = (self.missing[cut], self.gyro_clipped[cut], self.accel_clipped[cut], self.rates_alone[cut])
        return Samples(self.rate[cut], self.accel[cut], self.thrust[cut], *flags)
