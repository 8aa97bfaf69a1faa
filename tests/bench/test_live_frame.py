"""The flat estimate of the simulated chip agrees with the timing table, instruction by instruction, in flight."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn")
pytest.importorskip("capstone")
pytest.importorskip("elftools")

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
