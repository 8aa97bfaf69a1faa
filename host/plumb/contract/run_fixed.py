"""Run a system's integer model, bit-exact for every word of the record; it makes the golden vectors.

The model is written from docs/reference/arithmetic/kernels.md, not from the C. Each system's fixed.py has
`control_init(p)` and `control_step(c, p, raw, setpoint)`, which returns the values of the record's words in order; the
shared kernels are in `plumb.kernels`. It computes one run, in Python's ints; `plumb.boards.native.core` runs many.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import Changes, ControlParams
from plumb.contract.step import FIXED, CheckedWords, RetunedStep
from plumb.errors import UsageError
from plumb.spec import dbc, declarations
from plumb.spec.records import Words, names_of, packer
from plumb.spec.system_parts import load


class Controller:
    """One run of the integer model, step by step."""

    def __init__(self, params: ControlParams) -> None:
        self._name, self._system, self._p = params.system, load(params.system, FIXED), params.values
        self._c = self._system.control_init(params.values)
        self._names, self._packer = names_of(params.system), packer(params.system)
        self._whole_inputs = declarations.system(params.system).whole_inputs
        self._row: tuple[int, ...] = ()

    def step(self, raw: Sequence[int], setpoint: int) -> dict[str, int]:
        """Run one step; returns its words by name. raw: the inputs, or the first of them (`System.whole_inputs`)."""
        inputs = self._whole_inputs([int(count) for count in raw])
        self._row = self._system.control_step(self._c, self._p, inputs, int(setpoint))
        return dict(zip(self._names, self._row, strict=True))

    def retune(self, params: ControlParams) -> None:
        """Use other parameters of the same system from the next step on, as a board does from the step that PARAM_USED
        names: only live ones may differ. The state moves so that no output jumps."""
        if isinstance(self._system, RetunedStep):
            self._system.control_retune(self._c, self._p, params.values)
        self._p = params.values

    def run(self, raw: npt.NDArray[np.int64], setpoint: npt.NDArray[np.int64]) -> Words:
        """Run a step for each row of checked inputs (`check_inputs`); returns their records."""
        return Words.from_bytes(self.records(raw, setpoint), (len(raw),), self._name)

    def records(self, raw: npt.NDArray[np.int64], setpoint: npt.NDArray[np.int64]) -> bytes:
        """The same as bytes."""
        step, c, p, pack = self._system.control_step, self._c, self._p, self._packer.pack
        rows = zip(raw.tolist(), setpoint.tolist(), strict=True)
        return b"".join(pack(*step(c, p, row, target)) for row, target in rows)

    def record(self) -> bytes:
        """The bytes of the last step's record, over which the digest is taken."""
        return self._packer.pack(*self._row)

    def digest(self) -> int:
        """CRC-32 of the last step's words."""
        return zlib.crc32(self.record())


def run_control(params: ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> Words:
    """Run the integer model on many samples of one run; returns the records.

    raw: (steps, inputs), or the first inputs (`check_inputs`); setpoint: (steps,). Raises UsageError for wrong shapes,
    types or ranges.
    """
    counts, setpoints = check_inputs(params.system, raw, setpoint)
    if counts.ndim == 3:
        raise UsageError(f"raw counts of {counts.shape[2]} runs: give the integer model those of one run")
    return Controller(params).run(counts, setpoints)


def run_changed(params: ControlParams, changes: Changes, raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> Words:
    """As `run_control` for one run, whose parameters change at the given steps; the state stays."""
    counts, setpoints = check_inputs(params.system, raw, setpoint)
    controller = Controller(params)
    data = []
    for number, (part, now) in enumerate(parts_of(params, changes, len(counts))):
        if number:
            controller.retune(now)
        data.append(controller.records(counts[part], setpoints[part]))
    return Words.from_bytes(b"".join(data), (len(counts),), params.system)


def parts_of(params: ControlParams, changes: Changes, steps: int) -> Iterator[tuple[slice, ControlParams]]:
    """The steps of a run that have the same parameters, and these. A part may be empty: two tables may be committed
    between two steps. Each is put into use, because a change takes up the state that the one before has left."""
    begins = [0, *(change.step for change in changes)]
    assert all(one <= other for one, other in itertools.pairwise([*begins, steps])), f"changes at {begins[1:]}"
    for begin, end, now in zip(begins, [*begins[1:], steps], [params, *(one.params for one in changes)], strict=True):
        yield slice(begin, end), now


def params_valid(params: ControlParams) -> bool:
    """Whether the arithmetic is made for these words, those of single parameters out of range included."""
    system = load(params.system, FIXED)
    return system.control_valid(params.values) if isinstance(system, CheckedWords) else True


def check_inputs(
    system: str, raw: npt.ArrayLike, setpoint: npt.ArrayLike
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """All inputs of a system as (steps, inputs[, runs]) in the int16 range, setpoints as (steps[, runs]) in the int32
    range.

    raw: the counts, at least three, and the words of the commands. Counts that are not given are 0, commands have their
    defaults; inputs that the system does not have may be given as 0. Raises UsageError for other inputs.
    """
    declared = declarations.system(system)
    most = declared.inputs
    counts, setpoints = np.asarray(raw), np.asarray(setpoint)
    for name, values, bits in (("raw counts", counts, 16), ("setpoints", setpoints, 32)):
        if values.dtype.kind not in "iu":
            raise UsageError(f"{name} are {values.dtype}: round them to integers first")
        if values.dtype == f"int{bits}":
            continue
        if values.size and (values.min() < -(1 << bits - 1) or values.max() >= 1 << bits - 1):
            raise UsageError(f"{name} reach {values.min()} to {values.max()}: they have {bits} bits")
    if counts.ndim in (2, 3) and counts.shape[1] <= dbc.inputs_most() and not counts[:, most:].any():
        counts = counts[:, :most]
    if counts.ndim not in (2, 3) or not 3 <= counts.shape[1] <= most:
        raise UsageError(f"raw counts of shape {counts.shape}: give (steps, 3 to {most}) or (steps, 3 to {most}, runs)")
    if setpoints.shape != (len(counts), *counts.shape[2:]):
        raise UsageError(f"setpoints of shape {setpoints.shape} do not match raw counts of shape {counts.shape}")
    if counts.shape[1] == most:
        return counts.astype(np.int64), setpoints.astype(np.int64)
    whole = np.zeros((len(counts), most, *counts.shape[2:]), np.int64)
    for place, word in enumerate(declared.default_commands(), declared.counts):
        whole[:, place] = word
    whole[:, : counts.shape[1]] = counts
    return whole, setpoints.astype(np.int64)
