"""An audit names every fault that is put into a recording of a known motion, and nothing in a good one."""

from __future__ import annotations

from dataclasses import replace

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
def test_a_fault_is_named_and_no_other_and_undone_where_it_is_sure(fault: str) -> None:
    seed, rate_hz = drawn(fault)
    found = audit(spoilt(in_the_hand(seed, rate_hz, 25.0), (fault,), seed))
    assert [imu_recordings.names({one.kind}, fault) for one in found.faults] == [True], found.faults
    if FAULTS[fault][0] not in ("up", "limit"):
        assert found.sure_fault
        assert audit(found.mended).faults == []


@pytest.mark.parametrize(
    ("motion", "rate_hz"), [(("hand", "fast")[place % 2], rate_hz) for place, rate_hz in enumerate(RATES_HZ)]
)
def test_a_good_recording_raises_no_alarm(motion: str, rate_hz: float) -> None:
    seed, _ = drawn(f"{motion} {rate_hz}")
    assert audit(in_the_hand(seed, rate_hz, 25.0, motion)).faults == []


@pytest.mark.parametrize("reads_dps", [0.0, -250.13])
def test_a_gyro_that_is_not_read_is_named_where_the_accelerometer_turns(reads_dps: float) -> None:
    samples = in_the_hand(drawn("dead")[0], 100.0, 25.0)
    dead = replace(samples, gyr_dps=np.full_like(samples.gyr_dps, reads_dps))
    assert "gyro-dead" in {one.kind for one in audit(dead).faults}
    at_rest = replace(dead, acc_g=np.random.default_rng(1).normal([0.0, 0.1, 1.0], 0.005, dead.acc_g.shape))
    assert "gyro-dead" not in {one.kind for one in audit(at_rest).faults}


def test_a_gyro_that_pauses_is_not_taken_for_one_that_is_not_read() -> None:
    samples = in_the_hand(drawn("pause")[0], 100.0, 25.0)
    kept = np.minimum(np.arange(len(samples)), len(samples) // 2)
    assert "gyro-dead" not in {one.kind for one in audit(replace(samples, gyr_dps=samples.gyr_dps[kept])).faults}
