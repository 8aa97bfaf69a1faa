"""Read a recording, audit it, and mend it: what `plumb check`, `replay`, `compare` and campaigns begin with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from plumb.audit import mends
from plumb.audit.audit import Audit, audit
from plumb.audit.samples import of_columns
from plumb.errors import UsageError
from plumb.readers import recording, recording_files
from plumb.readers.imu_files.given import Given
from plumb.readers.recording import Recording
from plumb.readers.recording_files import NOTHING


def audited(path: Path, first: Sequence[str] = (), given: Given = NOTHING, taken: list[str] | None = None) -> Audit:
    """Of the file with the mends `first`; given, taken: as `recording_files.read` has them. Raises UsageError for a
    file that cannot be read, and for a wrong mend."""
    samples = of_columns(path.name, recording_files.read(path, taken, given))
    try:
        return audit(mends.mended(samples, first))
    except UsageError as error:
        raise UsageError(f"{path.name}: {error}") from None


def recording_of(path: Path, found: Audit, as_found: bool) -> Recording:
    """The recording as read, or with all that is sure undone; raises UsageError for what cannot be replayed."""
    return recording.checked(path, (found.mended if as_found else found.as_read).columns)
