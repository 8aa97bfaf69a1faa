"""The angles of a recording by a system's integers, and next to them those of VQF and of the recording's reference."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plumb import systems
from plumb.analyses.comparison import published
from plumb.analyses.estimation import verticals
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.readers import recording
from plumb.readers.recording import Recording
from plumb.readers.replay import REPLAY, ReplayRequest
from plumb.spec import declarations
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.spec.system_parts import Part

Columns = Mapping[str, FloatArray]
UP = ("up_x", "up_y", "up_z")
"""Columns of the vertical in body axes, of a system that estimates all of it."""
VQF = next(one for one in published.PUBLISHED if one.name == "VQF")


class AnglesOfSteps(Protocol):
    """angles.py of a system that makes angles of a recording."""

    def angles(self, words: Words, params: ControlParams, axis: str, /) -> Columns:
        """Signal -> (steps,), in the order in which a table shows them. Names end in the unit, deg or dps; UP without
        one. sigma_deg: the standard deviation that the filter states. axis: of the recording, for one-axis systems."""


ANGLES = Part[AnglesOfSteps]("angles", AnglesOfSteps, without="it makes no angles of a recording", place="judging")


@dataclass(frozen=True)
class Estimated:
    """columns: those of the system, then those of VQF and of the reference, (steps,) each. flags: of the step by name,
    (steps,) each. warnings: sentences for the user."""

    system: str
    name: str
    tuning: str
    period_us: int
    time_s: FloatArray
    columns: Columns
    flags: Mapping[str, BoolArray]
    warnings: tuple[str, ...]

    def sigma_deg(self) -> FloatArray | None:
        """The stated standard deviation, NaN while a flag says that the system is unsure, (steps,)."""
        sigma = self.columns.get("sigma_deg")
        return None if sigma is None else np.where(self.flags.get("UNSURE", np.zeros(len(sigma), bool)), np.nan, sigma)

    def flag_names(self) -> list[str]:
        """The flags that are set at each step, with a space between two; "" for none. (steps,)"""
        set_at: list[list[str]] = [[] for _ in self.time_s]
        for name, at in self.flags.items():
            for step in np.flatnonzero(at).tolist():
                set_at[step].append(name)
        return [" ".join(names) for names in set_at]


def estimate(system: str, request: ReplayRequest) -> Estimated:
    """Run a recording through a system's C step. Raises UsageError for a system that makes no angles of a recording,
    and for a file that cannot be used."""
    made = systems.load(system, ANGLES)
    inputs, params, heading = systems.load(system, REPLAY).inputs_of(request)
    words = native_core.run_control(params, inputs.raw, np.zeros(len(inputs.raw), np.int32))
    period_us = round(1e6 * float(inputs.time_s[1] - inputs.time_s[0])) if len(inputs.time_s) > 1 else 0
    columns = dict(made.angles(words, params, request.axis))
    with contextlib.suppress(UsageError):  # a system may read further kinds of files, which are no such recordings
        recorded = request.recording()
        columns |= _of_vqf(recorded, period_us, len(inputs.raw), columns)
        columns |= _of_reference(recorded, inputs.time_s, columns)
    said = heading.get("warnings", [])
    assert isinstance(said, list)
    flags = {
        flag.name: np.asarray(words["flags"] >> bit & 1, bool)
        for bit, flag in enumerate(declarations.system(system).flags)
    }
    return Estimated(
        system, request.file.name, str(heading["tuning"]), period_us, inputs.time_s, columns, flags, tuple(said)
    )


def _of_vqf(recorded: Recording, period_us: int, steps: int, own: Columns) -> dict[str, FloatArray]:
    """VQF with its defaults on the same samples; {} where it is not installed."""
    try:
        module = published.imported(VQF)
    except UsageError:
        return {}
    values = recording.steady(recorded.time_s, np.hstack([recorded.gyr_dps, recorded.acc_g]), period_us)[:steps]
    gyr = np.ascontiguousarray(np.radians(values[:, :3]))
    acc = np.ascontiguousarray(values[:, 3:] * recording.G_MPS2)
    up = recording.vertical(np.asarray(module.VQF(period_us * 1e-6).updateBatch(gyr, acc)["quat6D"], np.float64))
    return _next_to("vqf", up, own)


def _of_reference(recorded: Recording, time_s: FloatArray, own: Columns) -> dict[str, FloatArray]:
    if recorded.ref_quat is None:
        return {}
    true = recording.vertical(recorded.ref_quat)
    up = np.stack([np.interp(time_s, recorded.time_s, column) for column in true.T], 1)
    return _next_to("reference", up, own)


def _next_to(name: str, up: FloatArray, own: Columns) -> dict[str, FloatArray]:
    """Roll and pitch of another vertical, and its angle to the system's own where that estimates all of it."""
    found = {f"{name}_roll_deg": verticals.roll_deg(up), f"{name}_pitch_deg": verticals.pitch_deg(up)}
    if all(column in own for column in UP):
        found[f"{name}_apart_deg"] = verticals.apart_deg(np.stack([own[column] for column in UP], 1), up)
    return found
