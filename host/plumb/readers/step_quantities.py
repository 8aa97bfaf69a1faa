"""What people look for first in the table of a vehicle: angles, the rate of the heading, motors and sticks in per cent,
the phase in words, the battery. All are calculated from other columns of the table, or from BATTERY frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import ControlParams
from plumb.readers.log_file import ERROR, EXTENDED, REMOTE, TRUTH
from plumb.readers.log_replay import RecordedRun
from plumb.readers.run_parts import Steps
from plumb.readers.table_column import Column
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.protocol import check
from plumb.spec.quaternion_angles import ANGLES
from plumb.spec.system import System

QUATERNION = ("w", "x", "y", "z")
"""Columns of an attitude, from body to earth."""
RATES = ("rate_x_dps", "rate_y_dps", "rate_z_dps")
Q15_PER_PERCENT = 327.68
ANGLE, MOTORS, STICKS, CHOICES, BATTERY = "ANGLES", "MOTORS", "STICKS", "CHOICES", "BATTERY"
"""Groups of the columns (`Column.frame`)."""
STALE_US = 1_000_000
"""Age from which on a voltage is not known any more."""


def quantities_of(columns: Sequence[Column], declared: System, params: ControlParams) -> list[Column]:
    """Of a table. params: at the beginning of the run; the pulses of the speed controllers do not change in one."""
    known = {column.name: column for column in columns}
    return [
        *_angles(known),
        *_motors(known, declared, params),
        *_sticks(known, declared),
        *_texts(known, declared),
    ]


def _angles(known: dict[str, Column]) -> Iterator[Column]:
    """Roll, pitch and yaw of an attitude, and the rate about the vertical, positive to the left seen from above."""
    if not all(name in known for name in QUATERNION):
        return
    w, x, y, z = (known[name].values.astype(np.float64) for name in QUATERNION)
    came = _all_known([known[name] for name in QUATERNION])
    for name, angle in ANGLES.items():
        yield Column(f"{name}_deg", "deg", np.degrees(angle(w, x, y, z)), came, ANGLE, replaces=QUATERNION)
    if not all(name in known for name in RATES):
        return
    up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    rate = np.einsum("in,in->n", np.stack(up), np.stack([known[name].values.astype(np.float64) for name in RATES]))
    yield Column("heading_rate_dps", "deg/s", rate, came & _all_known([known[name] for name in RATES]), ANGLE)


def _motors(known: dict[str, Column], declared: System, params: ControlParams) -> Iterator[Column]:
    """Duties, or commands of rotors by their pulses, in per cent of the full one."""
    carried = {part.name: part.word for frame in declared.frames for part in (frame.half, frame.word) if part}
    driving = {word.name for word in declared.output_words}
    parts = [(name, word) for name, word in carried.items() if word.name in driving]
    for name, word in parts:
        column = known.get(name if word.unit == "" else f"{name}_{word.unit}")
        if column is None:
            continue
        if declared.output == "ROTORS":
            middle, span = params["esc.mid_halfus"], params["esc.span_halfus"]
            share = np.clip((column.values.astype(np.float64) * 2.0 - middle) / span, 0.0, 1.0) * 100.0
        elif word.format == "Q15":
            share = column.values.astype(np.float64) * 100.0
        else:
            continue
        motor = name.removeprefix("pulse_")
        title = "motor_pct" if len(parts) == 1 else f"motor_{motor}_pct"
        same = (column.name,) if word.format == "Q15" else ()
        yield replace(column, name=title, unit="%", values=share, frame=MOTORS, replaces=same)


def _sticks(known: dict[str, Column], declared: System) -> Iterator[Column]:
    """Setpoint and commands that are shares, in per cent."""
    shares = {f"command_{command.name}": command.name for command in declared.step_commands if command.format == "Q15"}
    setpoint = declared.setpoint
    if setpoint.format == "Q15" and not setpoint.unit:
        shares = {"setpoint": setpoint.name.removeprefix("setpoint_").removesuffix("_q15"), **shares}
    for name, title in shares.items():
        if name in known:
            share = np.asarray(known[name].values / Q15_PER_PERCENT, np.float64)
            stick = f"stick_{title}_pct"
            yield replace(known[name], name=stick, unit="%", values=share, frame=STICKS, replaces=(name,))


def _texts(known: dict[str, Column], declared: System) -> Iterator[Column]:
    """Words of a record whose values are choices."""
    for word in declared.words:
        if word.choices and word.name in known:
            column = known[word.name]
            yield replace(column, name=f"{word.name}_text", frame=CHOICES, texts=word.choices)


def _all_known(columns: Sequence[Column]) -> BoolArray:
    there = np.ones(len(columns[0].values), np.bool_)
    for column in columns:
        there &= True if column.known is None else column.known
    return there


class Battery:
    """The voltage of the battery at the steps of a run, from the BATTERY frames of its log."""

    def __init__(self, recorded: RecordedRun) -> None:
        messages = recorded.log.protocol()
        times, volts = [0], [np.nan]
        if BATTERY in messages.messages:
            message = messages[BATTERY]
            for block in recorded.log.blocks():
                plain = (block["can_id"] & (EXTENDED | REMOTE | ERROR)) == 0
                for frame in block[plain & (block["can_id"] == message.identifier)]:
                    data = frame["data"].tobytes()
                    if check(message.identifier, data):
                        times.append(int(frame["time_us"]))
                        volts.append(message.decode(data)["voltage_mv"] / 1e3)
        self._times: npt.NDArray[np.int64] = np.array(times, np.int64)
        self._volts: FloatArray = np.array(volts)

    def columns(self, run: Steps) -> list[Column]:
        """One column; none of a board without a battery."""
        if len(self._volts) == 1:
            return []
        steps_us = np.maximum.accumulate(run.time_us)
        at = np.maximum(np.searchsorted(self._times, steps_us, "right") - 1, 0)
        volts = self._volts[at]
        known = ~np.isnan(volts) & (steps_us - self._times[at] < STALE_US)
        return [Column("battery_v", "V", np.where(known, volts, 0.0), known, BATTERY)]


class TruePlace:
    """The true place of a simulated vehicle at the steps of a run, between the times that its log has."""

    def __init__(self, recorded: RecordedRun) -> None:
        self._truth = {name: np.array(sorted(rows)) for name, rows in recorded.log.truth.items() if rows}

    def columns(self, run: Steps) -> list[Column]:
        """A column for each coordinate; none of a log that has no truth."""
        steps_us = np.maximum.accumulate(run.time_us)
        found = []
        for name, rows in self._truth.items():
            times_us, values = rows.T
            known = (steps_us >= times_us[0]) & (steps_us <= times_us[-1] + STALE_US)
            found.append(Column(name, "m", np.interp(steps_us, times_us, values), known, TRUTH))
        return found
