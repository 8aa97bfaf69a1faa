"""A frame of a vehicle in flight: the chip's flat estimate agrees with the timing table, and a short period fits."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn")
pytest.importorskip("capstone")
pytest.importorskip("elftools")

from plumb.bench.bench import CYCLES_PER_US
from plumb.bench.live_frame import live_frame
from plumb.errors import UsageError


@pytest.mark.slow
@pytest.mark.parametrize("system", ["quadrotor", "wheels"])
def test_the_chip_is_awake_for_as_long_as_its_work_takes(system: str) -> None:
    """At the two wait states that 72 MHz need, within 10 %."""
    try:
        frame = live_frame(system)
    except UsageError as error:
        pytest.skip(str(error))
    assert frame.awake_cycles_mean == pytest.approx(frame.cycles_2ws_mean, rel=0.1)


@pytest.mark.slow
def test_a_step_a_millisecond_leaves_more_than_half_of_the_chip() -> None:
    """At two wait states, with the frames that a UART of 921600 baud has room for."""
    try:
        frame = live_frame("quadrotor", 1_000)
    except UsageError as error:
        pytest.skip(str(error))
    assert frame.wrong == 0
    assert frame.cycles_2ws_mean < 0.45 * frame.period_us * CYCLES_PER_US
