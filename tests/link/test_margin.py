"""From the host's last KEEPALIVE to neutral outputs the worst parts together take less than 50 ms."""

from __future__ import annotations

import pytest

from plumb.spec import parameters
from support.margin import CRYSTAL, INTERNAL, constants, parts, sum_us

PERIOD = next(row for row in parameters.table() if row.name == "esc_period_us")
SHORTEST, LONGEST = PERIOD.armed or (PERIOD.min, PERIOD.max)
LOST_GAP_US = 40_000
"""Three values in a row lost, of one every 10 ms."""


@pytest.mark.parametrize("clock", [CRYSTAL, INTERNAL])
def test_the_worst_parts_add_up_to_less_than_50_ms(clock: str) -> None:
    safe_us = constants()["ARMING_SAFE_US"]
    assert safe_us == 50_000
    for frame_us in range(SHORTEST, LONGEST + 1):
        assert sum_us(clock, frame_us) < safe_us, parts(clock, frame_us)


def test_three_lost_values_and_a_late_turn_are_not_silence() -> None:
    c = constants()
    assert c["ARMING_SILENCE_US"] >= LOST_GAP_US + c["ARMING_TURN_US"]
