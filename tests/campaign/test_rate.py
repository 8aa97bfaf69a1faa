"""What a batch saves: runs per second of processor time against those of `plumb.run`, in turn in one process."""

from __future__ import annotations

import pytest

from plumb.campaign import rate
from support.declared_systems import of_declared

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("system", "open_loop", "least"),
    of_declared([("quad", False, 30.0), ("balancer", False, 30.0), ("balancer", True, 30.0), ("phone", True, 10.0)]),
)
def test_a_campaign_is_so_many_times_as_fast(system: str, open_loop: bool, least: float) -> None:
    found = rate.measure(system, open_loop=open_loop, alone=1)
    assert found.ratio >= least, str(found)
