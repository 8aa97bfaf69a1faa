"""A long measurement, made once in a run of the tests: the first worker measures, the others read its result."""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

Result = TypeVar("Result")


def run_folder(factory: pytest.TempPathFactory) -> Path:
    """A folder of this run of the tests, which all of its workers share and no other run does."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def once_per_run(folder: Path, measured_on: Path | str, measure: Callable[[], Result]) -> Result:
    """What measure() gives, from the folder when another worker has measured the same bytes of the file `measured_on`,
    or, for a measurement that needs no file, under the same name.

    A worker that comes while another one measures waits for it. A measurement that raises leaves nothing.
    """
    subject = measured_on.encode() if isinstance(measured_on, str) else measured_on.read_bytes()
    name = hashlib.sha256(subject).hexdigest()
    kept = folder / f"{name}.measured"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            result = measure()
            kept.write_bytes(pickle.dumps(result))
            return result
    found: Result = pickle.loads(kept.read_bytes())
    return found
