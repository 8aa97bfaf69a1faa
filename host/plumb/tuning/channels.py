"""Convert physical quantities to a sensor's raw counts with a tuning's calibration; fit a tuning to another full
scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.spec.system import Channel as RawChannel
from plumb.spec.tuning import Channel

TuningT = TypeVar("TuningT")
NO_SAMPLE = -32768
"""Raw count of a channel without a sample, in systems whose missing samples are marked."""
COUNTS_MAX = 32766
"""Largest count of an ideal sensor: one less than the 16-bit maximum, so that a count outside the range exists."""
_PER_UNIT = {"turn/s": 1.0 / 360.0, "turn/s^2": 1.0 / 360.0, "g": 1.0}
"""Unit of a calibration -> its value in one deg/s, deg/s^2 or g."""


def ideal_channel(full_scale: float) -> Channel:
    """A sensor without offset and with the range +-full_scale (deg/s, deg/s^2 or g)."""
    return Channel(0.0, full_scale / COUNTS_MAX, -COUNTS_MAX, COUNTS_MAX)


def with_channels(tuning: TuningT, channels: Mapping[str, Channel]) -> TuningT:
    """The tuning with its channels replaced. channels: by name, which is that of the parameter group.

    Raises UsageError for a channel that the tuning does not have.
    """
    left = set(channels)

    def changed(settings: Any) -> Any:  # Any: a dataclass of any system's tuning
        new: dict[str, object] = {}
        for entry in fields(settings):
            value = getattr(settings, entry.name)
            if isinstance(value, Channel):
                if entry.name in channels:
                    new[entry.name] = channels[entry.name]
                    left.discard(entry.name)
            elif is_dataclass(value):
                new[entry.name] = changed(value)
        return replace(settings, **new)

    result: TuningT = changed(tuning)
    if left:
        raise UsageError(f"the tuning has no channel {', '.join(sorted(left))}")
    return result


def counts_of(params: ControlParams, channel: RawChannel, values: npt.ArrayLike) -> npt.NDArray[np.int16]:
    """Raw counts whose calibrated values are nearest to `values` (deg/s, deg/s^2 or g, any shape), limited to 16 bits.

    The step itself clamps and counts values outside the channel's range. Raises UsageError for a channel without
    calibration.
    """
    group = channel.calibration
    row = next((row for row in parameters.table() if row.name == f"{group}.offset"), None)
    if row is None or row.unit not in _PER_UNIT or not params[f"{group}.gain"]:
        raise UsageError(f"channel {channel.name} has no calibration that turns a quantity into counts")
    exact = np.asarray(values, np.float64) * (_PER_UNIT[row.unit] * 2.0 ** int(row.format[1:]))
    counts = np.rint((exact - params[f"{group}.offset"]) / params[f"{group}.gain"])
    return np.clip(counts, NO_SAMPLE + 1, -NO_SAMPLE - 1).astype(np.int16)


def values_of(params: ControlParams, channel: RawChannel, counts: npt.ArrayLike) -> npt.NDArray[np.float64] | None:
    """The calibrated values of raw counts, in deg/s, deg/s^2 or g; None for a channel without such a calibration."""
    group = channel.calibration
    row = next((row for row in parameters.table() if row.name == f"{group}.offset"), None)
    if row is None or row.unit not in _PER_UNIT:
        return None
    exact = np.asarray(counts, np.float64) * params[f"{group}.gain"] + params[f"{group}.offset"]
    return np.asarray(exact / (_PER_UNIT[row.unit] * 2.0 ** int(row.format[1:])), np.float64)
