"""`plumb.load`: a recording in units, or a run of a log."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from plumb.api import arguments
from plumb.api.logged import load_run
from plumb.api.recordings import Recording
from plumb.audit import audited_files, warned
from plumb.errors import RecordingWarning, UsageError
from plumb.readers import log_replay, recording


def load(path: Path | str, *, run: int | None = None, params: Path | str | None = None) -> Recording:
    """Read a recording in units, .npz or .csv, or a run of a log of a board.

    Args:
        path: A log of `plumb record` (.plog), or a CAN tool's file of frames that carry raw counts: the result is a
            `LoggedRun`, with every recorded signal in units. Else `.npz` with `gyr` (N, 3) rad/s, `acc` (N,
            3) m/s^2, `time_s` (N,) or `rate_hz`, perhaps `ref_quat` (N, 4) and `movement` (N,); or `.csv`
            with columns of these names (`plumb replay --help`).
        run: Of a log: number of the run, from 1; None: the one of which most is known.
        params: Of a log whose frames do not carry the parameters: file of `plumb params dump`.

    Returns:
        The samples. Those in units are checked: finite, in the range of the firmware's calibrated values, time rising.

    Warns:
        RecordingWarning: `plumb check` is sure that something is wrong with a recording in units. It is read as it is,
            without rows that are the same as the one before, and with stamps that a batch shares spread. An estimator
            that is given its arrays, or parts of them, does not say it again.

    Raises:
        UsageError: A file that cannot be read, or that holds something else; one sentence says what.
    """
    given, table = arguments.path_of("path", path), arguments.optional_path_of("params", params)
    if log_replay.is_log(given):
        if run is not None:
            arguments.require_whole(run=run)
        return load_run(given, run, table)
    if run is not None or table is not None:
        raise UsageError(f"run and params are for logs: {given.name} is a recording in units")
    audit = audited_files.audited(given)
    found = audited_files.recording_of(given, audit, as_found=False)
    warned.warn_of(audit.findings, given.name, stacklevel=2)
    for sentence in found.notes:
        warnings.warn(f"{given.name}: {sentence}", RecordingWarning, stacklevel=2)
    gyr_radps, acc_mps2 = np.radians(found.gyr_dps), found.acc_g * recording.G_MPS2
    warned.remember(audit.findings, gyr_radps, acc_mps2)
    return Recording(
        found.path,
        found.time_s,
        gyr_radps,
        acc_mps2,
        found.ref_quat,
        found.movement,
    )
