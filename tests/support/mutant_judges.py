"""What kills a mutant of the core: a golden vector that it does not repeat to the last bit, or another test.

The mutant runs in a process of its own, because it may crash or never end: both are seen, so both kill it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plumb.boards.native.core import CORE_VARIABLE
from plumb.proof.golden_file import Vector

LONGEST_S = 60
"""Of processor time, for all vectors: a hundred times what they take."""
SURVIVED, KILLED = 0, 1


@dataclass(frozen=True)
class Prepared:
    """A vector as the library takes it."""

    name: str
    params: np.ndarray
    raw: np.ndarray
    setpoint: np.ndarray
    digests: np.ndarray

    @classmethod
    def of(cls, vector: Vector) -> Prepared:
        words = np.array([word & 0xFFFFFFFF for word in vector.params.words()], np.uint32)
        raw, setpoint = np.ascontiguousarray(vector.raw, np.int16), np.ascontiguousarray(vector.setpoint, np.int32)
        return cls(vector.name, words, raw, setpoint, vector.digests)

    @classmethod
    def all(cls, vectors: Sequence[Vector]) -> list[Prepared]:
        """The vectors of steps, short ones first."""
        return sorted((cls.of(one) for one in vectors if one.task is None), key=lambda one: len(one.raw))

    def kills(self, library: ctypes.CDLL) -> bool:
        digests = np.zeros(len(self.raw), np.uint32)
        arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in (self.params, self.raw, self.setpoint)]
        given = [*arrays, ctypes.c_int32(len(self.raw)), None, digests.ctypes.data_as(ctypes.c_void_p)]
        library.plumb_control_run(*given)
        return not np.array_equal(digests, self.digests)


def killer(library: Path, vectors: Sequence[Prepared]) -> str | None:
    """The first vector that the library does not repeat; `crash` when it ends the process; None: it repeats all."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST_S)
        loaded = ctypes.CDLL(str(library))
        for number, vector in enumerate(vectors):
            if vector.kills(loaded):
                os.write(writing, number.to_bytes(4, "little"))
                os._exit(KILLED)
        os._exit(SURVIVED)
    os.close(writing)
    with os.fdopen(reading, "rb") as said:
        at = said.read()
    _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == SURVIVED:
        return None
    return vectors[int.from_bytes(at, "little")].name if at else "crash"


ROOT = Path(__file__).resolve().parents[2]
OTHERS = (
    "tests/kernels",
    *(
        str(path)
        for kind in ("core", "step", "rates")
        for path in sorted(Path("tests/systems").glob(f"test_*_{kind}.py"))
    ),
)
"""Tests of the native core with inputs of their own."""
LIMIT_S = 7200
"""Of one test, which may call many mutants on a busy machine."""


def other_killers(libraries: Sequence[Path], report: Path, tests: Sequence[str] = OTHERS) -> dict[Path, str | None]:
    """For each library a test of kernels and systems that fails with it; None: all pass.

    One run of the tests calls all of them together with the core (support.mutant_watch, which writes the file
    `report`). Then a test in which a library answers otherwise is run with that library alone."""
    report.touch()
    answers = {"PLUMB_MUTANTS": os.pathsep.join(map(str, libraries)), "PLUMB_MUTANTS_REPORT": str(report)}
    done = _run(["-p", "support.mutant_watch", *tests], answers)
    if done.returncode != 0:
        raise RuntimeError(f"the tests of kernels and systems did not pass: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    lines = [line.split("\t") for line in report.read_text(encoding="utf-8").splitlines()]
    found: dict[Path, str | None] = {}
    for library in libraries:
        seen = [test for path, test in lines if path == str(library)]
        found[library] = next((test for test in seen if _run([test], {CORE_VARIABLE: str(library)}).returncode), None)
    return found


def _run(arguments: Sequence[str], variables: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", *arguments]
    environment = {**os.environ, **variables, "PLUMB_LONG": "", "PLUMB_TEST_LIMIT_S": str(LIMIT_S)}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
