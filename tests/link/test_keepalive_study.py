"""How often a keep-alive over a slow and lossy link lets the board go: ten minutes each, in simulated time."""

from __future__ import annotations

import pytest

from support.link_functions import disarms

TEN_MINUTES_S = 600
MS_50_HZ, MS_400_HZ = 20_000, 2500
"""Frame of the pulses, in us."""


@pytest.mark.slow
def test_25_ms_and_1_percent_of_loss() -> None:
    """With pulses of 50 Hz two lost values in a row are 30 ms, where 29 are allowed:
    (1 - 0.99^2)^2, 60,000 times, is 24. With 400 Hz it takes four."""
    at_50_hz = [disarms(TEN_MINUTES_S, 25, 0.01, MS_50_HZ, seed) for seed in (1, 2, 3)]
    at_400_hz = [disarms(TEN_MINUTES_S, 25, 0.01, MS_400_HZ, seed) for seed in (1, 2, 3)]
    print(f"disarmed in 10 minutes at 25 ms and 1 %: {at_50_hz} at 50 Hz, {at_400_hz} at 400 Hz")
    assert 12 * 3 < sum(at_50_hz) < 36 * 3
    assert sum(at_400_hz) <= 1


@pytest.mark.parametrize("frame_us", [MS_50_HZ, MS_400_HZ])
def test_without_loss_never(frame_us: int) -> None:
    assert disarms(TEN_MINUTES_S, 25, 0.0, frame_us, 1) == 0


def test_a_way_that_takes_longer_than_a_value_lives_holds_nothing() -> None:
    assert disarms(10, 38, 0.0, MS_400_HZ, 1) == 0
    assert disarms(10, 42, 0.0, MS_400_HZ, 1) > 60  # again and again
