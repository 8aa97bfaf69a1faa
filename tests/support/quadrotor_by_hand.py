"""A quadrotor whose sensors, sticks and receiver a test sets step by step: the integers, without a board or a plant."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from plumb.kernels.fixed.kernels import Params
from plumb.spec import parameters
from plumb.spec.records import names_of
from plumb.systems.quadrotor import fixed

ONE_G, COUNTS_PER_DPS = 2048, 16.384
FULL = 32767
WORDS = {
    **{row.name: row.default for row in parameters.table() if row.owner == "control"},
    "gyro.raw_min": -32767,
    "gyro.raw_max": 32767,
    "gyro.gain": round((1 << 28) / 360 / COUNTS_PER_DPS),
    "gyro.offset": 0,
    "accel.raw_min": -32767,
    "accel.raw_max": 32767,
    "accel.gain": (1 << 26) // ONE_G,
    "accel.offset": 0,
    "esc.neutral_halfus": 1900,
    "esc.min_halfus": 2000,
    "esc.mid_halfus": 2000,
    "esc.max_halfus": 4000,
    "esc.span_halfus": 2000,
    "attitude.block_steps": 15,
    "attitude.inverse_block_q32": 286331153,
    "attitude.aid_s_q24": 1 << 26,
    "attitude.aid_hover_q15": 9830,
}
"""Parameters by name: defaults, sensors of 2000 deg/s and 16 g, and a drag, so that the vehicle is known to fly."""
GROUND_STEPS, TAKE_OFF_STEPS, ON_GROUND = 200, 90, 3000
"""Steps after which attitude is sure of the vertical; then six blocks with thrust; a throttle that is not low and does
not lift off."""
BLOCK_STEPS, MAYBE_LANDED_BLOCKS, LANDED_BLOCKS = 15, 8, 67


def leaning(degrees: float) -> tuple[float, float, float]:
    """Acceleration of a body at rest, g, that has rolled about x."""
    return 0.0, math.sin(math.radians(degrees)), math.cos(math.radians(degrees))


@dataclass
class Quadrotor:
    """The inputs hold until a test sets others. frames: the receiver has a new frame in every step."""

    words: Params
    accel_g: tuple[float, float, float] = (0.0, 0.0, 1.0)
    rate_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    missing: bool = False
    throttle: int = FULL // 2
    sticks: tuple[int, int, int] = (0, 0, 0)
    on: bool = True
    mode_rate: bool = False
    frames: bool = True
    signs_off: bool = False
    number: int = 1
    state: fixed.QuadrotorState = field(init=False)

    def __post_init__(self) -> None:
        self.state = fixed.control_init(self.words)

    def inputs(self) -> list[int]:
        counts = [round(rate * COUNTS_PER_DPS) for rate in self.rate_dps]
        counts += [round(accel * ONE_G) for accel in self.accel_g]
        if self.missing:
            counts[0] = -32768
        switches = int(self.on) + 2 * int(self.mode_rate)
        return [*counts, *self.sticks, switches, self.number + 256 * int(self.signs_off), 0]

    def step(self, steps: int = 1) -> dict[str, int]:
        """The record of the last of these steps, by name."""
        row: tuple[int, ...] = ()
        for _ in range(steps):
            if self.frames:
                self.number = self.number % 255 + 1
            row = fixed.control_step(self.state, self.words, self.inputs(), self.throttle)
        return dict(zip(names_of("quadrotor"), row, strict=True))


def quadrotor(accel_g: tuple[float, float, float] = (0.0, 0.0, 1.0), /, **words: int) -> Quadrotor:
    """On the ground, sure of its vertical, switched on for the next step. accel_g: what it feels there; words:
    parameters of the group `quadrotor` that differ."""
    vehicle = Quadrotor({**WORDS, **{f"quadrotor.{name}": value for name, value in words.items()}}, accel_g)
    vehicle.on = False
    vehicle.step(GROUND_STEPS)
    vehicle.on = True
    return vehicle


def flying(**words: int) -> Quadrotor:
    """The same in the air, level at half throttle."""
    vehicle = quadrotor(**words)
    vehicle.step(TAKE_OFF_STEPS)
    return vehicle
