"""Runs side by side in the native core are the runs that they would be alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.systems.attitude import scenarios as attitude
from plumb.systems.quad import scenarios as quad

Counts = npt.NDArray[np.int16]
STEPS, RUNS = 400, 3


def attitude_runs() -> tuple[ControlParams, Counts]:
    runs = [attitude.scenario("hand", seed, seconds=2.0) for seed in range(RUNS)]
    return quantise(runs[0].fit(attitude.TUNINGS["standard"])), np.stack([run.counts() for run in runs], -1)


def quad_runs() -> tuple[ControlParams, Counts]:
    runs = [quad.scenario("motion", seed, seconds=8.0) for seed in range(RUNS)]
    return quantise(quad.TUNINGS[quad.DEFAULT_TUNING]), np.stack([run.counts() for run in runs], -1)


@pytest.mark.parametrize("given", [attitude_runs, quad_runs])
def test_each_run_is_the_one_it_would_be_alone(given: Callable[[], tuple[ControlParams, Counts]]) -> None:
    params, counts = given()
    setpoints = np.arange(len(counts) * RUNS, dtype=np.int32).reshape(-1, RUNS)
    alone = native_core.run_control(params, counts, setpoints)
    together = native_core.Controllers(params, RUNS)
    assert len(counts) >= STEPS
    for step in range(STEPS):
        words = together.step(counts[step].T, setpoints[step])
        assert np.array_equal(words.record, alone.record[step]), step
