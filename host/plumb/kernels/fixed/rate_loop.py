"""The controller of one body rate in integers, written from the pages of docs/reference/arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32


@dataclass(slots=True)
class RateLoopState:
    """Words of the record, in order. excess_q24: the demand of the step before minus the command that the mixer
    gave."""

    rate_filtered_turnps_q27: Integer
    integral_q30: Integer
    demand_q24: Integer
    excess_q24: Integer

    def words(self) -> tuple[Integer, ...]:
        return (self.rate_filtered_turnps_q27, self.integral_q30, self.demand_q24, self.excess_q24)


class Conditions(NamedTuple):
    """Conditions of a step that the loops of all axes share. flies: the rotors are on; landed: the vehicle stands on
    the ground, so that the integral decays; touches: it may stand there, so that the integral stays."""

    d_alpha_q31: Integer
    integral_max_q30: Integer
    flies: Integer
    landed: Integer
    touches: Integer = False


def rate_loop_step(c: RateLoopState, p: Params, group: str, shared: Conditions, asked: Integer, rate: Integer) -> None:
    """One step: the demand of the axis. asked, rate: turn/s Q28; group: name of its parameter group."""
    error = (asked >> 1) - (rate >> 1)
    change = wrap_i32((rate >> 1) - c.rate_filtered_turnps_q27)
    c.rate_filtered_turnps_q27 = wrap_i32(c.rate_filtered_turnps_q27 + 2 * mul(change, shared.d_alpha_q31))

    limit = shared.integral_max_q30
    winds_up = ((c.excess_q24 > 0) & (error > 0)) | ((c.excess_q24 < 0) & (error < 0))
    grown = clamp(c.integral_q30 + mul(error, p[f"{group}.ki_dt_q35"]), -limit, limit)
    in_air = select(winds_up | shared.touches, c.integral_q30, grown)
    on_ground = c.integral_q30 - (c.integral_q30 >> 5)
    c.integral_q30 = select(shared.flies, select(shared.landed, on_ground, in_air), 0 * on_ground)

    direct = mul(error, p[f"{group}.kp_q29"]) + mul(asked >> 1, p[f"{group}.ff_q29"])
    c.demand_q24 = direct - 2 * mul(change, p[f"{group}.kd_q28"]) + (c.integral_q30 >> 6)
