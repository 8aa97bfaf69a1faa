"""How often a keep-alive over a slow and lossy link lets the board go: ten minutes each, in simulated time."""

from __future__ import annotations

import pytest

from support.link_functions import disarms

TEN_MINUTES_S = 600
MS_50_HZ, MS_400_HZ = 20_000, 2500
"""Frame of the pulses, in us."""


@pytest.mark.slow
def test_25_ms_and_1_percent_of_loss() -> None:
    """Four values in a row must be lost, 0.01^4 of 60,000 with either end of a way: less than once in an hour, at every
    length of the frame of pulses."""
    for frame_us in (MS_50_HZ, MS_400_HZ):
        counted = [disarms(TEN_MINUTES_S, 25, 0.01, frame_us, seed) for seed in (1, 2, 3)]
        assert sum(counted) == 0, f"disarmed in 10 minutes with frames of {frame_us} us: {counted}"


@pytest.mark.parametrize("frame_us", [MS_50_HZ, MS_400_HZ])
def test_without_loss_never(frame_us: int) -> None:
    assert disarms(TEN_MINUTES_S, 25, 0.0, frame_us, 1) == 0


def test_a_way_that_takes_longer_than_a_value_lives_holds_nothing() -> None:
    assert disarms(10, 38, 0.0, MS_400_HZ, 1) == 0
    assert disarms(10, 42, 0.0, MS_400_HZ, 1) > 60  # again and again
