"""The reference against the sensors: its convention, its lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit import mends, signed_axes
from plumb.audit.conventions import Convention, convention_of, relative_rates
from plumb.audit.findings import Finding, fault, note
from plumb.audit.grid import Grid
from plumb.audit.samples import Samples
from plumb.spec.arrays import FloatArray

LEAST_SCORE = 1.2
"""Of 2, for a convention to be named."""
LEAST_CORRELATION = 0.6
LONGEST_LAG_S, LAG_STEPS, LEAST_LAG_S = 0.4, 2.5, 0.02
WORDS = {
    "ref:wxyz": "w is its last number, not its first",
    "ref:turned": "it turns the earth's axes to the body's, not back",
}


@dataclass(frozen=True)
class OfReference:
    """findings; rotation, sign: of the convention; judged: there is one; unique: no other fits as well."""

    findings: list[Finding]
    rotation: FloatArray
    sign: int
    judged: bool
    unique: bool = False


def on_grid(samples: Samples, grid: Grid) -> FloatArray | None:
    """The reference at the points of the grid, (n, 4) of length 1, NaN where it is lost; None without one."""
    q = samples.ref_quat
    if q is None or not np.isfinite(q).all(1).any():
        return None
    at = np.interp(grid.time_s, samples.time_s - samples.time_s[0], np.arange(len(samples), dtype=np.float64))
    before = np.floor(at).astype(int)
    after, part = np.minimum(before + 1, len(q) - 1), (at - before)[:, None]
    second = np.where(np.sum(q[before] * q[after], axis=1, keepdims=True) < 0.0, -q[after], q[after])
    mixed = (1.0 - part) * q[before] + part * second
    length = np.linalg.norm(mixed, axis=1, keepdims=True)
    return np.asarray(mixed / np.where(length > 1e-6, length, np.nan), np.float64)


def reference_findings(samples: Samples, grid: Grid) -> OfReference:
    """Of samples whose sensors agree with each other."""
    q = on_grid(samples, grid)
    lost = 1.0 if samples.ref_quat is None else float(np.mean(~np.isfinite(samples.ref_quat).all(1)))
    found = [note("reference", f"a quaternion, {100.0 * (1.0 - lost):.3g} % of the samples", share=1.0 - lost)]
    convention = None if q is None else convention_of(q, grid.gyr_dps, grid.acc_g, grid.usable, grid.step_s)
    if q is None or convention is None or convention.score < LEAST_SCORE:
        text = "its convention cannot be told: too little of it, or it does not follow the sensors"
        return OfReference([*found, note("reference-convention", text, "unknown")], np.eye(3), 1, False)
    found += _of_convention(convention)
    for mend in convention.form:
        q = mends.reference(q, mend)
    if convention.rates > LEAST_CORRELATION:
        found += _lag(q, grid, convention.rotation)
    return OfReference(found, convention.rotation, convention.sign, True, convention.unique)


def _of_convention(one: Convention) -> list[Finding]:
    numbers = {"rates": one.rates, "verticals": one.verticals, "score": one.score, "as_read": one.as_read}
    by = f"score {one.score:.2f} of 2, as read {one.as_read:.2f}"
    sureness = "sure" if one.unique else "likely"
    found = [
        fault(
            "reference-order" if mend == "ref:wxyz" else "reference-direction",
            "sure" if one.unique else "likely",
            f"{WORDS[mend]} ({by})",
            mend,
            numbers=numbers,
        )
        for mend in one.form
    ]
    if one.up != "z":
        text = f"the reference's {one.up} axis is vertical, not its z ({by})"
        found.append(fault("reference-up", "likely", text, f"ref:{one.up}-up", numbers=numbers))
    if not found and one.sign > 0 and np.array_equal(one.rotation, np.eye(3)):
        text = f"w first, body to earth, z up: agrees with the sensors ({one.score:.2f} of 2)"
        found.append(note("reference-convention", text, "sure" if sureness == "sure" else "unknown", numbers=numbers))
    return found


def _lag(q: FloatArray, grid: Grid, rotation: FloatArray) -> list[Finding]:
    steps = max(2, 2 * round(0.02 / grid.step_s))
    own = relative_rates(q, steps, grid.step_s)
    rate = grid.gyr_dps @ rotation.T
    smooth = np.stack([np.convolve(one, np.ones(steps) / steps, "same") for one in rate.T], 1)
    most = round(LONGEST_LAG_S / grid.step_s)
    good = np.isfinite(own).all(1) & grid.usable
    lags = np.arange(-most, most + 1)
    inside = slice(most, len(own) - most)
    if np.sum(good[inside]) < 50:
        return []
    errors = np.empty(len(lags))
    for at, lag in enumerate(lags):
        # A late reference at t shows the rate of t - lag.
        moved = slice(most + lag, len(own) - most + lag)
        both = good[moved] & grid.usable[inside]
        errors[at] = np.mean(np.sum((own[moved][both] - smooth[inside][both]) ** 2, axis=1))
    best = int(np.argmin(errors))
    late_s = float(lags[best] * grid.step_s)
    if 0 < best < len(lags) - 1:
        before, least, after = errors[best - 1 : best + 2]
        late_s += 0.5 * grid.step_s * float((before - after) / max(before - 2 * least + after, 1e-12))
    zero = float(errors[most])
    numbers = {"late_s": late_s, "error_dps": float(np.sqrt(errors[best])), "as_read_dps": float(np.sqrt(zero))}
    if abs(late_s) < max(LAG_STEPS * grid.step_s, LEAST_LAG_S) or errors[best] > 0.7 * zero:
        return [note("reference-lag", f"{1e3 * late_s:+.0f} ms", numbers=numbers)]
    side = "late" if late_s > 0.0 else "early"
    text = (
        f"the reference is {side} by {1e3 * abs(late_s):.0f} ms: its rates differ from the "
        f"gyro's by {np.sqrt(errors[best]):.2g} deg/s then, and by {np.sqrt(zero):.2g} as read"
    )
    return [fault("reference-lag", "sure", text, f"ref<{late_s:.4f}", numbers=numbers)]


def sensors_mends(gyro_axes: FloatArray, rotation: FloatArray, sign: int) -> tuple[FloatArray, FloatArray, bool]:
    """Axes of the gyro and of the accelerometer, as read, in the reference's, and whether the accelerometer's sign (or
    NED) is open. gyro_axes: P that made the gyro agree with the accelerometer."""
    gyro = rotation @ gyro_axes
    plain, mirrored = rotation, sign * rotation
    cost = [signed_axes.ALTERED[_place(one)] for one in (plain, mirrored)]
    if sign < 0 and not np.array_equal(plain, np.eye(3)) and cost[1] < cost[0] + 1:
        return gyro, mirrored, False
    return gyro, plain, sign < 0


def _place(axes: FloatArray) -> int:
    return next(at for at, one in enumerate(signed_axes.EVERY) if np.array_equal(one, axes))
