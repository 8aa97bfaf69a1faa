"""An audit names every fault that is put into a recording of a known motion, and nothing in a good one."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.audit.audit import audit
from support import imu_recordings
from support.imu_recordings import FAULTS, in_the_hand, spoilt

RATES_HZ = (50, 100, 200, 333, 500, 1000)


def drawn(name: str) -> tuple[int, float]:
    """Seed of a motion and rate of its sensor, of this test alone."""
    rng = np.random.default_rng([*name.encode()])
    return int(rng.integers(1 << 30)), float(rng.choice(RATES_HZ))


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_no_other(fault: str) -> None:
    seed, rate_hz = drawn(fault)
    found = audit(spoilt(in_the_hand(seed, rate_hz, 25.0), (fault,), seed))
    assert [imu_recordings.names({one.kind}, fault) for one in found.faults] == [True], found.faults


@pytest.mark.parametrize("fault", [one for one in FAULTS if FAULTS[one][0] not in ("up", "limit")])
def test_what_is_sure_is_undone_as_found(fault: str) -> None:
    seed, rate_hz = drawn(f"{fault} undone")
    found = audit(spoilt(in_the_hand(seed, rate_hz, 25.0), (fault,), seed))
    assert found.sure_fault
    assert audit(found.mended).faults == []


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("motion", ["hand", "fast"])
def test_a_good_recording_raises_no_alarm(motion: str, rate_hz: float) -> None:
    seed, _ = drawn(f"{motion} {rate_hz}")
    assert audit(in_the_hand(seed, rate_hz, 25.0, motion)).faults == []
