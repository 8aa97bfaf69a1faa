"""Python warnings of what an audit is sure of, for arrays and files that are used from Python."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from plumb.audit import factors, rests, turning
from plumb.audit.audit import audit
from plumb.audit.findings import Finding
from plumb.audit.samples import Samples
from plumb.errors import RecordingWarning
from plumb.spec.arrays import FloatArray

SHORTEST_S = 2.0
SCREENED = 2000
"""Samples, the busiest in a row, on which arrays are screened: a whole audit takes many times as long as a run."""
LEAST_EXPLAINED = 0.05
"""Share of the turning, above what noise explains, from which the screen looks at axes and factor."""
ARRAYS_KINDS = ("accelerometer-units", "gyro-units", "gyro-axes", "gyro-lag")
"""Findings about arrays, whose clock is the caller's."""


def warn_of(findings: Sequence[Finding], name: str, stacklevel: int) -> None:
    """One RecordingWarning that names every sure fault; none for nothing sure. stacklevel: as warnings.warn takes it,
    seen from the caller."""
    sure = [one.line for one in findings if one.sure_fault]
    if sure:
        warnings.warn(f"{name}: {'; '.join(sure)}", RecordingWarning, stacklevel=stacklevel + 1)


def warn_of_arrays(gyr_radps: FloatArray, acc_mps2: FloatArray, period_s: float, stacklevel: int) -> None:
    """Warn of units and axes of a body's sensors, (N, 3) both, rows of NaN left out. Nothing is said of less than
    SHORTEST_S, nor of arrays that pass the screen."""
    if len(gyr_radps) * period_s < SHORTEST_S:
        return
    rows = slice(*_busiest(gyr_radps))
    gyr, acc = gyr_radps[rows], acc_mps2[rows]
    known = np.isfinite(np.concatenate([gyr, acc], axis=1)).all(axis=1)
    time_s = np.arange(len(gyr), dtype=np.float64) * period_s
    samples = Samples(time_s[known], np.degrees(gyr[known]), acc[known] / factors.G_MPS2)
    if suspicious(samples):
        found = [one for one in audit(samples).findings if one.kind in ARRAYS_KINDS]
        warn_of(found, "the arrays", stacklevel + 1)


def suspicious(samples: Samples) -> bool:
    """Whether a whole audit of samples may be sure of a fault in their units or axes: a length that is not
    gravity's, or turning of the accelerometer that other axes or another factor of the gyro explain."""
    if len(samples) < 20 or not samples.step_s > 0.0:
        return False
    length, _, _ = rests.quiet_length(samples)
    if not 0.5 < length < 2.0:
        return True
    seen = turning.screened(samples.acc_g / length, samples.gyr_dps, samples.step_s)
    return seen is not None and seen.explained >= LEAST_EXPLAINED and not (seen.right_axes and 0.5 < seen.factor < 2.0)


def _busiest(gyr: FloatArray) -> tuple[int, int]:
    if len(gyr) <= SCREENED:
        return 0, len(gyr)
    energy = np.nansum(np.abs(gyr[: len(gyr) // SCREENED * SCREENED]).reshape(-1, SCREENED * 3), axis=1)
    first = int(np.argmax(energy)) * SCREENED
    return first, first + SCREENED
