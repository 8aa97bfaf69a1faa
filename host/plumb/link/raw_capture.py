"""Listen to the raw counts of a run on the board's own sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.spec.arrays import FloatArray
from plumb.spec.protocol import Frame
from plumb.tuning.channels import NO_SAMPLE
from plumb.tuning.pose_calibration import Reading

CHANNELS_PER_FRAME = 3


def begin(session: Session, channels: Mapping[str, int]) -> None:
    """Begin a disarmed run that sends the raw counts of these channels. channels: name -> number."""
    frames = sorted({RAW_FRAMES[number // CHANNELS_PER_FRAME] for number in channels.values()})
    session.begin("REALTIME_LIVE", frames=frames)


def capture(session: Session, channels: Mapping[str, int], seconds: float, period_us: int) -> Reading:
    """The counts of these channels within so many seconds of the session's clock. Raises LinkError when the link
    fails; counts that do not come are missing from the reading."""
    return reading_of(counts(session, channels, seconds), round(seconds * 1e6 / period_us), seconds)


def counts(session: Session, channels: Mapping[str, int], seconds: float) -> dict[str, list[int]]:
    """The counts that come within so many seconds of the session's clock, by channel. Raises LinkError."""
    found: dict[str, list[int]] = {name: [] for name in channels}
    messages = {session.protocol[name].identifier: (name, index) for index, name in enumerate(RAW_FRAMES)}

    def feed(frames: list[Frame]) -> None:
        for identifier, data in frames:
            if identifier in messages:
                frame, index = messages[identifier]
                words = session.protocol[frame].decode(data)
                for name, number in channels.items():
                    if number // CHANNELS_PER_FRAME == index:
                        found[name].append(words[f"raw_{number}"])

    session.listener = feed
    try:
        end_s = session.clock() + seconds
        while (left_s := end_s - session.clock()) > 0:
            session.receive(left_s)
    finally:
        session.listener = None
    return found


def vectors(axes: Sequence[Sequence[int]]) -> FloatArray:
    """Counts of three axes, in one frame, as (samples, 3); without the steps for which the board had no sample."""
    rows = np.asarray(axes, np.float64).T
    return np.asarray(rows[np.all(rows != NO_SAMPLE, axis=1)])


def reading_of(taken: Mapping[str, list[int]], expected: int, seconds: float) -> Reading:
    """Means, deviations and drifts of the counts of each channel; 0 where none came."""
    arrays = {name: np.asarray(values or [0], np.float64) for name, values in taken.items()}
    halves = {name: (values[: (len(values) + 1) // 2], values[len(values) // 2 :]) for name, values in arrays.items()}
    return Reading(
        mean={name: float(values.mean()) for name, values in arrays.items()},
        deviation={name: float(values.std()) for name, values in arrays.items()},
        drift={name: float(late.mean() - early.mean()) for name, (early, late) in halves.items()},
        samples=min(len(values) for values in taken.values()),
        expected=expected,
        seconds=seconds,
    )
