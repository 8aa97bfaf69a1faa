"""Signals of sensors at rest, from a recording: .npz or .csv of a three-axis sensor, or a log of `plumb record`.

A recording may move before and after: the longest rest in it is used. The signal is cut into blocks of BLOCK_S; a block
is at rest while no signal varies much more within it than in the quietest quarter of the blocks, and no gyro's mean is
off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.readers import log_replay, recording
from plumb.spec import declarations, parameters
from plumb.spec.arrays import BoolArray, FloatArray

BLOCK_S = 1.0
LEAST_REST_S = 10.0
MORE = 2.5
"""Times the standard deviation of a quiet block at which a block counts as moving."""
QUIET_SHARE = 0.25
LOUDEST = {"deg/s": 5.0, "g": 0.15}
"""Largest standard deviation within a second at rest: no gyro or accelerometer that plumb drives is noisier."""
LARGEST_DPS = 30.0
"""Largest distance of a gyro's mean from its mean in the quiet blocks: more is a turn, no drift of the bias."""
_PER_UNIT = {"turn/s": (360.0, "deg/s"), "g": (1.0, "g")}


@dataclass(frozen=True)
class Channel:
    """One signal. axis: x, y or z of the sensor, "" where it is not known; step: of its counts, 0 where not known."""

    name: str
    unit: str
    values: FloatArray
    axis: str = ""

    @property
    def rate(self) -> bool:
        """Whether it is a gyro; otherwise an accelerometer."""
        return self.unit == "deg/s"


@dataclass(frozen=True)
class Rest:
    """Signals at a constant period. first_s, last_s: the part of the recording that they are; whole_s: its length.
    system: whose board recorded it, "" for a recording of a three-axis sensor."""

    path: Path
    period_s: float
    channels: tuple[Channel, ...]
    first_s: float
    last_s: float
    whole_s: float
    system: str = ""

    def part(self, first_s: float, last_s: float) -> Rest:
        """The signals between two times of the recording; raises UsageError for fewer than LEAST_REST_S."""
        total = len(self.channels[0].values)
        limits = (min(max(at - self.first_s, 0.0), total * self.period_s) for at in (first_s, last_s))
        start, end = (round(at / self.period_s) for at in limits)
        cut = tuple(replace(one, values=one.values[start:end]) for one in self.channels)
        if len(cut[0].values) * self.period_s < LEAST_REST_S * (1.0 - 1e-6):
            raise UsageError(
                f"{self.path.name}: {first_s:g} s to {last_s:g} s is not {LEAST_REST_S:g} s of the recording, which "
                f"lasts {self.whole_s:.1f} s; let the sensor rest for some minutes"
            )
        begin_s = self.first_s + start * self.period_s
        return replace(self, channels=cut, first_s=begin_s, last_s=begin_s + len(cut[0].values) * self.period_s)


def load(path: Path) -> Rest:
    """The whole recording; raises UsageError with one sentence that names the fault."""
    return _of_log(path) if is_log(path) else _of_recording(path)


def is_log(path: Path) -> bool:
    """Whether a file is the log of a board, by its content, and not a recording in units."""
    return log_replay.is_log(path)


def _of_recording(path: Path) -> Rest:
    found = recording.load(path)
    values = np.column_stack([found.gyr_dps, found.acc_g])
    steps_s = np.diff(found.time_s)
    if float(np.max(steps_s)) > 1.5 * found.step_s or float(np.min(steps_s)) < 0.5 * found.step_s:
        values = recording.steady(found.time_s, values, round(found.step_s * 1e6))
        period_s = round(found.step_s * 1e6) * 1e-6
    else:
        period_s = float(found.time_s[-1]) / (len(values) - 1)
    names = [(f"{kind}_{axis}", unit, axis) for kind, unit in (("gyr", "deg/s"), ("acc", "g")) for axis in "xyz"]
    channels = tuple(
        Channel(name, unit, column, axis) for (name, unit, axis), column in zip(names, values.T, strict=True)
    )
    return _whole(path, period_s, channels)


def _of_log(path: Path) -> Rest:
    """Raw counts of a board by its calibration; lost steps repeat the one before."""
    params, raw = board_recording(path)
    channels = tuple(_calibrated(params, raw))
    if not channels:
        raise UsageError(f"{path} has no raw counts of calibrated gyros and accelerometers")
    return replace(_whole(path, params.period_s, channels), system=params.system)


def board_recording(path: Path) -> tuple[ControlParams, FloatArray]:
    """A log of a board: its parameters, with their unit of variance, and its raw counts, (steps, 6), of the run that is
    known best. A step without counts has those before it."""
    recorded = log_replay.chosen(log_replay.runs_of(log_replay.open_log(path)), None)
    if not recorded.run.raw_known.any():
        raise UsageError(f"{path} has no raw counts: record with --run live")
    known = recorded.run.raw_known
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), int(np.argmax(known))))
    return recorded.used.params, recorded.run.raw[last].astype(np.float64)


def _calibrated(params: ControlParams, raw: FloatArray) -> list[Channel]:
    """Channels of gyros and accelerometers in deg/s and g."""
    rows = {row.name: row for row in parameters.table()}
    found = []
    for counts, channel in zip(raw.T, declarations.system(params.system).channels, strict=False):
        row = rows.get(f"{channel.calibration}.offset")
        if row is None or row.unit not in _PER_UNIT:
            continue
        per_unit, unit = _PER_UNIT[row.unit]
        low, high = params[f"{channel.calibration}.raw_min"], params[f"{channel.calibration}.raw_max"]
        exact = np.clip(counts, low, high) * params[f"{channel.calibration}.gain"] + params.values[row.name]
        scaled = exact * (per_unit / 2.0 ** int(row.format[1:]))
        found.append(Channel(channel.name, unit, scaled, channel.axis[-1:]))
    return found


def _whole(path: Path, period_s: float, channels: tuple[Channel, ...]) -> Rest:
    length_s = len(channels[0].values) * period_s
    return Rest(path, period_s, channels, 0.0, length_s, length_s)


def longest_rest(whole: Rest) -> Rest:
    """The longest stretch at rest; raises UsageError where none lasts LEAST_REST_S."""
    quiet = _quiet_blocks(whole) if whole.whole_s >= LEAST_REST_S else np.zeros(0, np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(int), [0]])))
    runs = sorted(((int(end - start), int(start)) for start, end in zip(edges[::2], edges[1::2], strict=True)))
    blocks, start = runs[-1] if runs else (0, 0)
    margin = 0 if blocks == len(quiet) else 1  # a block next to a motion may hold its beginning
    first_s, last_s = (start + margin) * BLOCK_S, (start + blocks - margin) * BLOCK_S
    if last_s - first_s < LEAST_REST_S:
        raise UsageError(
            f"{whole.path.name} has no rest of {LEAST_REST_S:g} s: lay the sensor down and record some minutes; "
            "--begin and --end choose a part all the same"
        )
    return whole.part(first_s, whole.last_s if start + blocks == len(quiet) and not margin else last_s)


def _quiet_blocks(whole: Rest) -> BoolArray:
    """Which blocks are at rest, (blocks,)."""
    size = max(2, round(BLOCK_S / whole.period_s))
    blocks = len(whole.channels[0].values) // size
    quiet = np.ones(blocks, np.bool_)
    for channel in whole.channels:
        cut = channel.values[: blocks * size].reshape(blocks, size)
        spread = np.std(cut, axis=1)
        usual = max(float(np.quantile(spread, QUIET_SHARE)), 1e-9)
        quiet &= (spread <= MORE * usual) & (spread <= LOUDEST[channel.unit])
        if channel.rate:
            means = np.mean(cut, axis=1)
            quiet &= np.abs(means - float(np.median(means[spread <= MORE * usual]))) <= LARGEST_DPS
    return quiet
