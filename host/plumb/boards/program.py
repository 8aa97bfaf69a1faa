"""The user's program as a board: a port or another build of the C core, which reads a vector and prints digests.

The program is started once for each vector. It reads the vector from stdin to its end, prints one line for each step
to stdout, and exits with code 0. All text is ASCII, numbers are decimal, fields are separated by one space. Input:

    plumb-program 1                         version of this protocol
    vector NAME                             for messages
    system NAME
    period_us N                             period of a step
    report digests                          or: report words
    word NAME TYPE                          of the record, in written order; int32, uint32 or int64
    param NAME VALUE                        every word of plumb_params_t in its order, first the system's number
    steps N                                 the last line of the header; then a line for each step:
    RAW0 RAW1 RAW2 RAW3 RAW4 RAW5 SETPOINT  six int16 counts, an int32

A vector that is more than steps of one set of parameters (plumb.systems.tasks) begins with `plumb-program 2`, so that
a program which was written for the first version refuses it. Its header has also

    kind retune                             or: plausibility, refusal
    variance_turn2_q56 N                    of plausibility: the value of 2^32 lsb of variance, for the check

and before or in place of the lines of steps

    retune VALUE0 VALUE1 ...                other parameters from the next step on, every word of plumb_params_t
    table VALUE0 VALUE1 ...                 of a refusal: one table; its record is the word `valid`, 1 or 0

The record of a plausibility step is plumb_plausibility_t, each member as a word of 32 bits.

Lines of the header that a program does not know are to be skipped. Output, one line for each step:

    DIGEST                                  CRC-32 of the record's bytes, 8 hexadecimal digits
    DIGEST WORD0 WORD1 ...                  after `report words`, if the program can: every word of the record

The record is packed little-endian without padding. With the words a difference is traced to its signal, without them
to its step.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from plumb.boards.contract import Answer, RawCounts, Setpoints, StepBoard, Stepper
from plumb.errors import LinkError, UsageError
from plumb.spec.records import RECORDS, Words
from plumb.systems.tasks import KINDS, Task

if TYPE_CHECKING:
    from plumb.contract.parameters import ControlParams

VERSION = 1
TASK_VERSION = 2
START_UP_S = 30.0
"""Time limit of a run, plus STEP_S for every step."""
STEP_S = 5e-3
MOST_LINE_BYTES = 4096
"""Longest line of output: a digest, and the words of the longest record."""
_DIGEST = re.compile(rb"[0-9A-Fa-f]{8}")
_WORD = re.compile(rb"-?[0-9]{1,20}")


def vector_text(
    params: ControlParams, raw: RawCounts, setpoint: Setpoints, *, words: bool = False, name: str = "unnamed"
) -> str:
    """The input of the program. words: ask for the words of every step, too."""
    head = _head(VERSION, params, name, words)
    samples = np.column_stack([raw.astype(np.int64), setpoint.astype(np.int64)]).tolist()
    steps = [" ".join(map(str, sample)) for sample in samples]
    return "\n".join([*head, *_layout(params, RECORDS[params.system], len(raw)), *steps]) + "\n"


def task_text(task: Task, *, words: bool = False, name: str = "unnamed") -> str:
    """The input of the program for a vector that is more than steps of one set of parameters."""
    head = [*_head(TASK_VERSION, task.params, name, words), f"kind {task.kind}"]
    if task.kind == "plausibility":
        head.append(f"variance_turn2_q56 {task.unit_turn2_q56}")
    head += _layout(task.params, task.record, len(task.raw))
    if task.kind == "refusal":
        return "\n".join([*head, *(_table("table", table) for table in task.tables)]) + "\n"
    changes: dict[int, list[str]] = {}
    for change in task.changes:
        changes.setdefault(change.step, []).append(_table("retune", change.params))
    samples = np.column_stack([task.raw.astype(np.int64), task.setpoint.astype(np.int64)]).tolist()
    for step, sample in enumerate(samples):
        head += [*changes.get(step, ()), " ".join(map(str, sample))]
    return "\n".join(head) + "\n"


def _head(version: int, params: ControlParams, name: str, words: bool) -> list[str]:
    return [
        f"plumb-program {version}",
        f"vector {name}",
        f"system {params.system}",
        f"period_us {round(params.period_s * 1e6)}",
        f"report {'words' if words else 'digests'}",
    ]


def _layout(params: ControlParams, record: np.dtype[np.void], steps: int) -> list[str]:
    return [
        *(f"word {word} {record[word].name}" for word in record.names or ()),
        *(f"param {key} {value}" for key, value in zip(params.values, params.words(), strict=True)),
        f"steps {steps}",
    ]


def _table(key: str, params: ControlParams) -> str:
    return " ".join([key, *map(str, params.words())])


class ProgramBoard(StepBoard):
    """The board that runs each vector in a process of its own. command: the program and its arguments."""

    name = "program"
    task_kinds = KINDS

    def __init__(self, command: Sequence[str]) -> None:
        self._command = list(command)

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Raises UsageError when the program cannot be started, LinkError when it fails, hangs or prints other lines.

        A program that prints too few or too many lines is no error: the steps are compared as they are.
        """
        return Answer(self._digests(self._lines(vector_text(params, raw, setpoint), len(raw))))

    def run_task(self, task: Task) -> Answer:
        """As `run_injected`, with the second version of the lines."""
        return Answer(self._digests(self._lines(task_text(task), len(task.raw))))

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        """{} when the program prints no words."""
        lines = self._lines(task_text(task, words=True), len(task.raw))[step : step + 1]
        words = self._words(lines, task.record) if lines else None
        return {} if words is None else {name: int(values[0]) for name, values in words.items()}

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        """{} when the program prints no words."""
        words = self.words_of_steps(params, raw, setpoint, step, step + 1)
        return {} if words is None else {name: int(values[0]) for name, values in words.items()}

    def words_of_steps(
        self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, first: int, end: int
    ) -> Words | None:
        """The words of the steps from `first` to before `end`, None when the program prints none for each of them."""
        lines = self._lines(vector_text(params, raw[:end], setpoint[:end], words=True), end)[first:end]
        return self._words(lines, RECORDS[params.system]) if len(lines) == end - first else None

    def _words(self, lines: Sequence[bytes], record: np.dtype[np.void]) -> Words | None:
        names = record.names or ()
        rows = np.zeros(len(lines), record)
        for row, line in zip(rows, lines, strict=True):
            values = line.split()[1:]
            if len(values) != len(names):
                return None
            for name, text in zip(names, values, strict=True):
                limits = np.iinfo(record[name])
                value = int(text) if _WORD.fullmatch(text) else limits.max + 1
                if not limits.min <= value <= limits.max:
                    raise LinkError(f"{self._command[0]} printed {_shown(text)} for {name}, which is {record[name]}")
                row[name] = value
        return Words(rows)

    def stepper(self, params: ControlParams) -> Stepper:
        raise UsageError("program:COMMAND takes whole runs only; close the loop with native, then replay its inputs")

    def _digests(self, lines: Sequence[bytes]) -> npt.NDArray[np.uint32]:
        digests = np.zeros(len(lines), np.uint32)
        for step, line in enumerate(lines):
            text = line.split(None, 1)[0] if line.split() else b""
            if not _DIGEST.fullmatch(text):
                raise LinkError(
                    f"{self._command[0]} printed {_shown(line)} for step {step}; a digest has 8 hexadecimal digits"
                )
            digests[step] = int(text, 16)
        return digests

    def _lines(self, text: str, steps: int) -> list[bytes]:
        """The lines that the program printed, at most one more than there are steps."""
        limit_s = START_UP_S + STEP_S * steps
        # Files instead of pipes: a program may end before it has read all, or print before it reads.
        with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complaint:
            given.write(text.encode())
            given.seek(0)
            try:
                process = subprocess.Popen(
                    self._command, stdin=given, stdout=said, stderr=complaint, start_new_session=True
                )
            except OSError as error:
                raise UsageError(
                    f"cannot run {self._command[0]}: {error.strerror}; name a program as in program:./port"
                ) from None
            try:
                code = self._wait(process, (said, complaint), limit_s, (steps + 1) * MOST_LINE_BYTES)
            finally:
                if process.poll() is None:
                    _kill(process)
            if code:
                last = _last_line(complaint)
                raise LinkError(f"{self._command[0]} ended with code {code}: {last or 'it said nothing'}")
            said.seek(0)
            return self._bounded(said, steps + 1)

    def _wait(
        self, process: subprocess.Popen[bytes], outputs: Sequence[IO[bytes]], limit_s: float, most_bytes: int
    ) -> int:
        end_s = time.monotonic() + limit_s
        while True:
            try:
                return process.wait(timeout=0.2)
            except subprocess.TimeoutExpired:
                if time.monotonic() > end_s:
                    raise LinkError(
                        f"{self._command[0]} did not finish within {limit_s:.0f} s and was stopped"
                    ) from None
                if any(os.fstat(output.fileno()).st_size > most_bytes for output in outputs):
                    raise LinkError(f"{self._command[0]} prints without end and was stopped") from None

    def _bounded(self, said: IO[bytes], most: int) -> list[bytes]:
        lines: list[bytes] = []
        while len(lines) < most and (line := said.readline(MOST_LINE_BYTES)):
            if len(line) == MOST_LINE_BYTES:
                raise LinkError(f"{self._command[0]} printed a line of more than {MOST_LINE_BYTES} bytes")
            lines.append(line.rstrip(b"\r\n"))
        return lines


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill the program and the programs that it started."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def _last_line(complaint: IO[bytes]) -> str:
    """The last text that the program wrote to stderr, on one line."""
    complaint.seek(0, 2)
    complaint.seek(max(0, complaint.tell() - MOST_LINE_BYTES))
    lines = complaint.read().decode(errors="replace").strip().splitlines()
    return lines[-1][:200] if lines else ""


def _shown(text: bytes) -> str:
    return f"'{text[:40].decode('ascii', 'backslashreplace')}'"
