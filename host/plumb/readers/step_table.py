"""The steps of a recorded run as a table: a column with its unit for every signal, and the time of every step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.readers.log_replay import RecordedRun
from plumb.readers.run_parts import Steps
from plumb.spec import declarations
from plumb.spec.arrays import BoolArray
from plumb.spec.signals import UNITS, signals
from plumb.spec.system import System
from plumb.tuning.channels import NO_SAMPLE, values_of

Values = npt.NDArray[np.float64 | np.int64 | np.int16 | np.uint32]
_AXIS_UNITS = {"gyr": ("dps", "deg/s"), "acc": ("g", "g"), "ang": ("dps2", "deg/s^2")}
"""Sensor of an axis -> suffix of its column, and unit."""


@dataclass(frozen=True)
class Column:
    """One column, (n,). known: where the value was received; None: everywhere. frame: the telemetry frame that carried
    it."""

    name: str
    unit: str
    values: Values
    known: BoolArray | None = None
    frame: str = ""


def _commands(declared: System, run: Steps, raw_frames: Sequence[str]) -> Iterator[Column]:
    """The commands that each step used, in the integers of the system."""
    for command, place in zip(declared.step_commands, declared.command_places() if raw_frames else (), strict=False):
        words = run.raw[:, place : place + command.size].astype(np.int64)
        low = words[:, :-1] & 0xFFFF
        whole = words[:, -1] << 16 * (command.size - 1) | (low[:, 0] if command.size > 1 else 0)
        yield Column(f"command_{command.name}", "", whole, run.raw_known)


def table_of(recorded: RecordedRun, part: Steps | None = None) -> list[Column]:
    """The columns of a run, or of a part of it, which has the same ones: time, step, digest, armed, setpoint, raw
    counts, calibrated sensor values, then the signals that were received. The time counts the periods from the first
    step of the run."""
    whole, params = recorded.run, recorded.used.params
    run = whole.together if part is None else part
    steps = run.first + np.arange(len(run), dtype=np.int64)
    found = [
        Column("time_s", "s", steps.astype(np.float64) * params.period_s),
        Column("step", "", steps),
        Column("digest", "", run.digest, run.digest_known),
        Column("armed", "", run.armed.astype(np.int64), run.digest_known),
        Column("setpoint", "", run.setpoint.astype(np.int64)),
    ]
    declared = declarations.system(recorded.system)
    channels = declared.channels
    sensed: list[Column] = []
    for index, channel in enumerate(channels if whole.raw_frames else ()):
        counts = run.raw[:, index]
        found.append(Column(f"raw_{channel.name}_counts", "counts", counts, run.raw_known))
        sensor = values_of(params, channel, counts)
        if channel.axis and sensor is not None:
            axis = channel.axis.removeprefix("-")
            suffix, unit = _AXIS_UNITS[axis[:3]]
            sign = -1.0 if channel.axis.startswith("-") else 1.0
            there = run.raw_known & (counts != NO_SAMPLE) if declared.missing_samples == "marked" else run.raw_known
            sensed.append(Column(f"{axis}_{suffix}", unit, sign * sensor, there))
    found += [*sensed, *_commands(declared, run, whole.raw_frames)]
    units = {suffix: unit for unit, suffix in UNITS.items()}
    values: Values
    for key, name, scale in signals(recorded.system):
        if key in whole.signals:
            integers, came = run.signal(key)
            unit = next((unit for suffix, unit in units.items() if name.endswith(suffix)), "")
            values = integers if scale == 1.0 else np.asarray(integers * scale, np.float64)
            found.append(Column(name, unit, values, came, key[0]))
    return found
