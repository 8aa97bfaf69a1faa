"""What the sensors read at rest: bias, noise, the length of gravity, the axis that points up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit.findings import Finding, fault, note
from plumb.audit.samples import Samples
from plumb.spec.arrays import FloatArray

WINDOW_S = 0.5
QUIET = 0.03
"""Standard deviation of the acceleration in a window at rest, of its length."""
QUIET_DPS, SLOW_DPS = 2.0, 25.0
"""Standard deviation and mean of a gyro at rest."""
SAME_DPS = 3.0
"""Means of a gyro at rest are those of its bias; further from the least of them a body turns steadily, as a vehicle in
a bend does, whose acceleration is not that of gravity alone."""
LENGTH_OFF = 0.05
TURNED_OVER = "both:+x-y-z"
"""Half a turn about x, of both sensors."""
UP = 0.8
"""Share of gravity on one axis for it to point up."""


@dataclass(frozen=True)
class Rests:
    """Means (windows, 3) and standard deviations of the windows at rest, in the order of time."""

    gyr_dps: FloatArray
    acc_g: FloatArray
    gyr_noise_dps: FloatArray
    acc_noise_g: FloatArray

    def __len__(self) -> int:
        return len(self.acc_g)


def quiet_length(samples: Samples) -> tuple[float, float, bool]:
    """Median length of the acceleration, as read, the spread of its middle half, of it, and whether it is that of rest:
    windows in which it does not change."""
    means, spreads = _windows(samples.acc_g, samples.step_s)
    lengths = np.linalg.norm(means, axis=1)
    quiet = np.max(spreads, axis=1) < QUIET * np.maximum(lengths, 1e-12)
    used = lengths[quiet] if np.sum(quiet) >= 2 else np.linalg.norm(samples.acc_g, axis=1)
    length = float(np.median(used))
    low, high = np.percentile(used, [25.0, 75.0])
    return length, float(high - low) / max(length, 1e-12), bool(np.sum(quiet) >= 2)


def rests_of(samples: Samples) -> Rests:
    """Of samples whose units are mended."""
    gyr, gyr_spread = _windows(samples.gyr_dps, samples.step_s)
    acc, acc_spread = _windows(samples.acc_g, samples.step_s)
    lengths = np.linalg.norm(acc, axis=1)
    at_rest = (
        (np.max(acc_spread, axis=1) < QUIET * lengths)
        & (np.max(gyr_spread, axis=1) < QUIET_DPS)
        & (np.max(np.abs(gyr), axis=1) < SLOW_DPS)
        & (np.abs(lengths - 1.0) < 0.3)
    )
    if at_rest.any():
        least = gyr[at_rest][np.argmin(np.linalg.norm(gyr[at_rest], axis=1))]
        at_rest &= np.max(np.abs(gyr - least), axis=1) < SAME_DPS
    return Rests(gyr[at_rest], acc[at_rest], gyr_spread[at_rest], acc_spread[at_rest])


def _windows(values: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Means and standard deviations (windows, 3) of windows of WINDOW_S, ten samples at least."""
    points = max(10, round(WINDOW_S / step_s)) if step_s > 0.0 else 10
    count = len(values) // points
    if not count:
        return np.zeros((0, 3)), np.zeros((0, 3))
    shaped = values[: count * points].reshape(count, points, 3)
    return shaped.mean(1), shaped.std(1)


def rest_findings(samples: Samples, rests: Rests) -> list[Finding]:
    """Bias, noise and length; up_finding is apart, because a reference may decide it."""
    if not len(rests):
        return [note("rest", "never at rest: bias and noise are not measured", "unknown")]
    bias, noise = np.median(rests.gyr_dps, axis=0), np.median(rests.gyr_noise_dps, axis=0)
    length, acc_noise = float(np.median(np.linalg.norm(rests.acc_g, axis=1))), np.median(rests.acc_noise_g, axis=0)
    seconds = len(rests) * max(WINDOW_S, 10 * samples.step_s)
    found = [
        note(
            "rest",
            f"at rest for {seconds:.3g} s: gyro bias {_three(bias, 2)} deg/s, noise {_three(noise, 3)} deg/s, "
            f"accelerometer noise {_three(1e3 * acc_noise, 2)} mg a sample",
            seconds=seconds,
            bias_dps=bias.tolist(),
            gyro_noise_dps=noise.tolist(),
            accel_noise_g=acc_noise.tolist(),
        )
    ]
    if abs(length - 1.0) > LENGTH_OFF:
        text = f"length at rest {length:.3f} g: offset or scale of the accelerometer; `plumb calibrate` measures them"
        found.append(fault("accelerometer-length", "likely", text, length_g=length))
    else:
        found.append(note("accelerometer-length", f"length at rest {length:.3f} g", length_g=length))
    return found


def up_finding(rests: Rests, settled: bool) -> list[Finding]:
    """The axis that points up in the first rest. settled: a reference has judged the sign."""
    if not len(rests):
        return []
    first = rests.acc_g[0]
    at = int(np.argmax(np.abs(first)))
    value, axis = float(first[at]), "xyz"[at]
    if abs(value) < UP * np.linalg.norm(first):
        return [note("up", f"inclined in the first rest: reads {_three(first, 2)} g", up_g=first.tolist())]
    if value < 0.0 and axis == "z" and not settled:
        text = (
            f"the axis that points up at rest reads {value:.2f} g on {axis}: the accelerometer has the other sign "
            "(reads gravity), or z points down"
        )
        return [fault("accelerometer-sign", "likely", text, "acc*-1", TURNED_OVER, up_g=first.tolist())]
    side = "up" if value > 0.0 else "down"
    return [note("up", f"{axis} points {side} in the first rest: reads {value:.2f} g", up_g=first.tolist())]


def _three(values: FloatArray, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
