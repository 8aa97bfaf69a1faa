"""Limits of a sensor in its samples: clipped, wrapped around, held."""

from __future__ import annotations

import numpy as np

from plumb.audit.findings import Finding, fault, note
from plumb.audit.mends import unwrapped
from plumb.audit.samples import Samples
from plumb.spec.arrays import BoolArray, FloatArray

FULL_COUNTS = 32768
SHORTEST_CLIP = 3
"""Samples in a row at one end of the range."""
ENTRY_QUANTA = 6.0
"""Least fall beside a clip, within half of its length: a slow peak dwells on its last count, too."""
NEXT_COUNTS = 4
"""At the end of the range more samples stand than at any of so many counts inside it: a steady turn dwells there,
too, but most of it beside its largest count."""
MANY = 1e-3
"""Share of clipped samples from which a recording is at fault."""
LEAST_STAY = 4.0
"""Samples between two wraps, in the middle: a vibration at a quarter of the rate jumps between two samples, too."""
HELD_SHARE = 0.2
DEAD_TURN_DEG = 30.0
"""Turn of the accelerometer that a gyro cannot miss: pushes alone do not lean it so far for half a second."""
STEADY = 0.9
"""Least length of the mean of directions in which the acceleration is steady."""
NAMES = {"gyr": "gyro", "acc": "accelerometer"}


def quantum(values: FloatArray) -> float:
    """Smallest step between two different values of (N,); 0 for none."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    steps = steps[steps > 1e-12 * max(float(np.max(np.abs(values), initial=0.0)), 1e-12)]
    return float(steps.min()) if len(steps) else 0.0


def span_of(values: FloatArray, unit: float) -> float:
    """The range of the counter: 65536 counts where the values are counts of that, else twice the largest value."""
    most = float(np.max(np.abs(values)))
    full = FULL_COUNTS * unit
    return 2.0 * full if most <= full * (1.0 + 1e-6) < 1.1 * most else 2.0 * most


def wraps(values: FloatArray, span: float) -> int:
    """Wraps of (N,), 0 unless they go around and come back, and all but a few continue the line before them."""
    steps = np.diff(values)
    at = np.flatnonzero(np.abs(steps) > 0.5 * span)
    at = at[at > 0]
    if len(at) < 2 or np.median(np.diff(at)) < LEAST_STAY:
        return 0
    around = steps[at] - span * np.sign(steps[at])
    turns = np.sign(steps[at])
    # From one end of the range to the other, by no more than a quarter of it, and no further than the line before.
    before = values[at] - values[at - 1]
    before = np.where(np.abs(before) > 0.5 * span, before - span * np.sign(before), before)
    ends = np.minimum(np.abs(values[at]), np.abs(values[at + 1])) > 0.2 * span
    good = (np.abs(around) < 0.25 * span) & (np.abs(around - before) < 0.15 * span) & ends
    height = np.abs(np.cumsum(turns))
    comes_back = height[-1] == 0 and height.max() <= 2
    return len(at) if comes_back and np.mean(good) > 0.9 else 0


def wrap_findings(samples: Samples) -> list[Finding]:
    found = []
    for name, values in (("gyr", samples.gyr_dps), ("acc", samples.acc_g)):
        of_axes = []
        for axis, column in zip("xyz", values.T, strict=True):
            span = span_of(column, quantum(column)) if np.ptp(column) > 0.0 else 0.0
            if span and (count := wraps(column, span)):
                of_axes.append((count, span, axis))
        if of_axes:
            span = float(np.median([one[1] for one in of_axes]))
            said = ", ".join(f"{count} on {axis}" for count, _, axis in of_axes)
            text = (
                f"{NAMES[name]} jumps from {span / 2:+.5g} to {-span / 2:+.5g} and goes on ({said}): counts of 16 bits "
                "wrapped around"
            )
            total = sum(one[0] for one in of_axes)
            found.append(fault(f"{NAMES[name]}-wrap", "sure", text, f"{name}^{span:.8g}", jumps=total, span=span))
    return found


def clipped(column: FloatArray) -> tuple[BoolArray, int]:
    """Samples at an end of the range in runs of SHORTEST_CLIP that are entered or left fast; the number of
    these runs."""
    marked, runs = np.zeros(len(column), np.bool_), 0
    unit = quantum(column)
    if not unit:
        return marked, 0
    for end in (float(column.max()), float(column.min())):
        if not _piled_up(column, end, unit):
            continue
        at = np.concatenate([[False], column == end, [False]])
        edges = np.flatnonzero(np.diff(at.astype(np.int8)))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            if last - first < SHORTEST_CLIP:
                continue
            # A smooth peak that dwells on its last count falls by three counts over half of that time.
            reach = (last - first) // 2
            entry = abs(end - column[max(first - reach, 0)])
            leave = abs(end - column[min(last - 1 + reach, len(column) - 1)])
            if max(entry, leave) >= ENTRY_QUANTA * unit:
                marked[first:last] = True
                runs += 1
    return marked, runs


def _piled_up(column: FloatArray, end: float, unit: float) -> bool:
    inside = np.rint(np.abs(end - column) / unit)
    counts = np.bincount(inside[inside <= NEXT_COUNTS].astype(np.int64), minlength=NEXT_COUNTS + 1)
    return bool(counts[0] > counts[1:].max())


def clip_findings(samples: Samples, held: dict[str, BoolArray]) -> tuple[list[Finding], BoolArray]:
    """Findings, and samples (N,) at which a channel is clipped."""
    found, anywhere = [], np.zeros(len(samples), np.bool_)
    for name, unit, values in (("gyr", "deg/s", samples.gyr_dps), ("acc", "g", samples.acc_g)):
        said, most = [], 0
        for axis, column in zip("xyz", values.T, strict=True):
            marked, _ = clipped(column)
            marked &= ~held[name]
            count = int(marked.sum())
            if count:
                said.append(f"{count} on {axis}, at {np.max(np.abs(column[marked])):.5g}")
                anywhere |= marked
                most = max(most, count)
        if said:
            text = f"{NAMES[name]} stands at an end of its range ({', '.join(said)} {unit} as read): clipped"
            if most >= max(5, MANY * len(samples)):
                text += "; record with a larger range"
                found.append(fault(f"{NAMES[name]}-clip", "sure", text, samples=most))
            else:
                found.append(note(f"{NAMES[name]}-clip", text, samples=most))
    return found, anywhere


def held_rows(values: FloatArray) -> BoolArray:
    """Rows (N,) the same as the one before."""
    return np.concatenate([[False], np.all(np.diff(values, axis=0) == 0.0, axis=1)])


def held_findings(samples: Samples) -> tuple[list[Finding], dict[str, BoolArray]]:
    """Findings, and the held rows of each sensor while it moves."""
    found, rows = [], {}
    for name, values in (("gyr", samples.gyr_dps), ("acc", samples.acc_g)):
        same = held_rows(values)
        busy = _busy(values)
        rows[name] = same & busy
        if name == "gyr" and same[1:].all() and (turn_deg := _turn_deg(samples)) > DEAD_TURN_DEG:
            text = f"gyro is the same in every row while the accelerometer turns by {turn_deg:.0f} deg: it is not read"
            found.append(fault("gyro-dead", "sure", text, turn_deg=turn_deg))
            continue
        moving, held = int(busy.sum()), int(rows[name].sum())
        longest = _longest(rows[name])
        long_s = longest * samples.step_s
        if moving < 20 or not (held > HELD_SHARE * moving or (long_s > 0.1 and longest > 4)):
            continue
        text = f"{NAMES[name]} holds its sample in {held} of {moving} rows in motion, at most {longest + 1} rows alike"
        if held > HELD_SHARE * moving:
            text += f": it is {moving / max(moving - held, 1):.2g} times slower than the file"
        found.append(fault(f"{NAMES[name]}-held", "sure", text, f"{name}:fill", rows=held, longest=longest + 1))
    return found, rows


def _turn_deg(samples: Samples) -> float:
    """Largest angle between the acceleration of the first steady half second and that of another, in deg; 0 for none.
    It is steady where the mean of its directions is nearly 1 long."""
    size = max(1, round(0.5 / samples.step_s))
    rows = len(samples) // size * size
    length = np.linalg.norm(samples.acc_g[:rows], axis=1, keepdims=True)
    means = (samples.acc_g[:rows] / np.maximum(length, 1e-12)).reshape(-1, size, 3).mean(1)
    steady = means[np.linalg.norm(means, axis=1) > STEADY]
    if len(steady) < 2:
        return 0.0
    steady /= np.linalg.norm(steady, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip(steady @ steady[0], -1.0, 1.0))).max())


def _busy(values: FloatArray) -> BoolArray:
    """Rows near which samples change by far more than their quantum, so that two alike are no chance."""
    change = np.max(np.abs(np.diff(values, axis=0, prepend=values[:1])), axis=1)
    units = [quantum(column) for column in values.T]
    large = change > 8.0 * max(max(units), 1e-12)
    reach = 12
    count = np.convolve(large, np.ones(2 * reach + 1))[reach : reach + len(large)]  # "same" is longer for few rows
    return np.asarray(count >= 3)


def _longest(marked: BoolArray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


__all__ = ["clip_findings", "clipped", "held_findings", "quantum", "unwrapped", "wrap_findings", "wraps"]
