"""The integer model on many runs, one after the other, and its kernels on many values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.proof.compare import first_divergence
from plumb.spec.records import Words

Inputs: TypeAlias = npt.NDArray[np.signedinteger[Any]]  # Any: counts have 16 bits, setpoints 32, drawn ones 64
Integers: TypeAlias = npt.NDArray[np.int64]


def run_each(params: Sequence[ControlParams], raw: Inputs, setpoint: Inputs) -> Words:
    """As `native_core.run_control` with a set for each run. raw: (steps, inputs, runs); setpoint: (steps, runs)."""
    runs = [run_fixed.run_control(one, raw[:, :, run], setpoint[:, run]) for run, one in enumerate(params)]
    return Words(np.stack([run.record for run in runs], axis=1))


def agreed(
    params: Sequence[ControlParams], raw: Inputs, setpoint: Inputs, *, begun: int, every: int
) -> dict[str, Integers]:
    """The words by name in which the model equals the C core: of the first steps, `begun`, of each of the runs, and of
    the whole run of one in `every`."""
    core = native_core.run_control(params, raw, setpoint).record
    parts = [(core[:begun], run_each(params, raw[:begun], setpoint[:begun]))]
    parts += [(core[:, ::every], run_each(params[::every], raw[:, :, ::every], setpoint[:, ::every]))]
    for expected, found in parts:
        assert first_divergence(found, Words(expected)) is None
    return {
        name: np.concatenate([found[name].ravel() for _, found in parts]).astype(np.int64)
        for name in core.dtype.names or ()
    }


def each(function: Callable[..., Any], *values: npt.NDArray[Any]) -> Integers:  # Any: an int, or a tuple of ints
    """What a kernel gives for each of these values; the results of a kernel that has several are rows."""
    return np.array([function(*one) for one in zip(*(row.tolist() for row in values), strict=True)], np.int64).T
