"""The controller of one body rate in integers, written from the pages of docs/reference/arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, mulhi_i32, wrap_i32


class RateLoopMode(Enum):
    """State of the vehicle, which decides what happens to the integral."""

    OFF = auto()
    """The rotors are off: the integral is 0."""
    GROUNDED = auto()
    """The integral decays by a 32nd per step."""
    HELD = auto()
    """It may stand on the ground: the integral stays."""
    FLYING = auto()


@dataclass(slots=True)
class RateLoopState:
    """Words of the record, in order. excess_q24: the demand of the step before minus the command that the mixer
    gave."""

    rate_filtered_turnps_q27: int = 0
    integral_q30: int = 0
    demand_q24: int = 0
    excess_q24: int = 0

    def words(self) -> tuple[int, ...]:
        return (self.rate_filtered_turnps_q27, self.integral_q30, self.demand_q24, self.excess_q24)


def rate_loop_step(
    c: RateLoopState,
    p: Params,
    group: str,
    d_alpha_q31: int,
    integral_max_q30: int,
    asked_turnps_q28: int,
    rate_turnps_q28: int,
    mode: RateLoopMode,
) -> None:
    """One step: the demand of the axis. group: name of its parameter group."""
    asked, rate = asked_turnps_q28 >> 1, rate_turnps_q28 >> 1
    error = asked - rate
    change = wrap_i32(rate - c.rate_filtered_turnps_q27)
    c.rate_filtered_turnps_q27 = wrap_i32(c.rate_filtered_turnps_q27 + 2 * mulhi_i32(change, d_alpha_q31))

    winds_up = (c.excess_q24 > 0 and error > 0) or (c.excess_q24 < 0 and error < 0)
    if mode is RateLoopMode.OFF:
        c.integral_q30 = 0
    elif mode is RateLoopMode.GROUNDED:
        c.integral_q30 -= c.integral_q30 >> 5
    elif mode is RateLoopMode.FLYING and not winds_up:
        grown = c.integral_q30 + mulhi_i32(error, p[f"{group}.ki_dt_q35"])
        c.integral_q30 = clamp(grown, -integral_max_q30, integral_max_q30)

    direct = mulhi_i32(error, p[f"{group}.kp_q29"]) + mulhi_i32(asked, p[f"{group}.ff_q29"])
    c.demand_q24 = direct - 2 * mulhi_i32(change, p[f"{group}.kd_q28"]) + (c.integral_q30 >> 6)
