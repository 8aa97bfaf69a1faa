"""The steps of a recorded run as a table: a column with its unit for every signal, and the time of every step.

A signal of the system that the link had no room for is calculated from the raw counts (`replayed_steps`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from plumb.readers.log_replay import RecordedRun
from plumb.readers.replayed_steps import ReplayedSteps
from plumb.readers.run_parts import Steps
from plumb.readers.step_quantities import Battery, TruePlace, quantities_of
from plumb.readers.table_column import Column, Values
from plumb.spec import dbc, declarations
from plumb.spec.signals import UNITS, signals
from plumb.spec.system import Part, System
from plumb.tuning.channels import NO_SAMPLE, values_of

_AXIS_UNITS = {"gyr": ("dps", "deg/s"), "acc": ("g", "g"), "ang": ("dps2", "deg/s^2")}
"""Sensor of an axis -> suffix of its column, and unit."""

MOTION = ("deg", "deg/s", "m/s")
"""Units of the signals that stand before the raw counts."""


def _commands(declared: System, run: Steps, raw_frames: Sequence[str]) -> Iterator[Column]:
    """The commands that each step used, in the integers of the system."""
    for command, place in zip(declared.step_commands, declared.command_places() if raw_frames else (), strict=False):
        words = run.raw[:, place : place + command.size].astype(np.int64)
        low = words[:, :-1] & 0xFFFF
        whole = words[:, -1] << 16 * (command.size - 1) | (low[:, 0] if command.size > 1 else 0)
        yield Column(f"command_{command.name}", "", whole, run.raw_known)


Besides = tuple[Battery, TruePlace]
"""Columns from what a log has besides the frames of the steps."""


def _besides(recorded: RecordedRun) -> Besides:
    return Battery(recorded), TruePlace(recorded)


def tables_of(recorded: RecordedRun) -> Iterator[list[Column]]:
    """The columns of a run in parts of a bounded number of steps, which have the same columns."""
    replayed, besides = ReplayedSteps(recorded), _besides(recorded)
    for part in recorded.run.parts():
        yield _table(recorded, part, replayed, besides)


def table_of(recorded: RecordedRun) -> list[Column]:
    """The columns of a run: time, step, digest, armed; the quantities of people (`step_quantities`); angles, rates and
    velocities among the signals of the system; setpoint, raw counts, calibrated sensor values, commands; then the other
    signals. A signal has a column if it was received or can be calculated.
    The time counts the periods from the first step of the run."""
    return _table(recorded, recorded.run.together, ReplayedSteps(recorded), _besides(recorded))


def _table(recorded: RecordedRun, run: Steps, replayed: ReplayedSteps, besides: Besides) -> list[Column]:
    whole, params = recorded.run, recorded.used.params
    steps = run.first + np.arange(len(run), dtype=np.int64)
    time = [
        Column("time_s", "s", steps.astype(np.float64) * params.period_s),
        Column("step", "", steps),
        Column("digest", "", run.digest, run.digest_known),
        Column("armed", "", run.armed.astype(np.int64), run.digest_known),
    ]
    found = [Column("setpoint", "", run.setpoint.astype(np.int64))]
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
    found += [*sensed, *_commands(declared, run, whole.raw_frames), *_signals(recorded, run, replayed)]
    first = [column for column in found if column.frame and column.unit in MOTION]
    rest = [column for column in found if not (column.frame and column.unit in MOTION)]
    more = [column for one in besides for column in one.columns(run)]
    return [*time, *quantities_of(found, declared, params), *more, *first, *rest]


def _signals(recorded: RecordedRun, run: Steps, replayed: ReplayedSteps) -> Iterator[Column]:
    """The signals of the frames, where they were received or can be calculated."""
    units = {suffix: unit for unit, suffix in UNITS.items()}
    calculable, words = replayed.possible, replayed.words(run)
    parts = _parts(declarations.system(recorded.system))
    for key, name, scale in signals(recorded.system):
        if key not in recorded.run.signals and not calculable:
            continue
        integers, came = run.signal(key)
        if words is not None:
            part, bits = parts[key]
            count = len(words.record)
            integers, came = integers.copy(), came.copy()
            integers[:count], came[:count] = _sent(part, words[part.word.name].astype(np.int64), bits), True
        unit = next((unit for suffix, unit in units.items() if name.endswith(suffix)), "")
        values: Values = integers if scale == 1.0 else np.asarray(integers * scale, np.float64)
        yield Column(name, unit, values, came, key[0])


def _parts(declared: System) -> dict[tuple[str, str], tuple[Part, int]]:
    """Frame and signal -> the part of a word that it carries, and its bits."""
    return {
        (dbc.frame_name(declared, frame), part.name): (part, bits)
        for frame in declared.frames
        for part, bits in ((frame.half, 16), (frame.word, 32))
        if part is not None
    }


def _sent(part: Part, values: npt.NDArray[np.int64], bits: int) -> npt.NDArray[np.int64]:
    """What a frame carries of a word: its upper bits, of 16 the nearest value that they hold."""
    signed = part.word.type.startswith("int")
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    moved = values >> part.shift
    return np.clip(moved, low, high) if bits == 16 else (moved - low & (1 << bits) - 1) + low
