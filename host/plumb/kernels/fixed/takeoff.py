"""Conditions for the takeoff of a vehicle that flies, in integers, written from docs/reference/arithmetic/takeoff.md:
what plumb_takeoff_step computes from the record of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

SETTLING, MOVING, CONVERGING, SETPOINT, TILTED = 1, 2, 4, 8, 16
READY_S_Q33 = 300 * (1 << 33) // 1000
RATE_MAX = 1 << 29
"""2 turn/s, Q28."""


class Bounds(NamedTuple):
    """Inputs of the conditions from a system. throttle, rate, up_z, variance: words of its record, rate without the
    axis. blind: flags of a sample that was missing or at a limit. stands: flags that all say that it stands on the
    ground."""

    throttle: str
    rate: str
    up_z: str
    variance: str
    blind: int
    stands: int
    throttle_max_q15: int
    rest_turnps_q28: int
    up_z_min_q30: int
    variance_max_rad2_q32: int


@dataclass(slots=True)
class State:
    """The words after a step, in order."""

    ready_s_q33: int = 0
    rate_mean_turnps_q28: int = 0
    missing: int = 31

    def words(self) -> tuple[int, ...]:
        return self.ready_s_q33, self.rate_mean_turnps_q28, self.missing


def step(s: State, b: Bounds, word: Mapping[str, int], dt_s_q33: int) -> None:
    """One step. word: its record by name; dt_s_q33: the period."""
    turning = min(max(abs(word[f"{b.rate}_{axis}"]) for axis in range(3)), RATE_MAX)
    fastest = RATE_MAX if word["flags"] & b.blind else turning
    s.rate_mean_turnps_q28 += (fastest - s.rate_mean_turnps_q28) * (2 * dt_s_q33) >> 32
    stands = word["flags"] & b.stands == b.stands
    missing = {
        MOVING: not stands or s.rate_mean_turnps_q28 > b.rest_turnps_q28,
        CONVERGING: word[b.variance] > b.variance_max_rad2_q32,
        SETPOINT: word[b.throttle] > b.throttle_max_q15,
        TILTED: word[b.up_z] < b.up_z_min_q30,
    }
    s.missing = sum(bit for bit, is_missing in missing.items() if is_missing)
    s.ready_s_q33 = 0 if s.missing else min(s.ready_s_q33 + dt_s_q33, READY_S_Q33)
    s.missing |= SETTLING if s.ready_s_q33 < READY_S_Q33 else 0
