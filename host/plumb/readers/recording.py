"""Read a recording of a real three-axis sensor, and convert one axis of it to raw counts for an estimator.

Files
    .npz  gyr (N, 3) rad/s, acc (N, 3) m/s^2 of specific force, rate_hz or time_s; ref_quat (N, 4) w, x, y, z from
          sensor frame to earth frame with z up, NaN if missing; movement (N,) bool, the samples to score;
          further arrays are ignored
    .csv  one header line; time_s, gyr_{x,y,z}_radps (or _dps), acc_{x,y,z}_mps2 (or _g), optionally ref_{w,x,y,z}
          (empty or nan if missing) and movement (0 or 1); further columns are ignored
    A table may also have the header of x-io, phyphox, AndroSensor or EuRoC, or one that names a time, a gyro
    and an accelerometer with their units, there or in the row below; comma, semicolon, tab or spaces, decimal commas,
    any encoding, gzip. Stamps may be dates or times of day. A magnetometer is read in its own unit. The suffix is free.
    PX4, blackbox_decode, Xsens MT and DOT, and ROS are known by their columns.
    A folder or zip of one table a sensor (Sensor Logger, phyphox), the text of a serial port, and a ULog file of PX4
    are read as well: plumb/readers/imu_files.

One axis. With u the vertical in sensor coordinates (the reading of an accelerometer at rest, in g), the tilt about an
axis is the angle of u in the plane perpendicular to it, and increases with a positive rotation about it:

    x: atan2(u_y, u_z)      y: atan2(-u_x, u_z)      z: atan2(u_x, u_y)

From u' = u x w follows for x (for y and z by cyclic exchange)

    tilt' = w_x - u_x (u_y w_y + u_z w_z) / (u_y^2 + u_z^2)

The one-axis filter models the first term only. The second is zero while the axis is level, which is the case the filter
is designed for. In general motion the accelerometer must correct the error that the second term adds, and about a
vertical axis tilt is undefined: samples with sqrt(u_y^2 + u_z^2) < 0.15 are singular and are not scored. The estimator
uses only the rate about the axis and the two accelerations perpendicular to it. A variance R that grows with
| |a|^2 - 1 | treats an inclined axis as a disturbance, so a constant R suits general motion better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.proof.runs import RunInputs
from plumb.readers import recording_files, stamps
from plumb.readers.recording_files import G_MPS2 as G_MPS2
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.tuning import AxisTuning, Calibration, Channel

Axis = Literal["x", "y", "z"]

SHORTEST_S = 2.0
LONGEST_GAP_S = 1.0
SINGULAR = 0.15
MOST_STEPS = 1 << 23
"""Most steps after resampling, which can have many more steps than the recording has samples."""
RATE_LIMIT_DPS, ACCEL_LIMIT_G = 2500.0, 27.5
"""Largest values accepted; the firmware's calibrated values reach 7 turn/s and 28 g."""
LEAST_SCALE_DPS, LEAST_SCALE_G = 25.0, 0.25
"""Smallest full scale of the ideal sensor. With a smaller one, the quantisation of the firmware's gains would exceed
the 0.1 % of a parameter, and a count is far below the noise of any sensor already."""
FULL_SCALE_COUNTS = 32_000
"""The ideal sensor is scaled to the recording: the largest sample of a channel becomes this count, of 32767."""

# Columns (and signs) that make tilt = atan2(first, second) about an axis.
_ACROSS: dict[str, tuple[tuple[int, float], tuple[int, float]]] = {
    "x": ((1, 1.0), (2, 1.0)),
    "y": ((0, -1.0), (2, 1.0)),
    "z": ((0, 1.0), (1, 1.0)),
}


@dataclass(frozen=True)
class Recording:
    """A recording. time_s (N,) from 0, increasing; gyr_dps (N, 3); acc_g (N, 3); ref_quat (N, 4) or None; movement
    (N,), all true if the file has none; notes: sentences on rows that were dropped and stamps that were spread."""

    path: Path
    time_s: FloatArray
    gyr_dps: FloatArray
    acc_g: FloatArray
    ref_quat: FloatArray | None
    movement: BoolArray
    notes: tuple[str, ...] = ()

    @property
    def step_s(self) -> float:
        """Median time between samples."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True)
class AxisInput:
    """One axis of a recording at a constant period. raw (steps, 6) int16: gyro, accel, accel_up, as the firmware names
    them; truth (steps,) deg, NaN without reference; scored (steps,): movement, with a reference, not singular."""

    axis: str
    period_us: int
    raw: npt.NDArray[np.int16]
    calibration: Calibration
    truth_deg: FloatArray
    scored: BoolArray
    singular: BoolArray

    @property
    def time_s(self) -> FloatArray:
        return np.arange(len(self.raw), dtype=np.float64) * (self.period_us * 1e-6)

    def first(self, steps: int) -> AxisInput:
        """The first `steps` steps."""
        cut = (self.raw[:steps], self.truth_deg[:steps], self.scored[:steps], self.singular[:steps])
        raw, truth_deg, scored, singular = cut
        return replace(self, raw=raw, truth_deg=truth_deg, scored=scored, singular=singular)


def load(path: Path | str) -> Recording:
    """Read and check a file; raises UsageError with one sentence that names the fault."""
    path = Path(path)
    return checked(path, recording_files.read(path))


def checked(path: Path, columns: dict[str, FloatArray]) -> Recording:
    """Columns of `recording_files.read` as a recording; raises UsageError with one sentence that names the fault."""
    time_s, gyr, acc = columns["time_s"], columns["gyr"], columns["acc"]
    n = len(time_s) if time_s.ndim == 1 else -1
    if n < 1 or gyr.shape != (n, 3) or acc.shape != (n, 3):
        raise UsageError(f"{path.name}: gyr {gyr.shape} and acc {acc.shape} are not (N, 3) for {n} time stamps")
    for name, values in (("time_s", time_s), ("gyr", gyr), ("acc", acc)):
        bad = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(1))
        if len(bad):
            raise UsageError(f"{path.name}: {name} of sample {bad[0]} is not a number; cut or repair the recording")
    quat, movement = columns.get("ref_quat"), columns.get("movement", np.ones(n))
    if (quat is not None and quat.shape != (n, 4)) or movement.shape != (n,):
        raise UsageError(f"{path.name}: ref_quat is not (N, 4), or movement not (N,), for {n} samples")
    kept, time_s, notes = _one_stamp_a_row(time_s, gyr, acc)
    gyr, acc, movement, n = gyr[kept], acc[kept], movement[kept], len(time_s)
    quat = None if quat is None else quat[kept]
    steps_s = np.diff(time_s)
    if (steps_s <= 0.0).any():
        raise UsageError(f"{path.name}: time stands still or runs back at sample {int(np.argmax(steps_s <= 0.0)) + 1}")
    if n < 2 or time_s[-1] - time_s[0] < SHORTEST_S:
        raise UsageError(f"{path.name} is too short: {n} samples; {SHORTEST_S:g} s are needed")
    if np.max(steps_s) > LONGEST_GAP_S:
        gap_s = float(np.max(steps_s))
        gap = f"{gap_s:.1f}" if gap_s < 1e6 else f"{gap_s:.3g}"
        raise UsageError(f"{path.name} has a gap of {gap} s at sample {int(np.argmax(steps_s)) + 1}")
    if np.max(np.abs(gyr)) > RATE_LIMIT_DPS or np.max(np.abs(acc)) > ACCEL_LIMIT_G:
        limits = f"{RATE_LIMIT_DPS:g} deg/s or {ACCEL_LIMIT_G:g} g"
        raise UsageError(f"{path.name} exceeds {limits}; are its units those of the format?")
    moving = np.nan_to_num(movement) != 0.0
    return Recording(path, time_s - time_s[0], gyr, acc, quat, moving, tuple(notes))


def _one_stamp_a_row(time_s: FloatArray, gyr: FloatArray, acc: FloatArray) -> tuple[BoolArray, FloatArray, list[str]]:
    """Rows that are kept, (N,), their stamps, and a sentence on each change: rows that are the same as the one before
    are dropped, stamps that a batch shares are spread inside it. A clock that never steps forward stays as it is."""
    notes = []
    same = stamps.repeats(time_s, gyr, acc)
    if same.any():
        notes.append(f"{int(same.sum())} of {len(same)} rows are dropped: each is the same as the one before it")
    own_s = time_s[~same]
    steps_s = np.diff(own_s)
    shared = int(np.sum(steps_s == 0.0))
    if shared and not (steps_s < 0.0).any() and (steps_s > 0.0).any():
        notes.append(
            f"{shared} of {len(own_s)} stamps are those of the row before: each batch is spread to the next stamp"
        )
        own_s = stamps.spread(own_s)
    return ~same, own_s, notes


def steady(time_s: FloatArray, values: FloatArray, period_us: int) -> FloatArray:
    """Resample to a constant period from 0 s, (N, c) -> (steps, c). The time stamps need not be regular.

    Interpolates linearly. For a period longer than the recording's, takes the mean of the interpolation over one period
    around each instant, so that fast motion does not alias.
    """
    period_s = period_us * 1e-6
    at_s = np.arange(math.floor(time_s[-1] / period_s + 1e-9) + 1) * period_s
    half_s = 0.5 * period_s
    if period_s <= float(np.median(np.diff(time_s))) * 1.0001:
        return np.stack([np.interp(at_s, time_s, column) for column in values.T], 1)
    area = np.zeros_like(values)
    area[1:] = np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s)[:, None], axis=0)
    early, late = np.maximum(at_s - half_s, 0.0), np.minimum(at_s + half_s, time_s[-1])
    return np.stack(
        [
            (_area_at(late, time_s, column, a) - _area_at(early, time_s, column, a)) / (late - early)
            for column, a in zip(values.T, area.T, strict=True)
        ],
        1,
    )


def _area_at(at_s: FloatArray, time_s: FloatArray, value: FloatArray, area: FloatArray) -> FloatArray:
    i = np.clip(np.searchsorted(time_s, at_s, "right") - 1, 0, len(time_s) - 2)
    into_s = at_s - time_s[i]
    slope = (value[i + 1] - value[i]) / (time_s[i + 1] - time_s[i])
    return np.asarray(area[i] + into_s * (value[i] + 0.5 * slope * into_s), np.float64)


def block_means(values: FloatArray, block: int) -> FloatArray:
    """The mean of every `block` rows, (N, c) -> (N // block, c): what a sensor with a lower output rate delivers."""
    blocks = len(values) // block
    return np.asarray(values[: blocks * block].reshape(blocks, block, -1).mean(axis=1), np.float64)


def decimated(recording: Recording, block: int) -> Recording:
    """A recording of a sensor with a rate that is `block` times lower: means of blocks. Time, reference and mark of a
    block are those of its last sample, when an estimator that has this block is asked.

    Time stamps that stray from an even grid are taken as they are. Raises UsageError for a recording that becomes too
    short.
    """
    if block == 1:
        return recording
    last = np.arange(len(recording.time_s) // block) * block + block - 1
    if len(last) < 2:
        raise UsageError(f"{recording.path.name} has {len(recording.time_s)} samples: too few for --decimate {block}")
    time_s = recording.time_s[last]
    quat = None if recording.ref_quat is None else recording.ref_quat[last]
    return Recording(
        recording.path,
        time_s - time_s[0],
        block_means(recording.gyr_dps, block),
        block_means(recording.acc_g, block),
        quat,
        recording.movement[last],
        recording.notes,
    )


def vertical(ref_quat: FloatArray) -> FloatArray:
    """The vertical in sensor coordinates, u = R(q)^T [0 0 1], (N, 4) -> (N, 3); NaN without a reference."""
    length = np.linalg.norm(ref_quat, axis=1, keepdims=True)
    w, x, y, z = (ref_quat / np.where((length > 0.0) & np.isfinite(length), length, np.nan)).T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], 1)


def pick_axis(recording: Recording, axis: str, period_us: int | None = None) -> AxisInput:
    """Counts of an ideal sensor for one axis, and the true tilt. axis: x, y or z. period_us None: the recording's own.

    Raises UsageError for another axis, a period outside 500 to 100000 us, and too many steps.
    """
    if axis not in _ACROSS:
        raise UsageError(f"'{axis}' is no axis; use x, y or z")
    if period_us is None:
        period_us = round(recording.step_s * 1e6)
    if not 500 <= period_us <= 100_000:
        raise UsageError(f"a period of {period_us} us is outside 500 to 100000 us; resample with --period-us")
    if recording.time_s[-1] > MOST_STEPS * period_us * 1e-6:
        most = f"more than {MOST_STEPS} steps of {period_us} us"
        raise UsageError(f"{recording.path.name} lasts {most}: cut it, or take a longer --period-us")
    (first, sign), (second, _) = _ACROSS[axis]
    signals = np.column_stack(
        [recording.gyr_dps[:, "xyz".index(axis)], sign * recording.acc_g[:, first], recording.acc_g[:, second]]
    )
    signals = steady(recording.time_s, signals, period_us)
    raw = np.zeros((len(signals), 6), np.int16)
    channels = []
    for c, least in enumerate((LEAST_SCALE_DPS, LEAST_SCALE_G, LEAST_SCALE_G)):
        unit = max(float(np.max(np.abs(signals[:, c]))), least) / FULL_SCALE_COUNTS
        raw[:, c] = np.rint(signals[:, c] / unit).astype(np.int16)
        channels.append(
            Channel(zero_counts=0.0, unit_per_count=unit, min_counts=-FULL_SCALE_COUNTS, max_counts=FULL_SCALE_COUNTS)
        )
    at_s = np.arange(len(raw)) * (period_us * 1e-6)
    near = np.clip(np.rint(np.interp(at_s, recording.time_s, np.arange(len(recording.time_s)))), 0, None).astype(int)
    truth_deg, singular = np.full(len(raw), np.nan), np.zeros(len(raw), np.bool_)
    if recording.ref_quat is not None:
        # Interpolated between the two neighbours; missing if one of them is.
        u = vertical(recording.ref_quat)
        up = np.stack([np.interp(at_s, recording.time_s, column) for column in u.T], 1)
        across = np.hypot(up[:, first], up[:, second])
        truth_deg = np.degrees(np.arctan2(sign * up[:, first], up[:, second]))
        singular = across < SINGULAR
    scored = recording.movement[near] & np.isfinite(truth_deg) & ~singular
    return AxisInput(axis, period_us, raw, Calibration(*channels), truth_deg, scored, singular)


def run_inputs(axis: AxisInput, tuning: AxisTuning) -> tuple[RunInputs, ControlParams]:
    """Inputs and parameters of a run on one axis of a recording; the tuning is adapted to its sensor and period."""
    steps = len(axis.raw)
    truth = {"tilt_deg": axis.truth_deg, "bias_dps": np.full(steps, np.nan)}
    inputs = RunInputs(axis.time_s, truth, axis.raw, np.zeros(steps, np.int32), axis.scored)
    return inputs, quantise(replace(tuning, calibration=axis.calibration, period_us=axis.period_us))


def steps_in(seconds: float, period_us: int, most: int) -> int:
    """Steps in `seconds`, at most `most`; raises UsageError for less than one period."""
    if not seconds * 1e6 >= period_us:
        raise UsageError(f"{seconds:g} s is less than one period of {period_us} us")
    return int(min(seconds * 1e6 / period_us + 0.5, most))
