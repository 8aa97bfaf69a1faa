"""The stamps: their unit, order, repeats, gaps and rate."""

from __future__ import annotations

import numpy as np

from plumb.audit import mends
from plumb.audit.findings import Finding, fault, note
from plumb.audit.samples import Samples
from plumb.errors import UsageError

UNITS = ((0.4, 1e-3, "milliseconds"), (80.0, 1e-6, "microseconds"), (9e4, 1e-9, "nanoseconds"))
"""Least step as read, factor, name: no logger of motion is slower than 2.5 Hz, nor as fast as 12.5 kHz."""
LEAST_STEP_S = 5e-5
GAP_S = 1.0
"""A longer gap is a fault: a session ends there."""
LOST_STEPS = 2.5
BACK_S = 1.0
"""Time that runs back by more begins another session; by less it is out of order."""


def clock_findings(samples: Samples) -> list[Finding]:
    """Faults in the order in which they are mended; then the rate. Raises UsageError for samples of which nothing can
    be told."""
    found: list[Finding] = []

    def add(one: Finding) -> None:
        nonlocal samples
        found.append(one)
        if one.sure_fault and one.mend:
            samples = mends.mended(samples, [one.mend])

    missing = int(np.sum(~mends.finite(samples)))
    if missing > len(samples) - 2:
        raise UsageError(f"only {len(samples) - missing} of {len(samples)} rows have no value that is missing")
    if missing:
        text = f"{missing} of {len(samples)} rows have a value that is missing or no number"
        add(fault("missing", "sure", text, "rows:finite", rows=missing))
    for one in (_unit(samples),):
        if one:
            add(one)
    same = int(np.sum(mends.repeats(samples)))
    if same > len(samples) - 2:
        raise UsageError(f"all of {len(samples)} rows are the same, stamp and samples: no time passes in it")
    if same:
        text = f"{same} of {len(samples)} rows are the same as the one before, stamp and samples"
        add(fault("repeated-rows", "sure", text, "rows:new", rows=same))
    for judge in (_sessions, _order, _batches, _gaps):
        one = judge(samples)
        if one:
            add(one)
    return [*found, _rate(samples)]


def _unit(samples: Samples) -> Finding | None:
    step = samples.step_s
    for least, factor, name in reversed(UNITS):
        if step >= least:
            text = f"time steps of {step:.4g}: {name}? As seconds that is {1.0 / step:.3g} Hz"
            return fault("clock-unit", "sure", text, f"time*{factor:g}", step_as_read=step)
    if 0.0 < step < LEAST_STEP_S:
        text = f"time steps of {step:.3g} s are {1.0 / step:.3g} Hz: seconds that were taken for milliseconds?"
        return fault("clock-unit", "likely", text, "time*1000", step_as_read=step)
    return None


def _sessions(samples: Samples) -> Finding | None:
    steps = np.diff(samples.time_s)
    cuts = np.flatnonzero(steps < -BACK_S) + 1
    if not len(cuts):
        return None
    edges = np.array([0, *cuts, len(samples)])
    longest = int(np.argmax(np.diff(edges)))
    back = float(-steps[cuts[0] - 1])
    text = f"{len(cuts) + 1} sessions in one file: time runs back by {back:.4g} s at row {cuts[0]}"
    mend = f"rows:{edges[longest]}-{edges[longest + 1]}"
    return fault("sessions", "sure", text, mend, sessions=len(cuts) + 1, row=int(cuts[0]))


def _order(samples: Samples) -> Finding | None:
    back = np.flatnonzero(np.diff(samples.time_s) < 0.0) + 1
    if not len(back):
        return None
    text = f"{len(back)} rows are out of order: time runs back at row {back[0]}"
    return fault("order", "sure", text, "time:sort", rows=len(back))


def _batches(samples: Samples) -> Finding | None:
    same = int(np.sum(np.diff(samples.time_s) == 0.0))
    if not same:
        return None
    stamps = len(samples) - same
    text = f"{same} of {len(samples)} stamps are the same as the one before: {len(samples) / stamps:.3g} rows a stamp"
    return fault("shared-stamps", "sure", text, "time:spread", rows=same)


def _gaps(samples: Samples) -> Finding | None:
    steps = np.diff(samples.time_s)
    if not len(steps):
        return None
    wide = np.flatnonzero(steps > max(GAP_S, 10.0 * samples.step_s))
    if not len(wide):
        return None
    edges = np.array([0, *(wide + 1), len(samples)])
    longest = int(np.argmax(np.diff(edges)))
    at = int(wide[np.argmax(steps[wide])])
    text = f"{len(wide)} {'gap' if len(wide) == 1 else 'gaps'}, the longest of {steps[at]:.3g} s at row {at + 1}"
    mend = f"rows:{edges[longest]}-{edges[longest + 1]}"
    return fault("gap", "sure", text, mend, gaps=len(wide), longest_s=float(steps[at]))


def _rate(samples: Samples) -> Finding:
    steps = np.diff(samples.time_s)
    step = samples.step_s
    lost = int(np.sum(steps > LOST_STEPS * step))
    seconds = float(samples.time_s[-1] - samples.time_s[0])
    jitter = float(np.percentile(np.abs(steps - step), 90.0)) if len(steps) else 0.0
    text = f"{len(samples)} samples in {seconds:.4g} s, {1.0 / step if step > 0.0 else 0.0:.5g} Hz"
    if jitter > 0.02 * step:
        text += f", steps stray by {1e3 * jitter:.2g} ms"
    if lost:
        text += f", {lost} steps are longer than {LOST_STEPS:g} others"
    return note("rate", text, rate_hz=1.0 / step if step > 0.0 else None, seconds=seconds, lost=lost)
