"""What the tests of the cockpit share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from support.cockpit_bench import CockpitBench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[CockpitBench]:
    bench = CockpitBench(tmp_path / "recordings")
    yield bench
    bench.close()
