"""Python warnings of what an audit is sure of, for arrays and files that are used from Python."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field

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


@dataclass(frozen=True)
class _Told:
    """What was said of one recording: its two arrays, as long as somebody holds them, and kind and mend of the
    findings."""

    gyr: weakref.ref[object]
    acc: weakref.ref[object]
    said: set[tuple[str, str]] = field(default_factory=set)


_told: list[_Told] = []
"""Of recordings with a fault alone, so it stays short."""


def warn_of(findings: Sequence[Finding], name: str, stacklevel: int) -> None:
    """One RecordingWarning that names every sure fault; none for nothing sure. stacklevel: as warnings.warn takes it,
    seen from the caller."""
    sure = [one.line for one in findings if one.sure_fault]
    if sure:
        warnings.warn(f"{name}: {'; '.join(sure)}", RecordingWarning, stacklevel=stacklevel + 1)


def remember(findings: Sequence[Finding], gyr: object, acc: object) -> None:
    """The user knows these findings of the arrays, and of all that are views of them: `warn_of_arrays` is silent."""
    sure = {_named(one) for one in findings if one.sure_fault}
    if sure:
        _said_of(gyr, acc).update(sure)


def warn_of_arrays(
    gyr_radps: FloatArray, acc_mps2: FloatArray, period_s: float, stacklevel: int, given: tuple[object, object]
) -> None:
    """Warn of units and axes of a body's sensors, (N, 3) both, rows of NaN left out. Nothing is said of less than
    SHORTEST_S, of arrays that pass the screen, nor a second time of arrays that the caller still holds. given: the two
    as the caller passed them, before they became floats."""
    if len(gyr_radps) * period_s < SHORTEST_S:
        return
    rows = slice(*_busiest(gyr_radps))
    gyr, acc = gyr_radps[rows], acc_mps2[rows]
    known = np.isfinite(np.concatenate([gyr, acc], axis=1)).all(axis=1)
    time_s = np.arange(len(gyr), dtype=np.float64) * period_s
    samples = Samples(time_s[known], np.degrees(gyr[known]), acc[known] / factors.G_MPS2)
    if suspicious(samples):
        said = _said_of(*given)
        found = [one for one in audit(samples).findings if one.kind in ARRAYS_KINDS and _named(one) not in said]
        said.update(_named(one) for one in found if one.sure_fault)
        warn_of(found, "the arrays", stacklevel + 1)


def _named(finding: Finding) -> tuple[str, str]:
    """Kind and mend: another fault of the same kind, as after a wrong mend, is a new one. A lag has another last digit
    in another part of the recording."""
    return finding.kind, (finding.mend or "").partition("<")[0]


def _said_of(gyr: object, acc: object) -> set[tuple[str, str]]:
    """What was said of the recording that these arrays belong to; a set of its own for what no weak reference can
    follow, as a list."""
    _told[:] = [one for one in _told if one.gyr() is not None and one.acc() is not None]
    gyr, acc = _owner(gyr), _owner(acc)
    for one in _told:
        if one.gyr() is gyr and one.acc() is acc:
            return one.said
    try:
        new = _Told(weakref.ref(gyr), weakref.ref(acc))
    except TypeError:
        return set()
    _told.append(new)
    return new.said


def _owner(array: object) -> object:
    """The array whose memory a view shows."""
    while isinstance(array, np.ndarray) and isinstance(array.base, np.ndarray):
        array = array.base
    return array


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
