"""Of two faults in one recording, an audit names both: drawn pairs, all but those that cancel or mix."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from plumb.audit.audit import audit
from support import imu_recordings
from support.campaigns import LONG
from support.imu_recordings import FAULTS, in_the_hand, spoilt

MIXED = {frozenset({"axes", "up"})}
"""Another sign of the accelerometer is one more turn or mirror of its axes, and named with them."""
PAIRS = [
    pair
    for pair in itertools.combinations(FAULTS, 2)
    if len({FAULTS[one][0] for one in pair}) == 2 and {FAULTS[one][0] for one in pair} not in MIXED
]
SHARE = 25
"""One of so many pairs is tried in every run of the tests."""
SECONDS, CLIPPED_SECONDS = 25.0, 60.0
"""Samples at a limit say nothing, nor do those beside them: what else is wrong shows in a longer recording."""


@pytest.mark.parametrize("pair", PAIRS if LONG else PAIRS[5::SHARE], ids="+".join)
def test_both_of_two_faults_are_named(pair: tuple[str, str]) -> None:
    rng = np.random.default_rng([*"".join(pair).encode()])
    seed, rate_hz = int(rng.integers(1 << 30)), float(rng.choice((50, 100, 200, 333)))
    seconds = CLIPPED_SECONDS if "clipped" in pair else SECONDS
    kinds = {one.kind for one in audit(spoilt(in_the_hand(seed, rate_hz, seconds), pair, seed)).faults}
    assert all(imu_recordings.names(kinds, fault) for fault in pair), kinds
    assert all(any(imu_recordings.names({kind}, fault) for fault in pair) for kind in kinds), kinds
