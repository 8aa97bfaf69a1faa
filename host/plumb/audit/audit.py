"""Audit a recording: every part in its order, each on the samples as mended by what was sure before it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from plumb.audit import factors, mends, rests, signed_axes
from plumb.audit.alignment import SEEN, Alignment, alignment_of
from plumb.audit.clock import clock_findings
from plumb.audit.findings import Certainty, Finding, fault, note
from plumb.audit.grid import Grid, grid_of
from plumb.audit.levels import clip_findings, held_findings, wrap_findings
from plumb.audit.reference import reference_findings, sensors_mends
from plumb.audit.samples import Samples, of_columns
from plumb.spec.arrays import BoolArray, FloatArray

LEAST_SAMPLES = 20
LAG_STEPS, LEAST_LAG_S = 2.5, 0.012
AGREE = 0.5
"""Share of one measure of a lag that another one shows, when both are of the same lag."""
FASTEST_DPS = 4000.0
"""The largest range of a chip."""


@dataclass(frozen=True)
class Audit:
    """findings in the order in which their mends are applied, notes between them; as_read: the samples; mended: with
    all that is sure undone; alignment, grid: of the mended clock, units and levels, None where there is too little."""

    findings: list[Finding]
    as_read: Samples
    mended: Samples
    alignment: Alignment | None = None
    grid: Grid | None = None
    clipped: BoolArray | None = None

    @property
    def faults(self) -> list[Finding]:
        return [one for one in self.findings if one.wrong]

    @property
    def sure_fault(self) -> bool:
        return any(one.sure_fault for one in self.findings)

    @property
    def enough(self) -> bool:
        """Whether there are enough samples to tell anything."""
        return len(self.mended) >= LEAST_SAMPLES

    @property
    def sure_mends(self) -> list[str]:
        """What `--as-found` applies, in order."""
        return [one.mend for one in self.findings if one.sure_fault and one.mend]


@dataclass
class _Working:
    samples: Samples
    findings: list[Finding] = field(default_factory=list)

    def add(self, *found: Finding) -> None:
        for one in found:
            self.findings.append(one)
            if one.sure_fault and one.mend:
                self.samples = mends.mended(self.samples, [one.mend])


def audit_of(name: str, columns: Mapping[str, FloatArray]) -> Audit:
    """Audit columns as `recording_files.read` returns them: time_s (N,), gyr (N, 3) deg/s, acc (N, 3) g, perhaps
    ref_quat (N, 4), mag (N, 3). Raises UsageError for shapes that do not fit. name: of the file."""
    return audit(of_columns(name, columns))


def audit(samples: Samples) -> Audit:
    work = _Working(samples)
    work.findings.append(_columns(samples))
    if len(samples) < LEAST_SAMPLES:
        work.add(note("rate", f"{len(samples)} samples: too few to audit, {LEAST_SAMPLES} are needed", "unknown"))
        return Audit(work.findings, samples, samples)
    work.add(*clock_findings(samples))
    if len(work.samples) < LEAST_SAMPLES or not work.samples.step_s > 0.0:
        return Audit(work.findings, samples, work.samples)
    held, rows = held_findings(work.samples)
    wrapped = wrap_findings(work.samples)
    work.add(*held)
    clips, clipped = clip_findings(work.samples, rows)
    work.add(*wrapped, *([] if wrapped else clips))
    work.add(_accel_units(work.samples))
    grid = grid_of(work.samples, np.zeros(len(work.samples), np.bool_) if wrapped else clipped)
    alignment = None
    if grid is not None:
        alignment = alignment_of(_per_length(grid.acc_g), grid.gyr_dps, grid.usable, grid.step_s)
        units = _gyro_units(alignment, work.samples)
        work.add(units)
        axes = _axes(alignment)
        lag = _gyro_lag(alignment, grid)
        gyro_axes = signed_axes.EVERY[alignment.axes] if axes.mend else np.eye(3)
        _judge_reference(work, gyro_axes, axes, lag)
    at_rest = rests.rests_of(work.samples)
    work.add(*rests.rest_findings(work.samples, at_rest))
    settled = any(one.kind in ("reference-convention", "accelerometer-sign") for one in work.findings)
    work.add(*rests.up_finding(at_rest, settled), _magnetometer(work.samples))
    return Audit(work.findings, samples, work.samples, alignment, grid, clipped)


def _judge_reference(work: _Working, gyro_axes: FloatArray, axes: Finding, lag: Finding) -> None:
    """Add the axes, the lag, and the findings of the reference. Where it shows which of two sensors has other axes, or
    that likely ones are right, the finding of the axes says so. gyro_axes: those that the finding names."""
    agreeing = mends.mended(work.samples, [one.mend for one in (axes, lag) if one.mend])
    grid = grid_of(agreeing, np.zeros(len(agreeing), np.bool_))
    if grid is None or agreeing.ref_quat is None:
        work.add(axes, lag, note("reference", "none"))
        return
    of_reference = reference_findings(agreeing, grid)
    gyro, accel, sign_open = sensors_mends(gyro_axes, of_reference.rotation, of_reference.sign)
    altered = not (np.array_equal(of_reference.rotation, np.eye(3)) and np.array_equal(accel, of_reference.rotation))
    if of_reference.judged and altered:
        work.add(*_axes_of_both(gyro, accel))
    else:
        confirmed = of_reference.judged and of_reference.unique and axes.wrong
        work.add(replace(axes, certainty="sure", other=None) if confirmed else axes)
    work.add(*_with_lags(lag, of_reference.findings))
    if of_reference.judged and sign_open:
        text = (
            "the axis that the reference has up reads less than 0: the accelerometer has the other sign (reads "
            "gravity), or the reference's z points down (NED)"
        )
        work.add(fault("accelerometer-sign", "likely", text, "acc*-1", "ref:ned"))


def _with_lags(lag: Finding, of_reference: list[Finding]) -> list[Finding]:
    """The gyro's lag, then the findings of the reference. A reference that is early is a gyro that is late, where the
    accelerometer says so too or cannot tell."""
    early = next((one for one in of_reference if one.kind == "reference-lag" and one.wrong), None)
    late_s = 0.0 if early is None else -float(str(early.numbers["late_s"]))
    told = lag.certainty != "unknown"
    seen_s = float(str(lag.numbers["late_s"])) if told else late_s
    if early is None or lag.wrong or late_s <= 0.0 or seen_s < AGREE * late_s:
        return [lag, *of_reference]
    others = [one for one in of_reference if one is not early]
    numbers = {**lag.numbers, **early.numbers, "late_s": late_s}
    mend = f"gyr<{late_s:.4f}"
    if told:
        text = f"the gyro is late by {1e3 * late_s:.0f} ms against the reference, {1e3 * seen_s:.0f} ms against the "
        return [fault("gyro-lag", "sure", f"{text}accelerometer", mend, numbers=numbers), *others]
    text = f"the gyro is late by {1e3 * late_s:.0f} ms against the reference, or the reference's stamps are early"
    return [fault("gyro-lag", "likely", text, mend, f"ref<{-late_s:.4f}", numbers=numbers), *others]


def _axes_of_both(gyro: FloatArray, accel: FloatArray) -> list[Finding]:
    """Findings of the axes of each sensor in those of the reference, (3, 3) both; one for axes that both share."""
    if np.array_equal(gyro, accel):
        words = signed_axes.words_of(gyro, "each sensor's", "the reference's")
        hand = "left-handed axes: " if np.linalg.det(gyro) < 0.0 else "other axes than the reference's: "
        return [fault("axes", "sure", hand + words, f"both:{signed_axes.name_of(gyro)}")]
    return [
        fault(f"{sensor}-axes", "sure", signed_axes.words_of(found, sensor, "the reference's"), mend)
        for sensor, short, found in (("gyro", "gyr", gyro), ("accelerometer", "acc", accel))
        for mend in [f"{short}:{signed_axes.name_of(found)}"]
        if not np.array_equal(found, np.eye(3))
    ]


def _columns(samples: Samples) -> Finding:
    taken = ["time_s", "gyr x y z in deg/s", "acc x y z in g"]
    taken += [] if samples.ref_quat is None else ["reference w x y z"]
    taken += [] if samples.mag is None else ["magnetometer x y z"]
    return note("columns", f"taken as {', '.join(taken)}", columns=taken)


def _per_length(acc_g: FloatArray) -> FloatArray:
    return acc_g / max(float(np.median(np.linalg.norm(acc_g, axis=1))), 1e-12)


def _accel_units(samples: Samples) -> Finding:
    length, spread, at_rest = rests.quiet_length(samples)
    where = "at rest" if at_rest else "in the middle of all"
    tolerance = 0.12 if at_rest else 0.25
    known = factors.nearest(1.0 / max(length, 1e-12), factors.ACCEL, tolerance)
    numbers = {"length": length, "spread": spread, "at_rest": at_rest}
    if (known is not None and known.value == 1.0) or 0.5 < length < 2.0:
        return note("accelerometer-units", f"length {where} {length:.4g} g", numbers=numbers)
    text = f"length {where} {length:.4g} g as read"
    if not length > 0.0:
        return fault("accelerometer-units", "sure", f"{text}: the accelerometer reads nothing", numbers=numbers)
    if known is None:
        return fault(
            "accelerometer-units", "likely", f"{text}: in what unit is it?", f"acc*{1.0 / length:.6g}", numbers=numbers
        )
    certainty: Certainty = "sure" if at_rest or spread < 0.2 else "likely"
    return fault("accelerometer-units", certainty, f"{text}: {known.said}", f"acc*{known.value:.6g}", numbers=numbers)


def _gyro_units(one: Alignment, samples: Samples) -> Finding:
    most = float(np.max(np.abs(samples.gyr_dps)))
    numbers = {"factor": one.factor, "error_g": one.error, "as_read_g": one.factor_as_read_error}
    if not one.told:
        if most > FASTEST_DPS:
            text = f"up to {most:.4g} deg/s as read: no gyro turns so fast; counts, or deg/s taken for rad/s?"
            return fault("gyro-units", "likely", text, most_dps=most)
        seen = one.turning
        if seen is not None and seen.explained >= SEEN and not 0.5 < seen.factor < 2.0:
            # Accelerations and clipped samples make the regression's factor too small.
            known = factors.nearest(1.2 * seen.factor, factors.GYRO, 0.35)
            value, said = (known.value, known.said) if known else (seen.factor, "in what unit is it?")
            if value * most <= FASTEST_DPS:  # a vibration turns the acceleration faster than any body turns
                text = (
                    f"the gyro explains {100.0 * seen.explained:.0f} % of the accelerometer's turning with a factor of "
                    f"about {seen.factor:.3g}: {said}"
                )
                return fault("gyro-units", "likely", text, f"gyr*{value:.6g}", numbers=numbers)
        text = "factor, axes and lag of the gyro cannot be told: too little turning that the accelerometer shows"
        return note("gyro-units", text, "unknown")
    if 0.5 < one.factor < 2.0:
        text = f"the gyro explains the accelerometer's turning as read, to {one.error:.2g} g of {one.still_error:.2g}"
        return note("gyro-units", text, numbers=numbers)
    known = factors.nearest(one.factor, factors.GYRO, 0.12)
    text = f"the gyro explains the accelerometer's turning with factor {one.factor:.4g}"
    if known is None:
        return fault("gyro-units", "likely", f"{text}: in what unit is it?", f"gyr*{one.factor:.6g}", numbers=numbers)
    return fault("gyro-units", "sure", f"{text}: {known.said}", f"gyr*{known.value:.6g}", numbers=numbers)


def _axes(one: Alignment) -> Finding:
    if not one.told:
        return note("gyro-axes", "cannot be told", "unknown")
    numbers = {"axes": signed_axes.name_of(signed_axes.EVERY[one.axes]), "ties": len(one.ties)}
    if one.axes == signed_axes.AS_READ:
        return note(
            "gyro-axes", f"those of the accelerometer, of {48 - len(one.ties)} others told apart", numbers=numbers
        )
    axes = signed_axes.EVERY[one.axes]
    right = signed_axes.name_of(axes)
    by = f"error {one.error:.2g} g, as read {one.as_read_error:.2g}"
    certainty: Certainty = "sure" if len(one.ties) == 1 else "likely"
    if np.linalg.det(axes) > 0.0:
        other = f"acc:{_other_accel(axes)}"
        text = f"{signed_axes.words_of(axes, 'gyro', 'accelerometer')}, or the accelerometer's axes are others ({by})"
        return fault("gyro-axes", certainty, text, f"gyr:{right}", other, numbers=numbers)
    if np.array_equal(axes, -np.eye(3)):
        text = f"the gyro turns the other way about every axis: left-handed axes, or its signs ({by})"
    else:
        text = f"{signed_axes.words_of(axes, 'gyro', 'accelerometer')} ({by})"
    return fault("gyro-axes", certainty, text, f"gyr:{right}", numbers=numbers)


def _other_accel(axes: FloatArray) -> str:
    """The accelerometer's axes that would explain the same: A with det(A) A^T = axes, the one that alters fewer."""
    turned = axes.T
    both = sorted((turned, -turned), key=lambda a: float(np.sum(np.diag(a) != 1.0)))
    return signed_axes.name_of(both[0])


def _gyro_lag(one: Alignment, grid: Grid) -> Finding:
    if not one.told:
        return note("gyro-lag", "cannot be told", "unknown")
    numbers = {"late_s": one.lag_s, "t": one.lag_t}
    if abs(one.lag_s) < max(LAG_STEPS * grid.step_s, LEAST_LAG_S) or one.lag_t < 4.0:
        return note("gyro-lag", f"{1e3 * one.lag_s:+.0f} ms against the accelerometer", numbers=numbers)
    side = "late" if one.lag_s > 0.0 else "early"
    text = f"the gyro is {side} by {1e3 * abs(one.lag_s):.0f} ms against the accelerometer"
    return fault("gyro-lag", "sure", text, f"gyr<{one.lag_s:.4f}", numbers=numbers)


def _magnetometer(samples: Samples) -> Finding:
    if samples.mag is None or not np.isfinite(samples.mag).all(1).any():
        return note("magnetometer", "none: heading is the gyro's alone")
    length = np.linalg.norm(samples.mag, axis=1)
    low, middle, high = np.nanpercentile(length, [5.0, 50.0, 95.0])
    text = f"present, length {middle:.4g} as read, from {low:.3g} to {high:.3g}"
    return note("magnetometer", text, length=float(middle))
