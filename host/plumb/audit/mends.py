"""Undo a fault of a recording: each mend is one word, which `plumb check` names and `--mend` takes.

gyr*57.2958, acc*0.101972, time*0.001    multiply
gyr:+y+x+z, acc:-x+y+z, both:+x-y-z      for each of x, y, z: the axis as read, with its sign
gyr<0.1, ref<0.1                         the sensor is late by so many seconds: take its later samples
gyr^4000                                 undo wraps of counts, of a range of 4000 in units as read
gyr:fill                                 draw lines between held samples
time:spread, time:sort                   spread stamps that are the same; put the rows in order of time
rows:a-b, rows:new, rows:finite          keep rows a to b (from 0, b not included), those not the same as the one
                                         before, those without missing values
ref:wxyz, ref:turned, ref:ned            the reference's w is last; it turns earth to body; its z points down
ref:x-up, ref:y-up                       another axis of the reference points up
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plumb.audit import signed_axes
from plumb.audit.samples import Samples
from plumb.errors import UsageError
from plumb.readers import stamps
from plumb.spec.arrays import FloatArray

SENSORS = {"gyr": "gyr_dps", "acc": "acc_g", "time": "time_s"}
SENSORS_BOTH = ["gyr_dps", "acc_g"]
REFERENCES = ("ref:wxyz", "ref:turned", "ref:ned", "ref:x-up", "ref:y-up")
_NUMBER = r"([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)"
_SCALE, _LATE = re.compile(rf"(gyr|acc|time)\*{_NUMBER}"), re.compile(rf"(gyr|ref)<{_NUMBER}")
_WRAP, _AXES = re.compile(rf"(gyr|acc)\^{_NUMBER}"), re.compile(r"(gyr|acc|both):([-+][xyz][-+][xyz][-+][xyz])")
_ROWS = re.compile(r"rows:([0-9]+)-([0-9]+)")


def mended(samples: Samples, mends: Sequence[str]) -> Samples:
    """With all of them undone, in this order; raises UsageError for a word that is none, or leaves no samples."""
    for mend in mends:
        samples = _mended(samples, mend)
        if len(samples) < 2:
            raise UsageError(f"--mend {mend} leaves {len(samples)} samples")
    return samples


def _mended(samples: Samples, mend: str) -> Samples:
    if found := _SCALE.fullmatch(mend):
        name = SENSORS[found[1]]
        return replace(samples, **{name: getattr(samples, name) * _number(found[2], mend)})
    if (found := _AXES.fullmatch(mend)) and (axes := signed_axes.of_name(found[2])) is not None:
        names = SENSORS_BOTH if found[1] == "both" else [SENSORS[found[1]]]
        return replace(samples, **{name: getattr(samples, name) @ axes.T for name in names})
    if found := _LATE.fullmatch(mend):
        return _earlier(samples, found[1], _number(found[2], mend))
    if found := _WRAP.fullmatch(mend):
        name = SENSORS[found[1]]
        return replace(samples, **{name: unwrapped(getattr(samples, name), abs(_number(found[2], mend)))})
    if found := _ROWS.fullmatch(mend):
        return samples.rows(np.arange(int(found[1]), min(int(found[2]), len(samples))))
    if mend in ("gyr:fill", "acc:fill"):
        name = SENSORS[mend[:3]]
        return replace(samples, **{name: filled(samples.time_s, getattr(samples, name))})
    return _by_name(samples, mend)


def _by_name(samples: Samples, mend: str) -> Samples:
    if mend == "time:spread":
        return samples.with_time(stamps.spread(samples.time_s))
    if mend == "time:sort":
        return samples.rows(np.argsort(samples.time_s, kind="stable"))
    if mend == "rows:new":
        return samples.rows(~repeats(samples))
    if mend == "rows:finite":
        return samples.rows(finite(samples))
    if mend in REFERENCES:
        q = samples.ref_quat
        return samples if q is None else replace(samples, ref_quat=reference(q, mend))
    raise UsageError(f"'{mend}' is no mend; `plumb check FILE` names those that a file needs")


def reference(q: FloatArray, mend: str) -> FloatArray:
    """The reference (N, 4) in another convention."""
    if mend == "ref:wxyz":
        return np.asarray(q[:, [3, 0, 1, 2]], np.float64)
    if mend == "ref:turned":
        return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]), np.float64)
    w, x, y, z = q.T
    if mend == "ref:y-up":  # a quarter of a turn about the earth's x
        return np.asarray(np.stack([w - x, x + w, y - z, z + y], 1) * np.sqrt(0.5), np.float64)
    if mend == "ref:x-up":  # back by a quarter of a turn about the earth's y
        return np.asarray(np.stack([w + y, x - z, y - w, z + x], 1) * np.sqrt(0.5), np.float64)
    # Earth axes north, east, down to east, north, up: half a turn about the line between north and east.
    return np.asarray(np.stack([-(x + y), w + z, w - z, y - x], 1) * np.sqrt(0.5), np.float64)


def _number(text: str, mend: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value) or value == 0.0:
        raise UsageError(f"--mend {mend}: give a number that is not 0")
    return value


def _earlier(samples: Samples, sensor: str, late_s: float) -> Samples:
    """A sensor's samples of late_s after each stamp; rows without one are left out."""
    at_s = samples.time_s + late_s
    inside = (at_s >= samples.time_s[0]) & (at_s <= samples.time_s[-1])
    if sensor == "gyr":
        moved = np.stack([np.interp(at_s, samples.time_s, column) for column in samples.gyr_dps.T], 1)
        return replace(samples, gyr_dps=moved).rows(inside)
    if samples.ref_quat is None:
        return samples
    near = np.clip(np.searchsorted(samples.time_s, at_s), 1, len(samples) - 1)
    before, after = samples.ref_quat[near - 1], samples.ref_quat[near]
    part = ((at_s - samples.time_s[near - 1]) / np.diff(samples.time_s)[near - 1])[:, None]
    after = np.where(np.sum(before * after, axis=1, keepdims=True) < 0.0, -after, after)
    mixed = (1.0 - part) * before + part * after
    length = np.linalg.norm(mixed, axis=1, keepdims=True)
    return replace(samples, ref_quat=mixed / np.where(length > 0.0, length, 1.0)).rows(inside)


def unwrapped(values: FloatArray, span: float) -> FloatArray:
    """Without wraps of a range of `span`, (N, c); the first sample is right."""
    return np.asarray(np.unwrap(values, period=span, axis=0), np.float64)


def filled(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """With lines between the rows that differ from the one before."""
    new = np.concatenate([[True], np.any(np.diff(values, axis=0) != 0.0, axis=1)])
    return np.stack([np.interp(time_s, time_s[new], column) for column in values[new].T], 1)


def repeats(samples: Samples) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows whose stamp and samples are those of the row before."""
    return stamps.repeats(samples.time_s, samples.gyr_dps, samples.acc_g)


def finite(samples: Samples) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    table = np.column_stack([samples.time_s, samples.gyr_dps, samples.acc_g])
    return np.asarray(np.isfinite(table).all(axis=1))
