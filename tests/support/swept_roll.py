"""The loop of roll of `quadrotor` as a sweep in flight finds it, once for all tests that look at it."""

from __future__ import annotations

import pytest

from plumb.judging.quadrotor import loops
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import scenarios
from plumb.tuning.loop_model import Response
from support.once_per_run import once_per_run, run_folder


def swept_roll(factory: pytest.TempPathFactory) -> tuple[FloatArray, Response]:
    """Frequencies in Hz, and the gain of the loop there: `loops.swept` with the shipped tuning."""
    swept = lambda: loops.swept("roll", scenarios.HUMMINGBIRD, scenarios.PERIOD_US)  # noqa: E731
    return once_per_run(run_folder(factory), "quadrotor, roll swept", swept)
