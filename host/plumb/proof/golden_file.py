"""The container of a golden vector: encode and decode NAME.golden. Decoding checks every field of a file.

One line of JSON (at most 64 KiB), then binary, little endian, without compression:

    {"format", "name", "system", "on_link", "steps", "columns", "setpoint", "params", "final"} and a newline
    int16  raw      (steps, columns)   the columns of the inputs (counts, words of commands) that are not all zero
    int32  setpoint (steps,)           left out when the header's "setpoint" is a number: constant
    uint32 digest   (steps,)           CRC-32 of every step's words
    uint32 check                       CRC-32 of every byte before it, the header included

A vector of another kind than steps has the format `plumb golden 4`, whose header has four fields more:

    "kind"            retune, plausibility or refusal
    "changes"         of a retune: [[step, {word: value}], ...], from that step on, against the parameters before
    "tables"          of a refusal: [{word: value}, ...], each against "params"; "steps" is their number
    "unit_turn2_q56"  of a plausibility: the value of 2^32 lsb of variance

"params" are the parameter words that the system reads, "final" the words of the last step, by name. "on_link" marks the
vectors that are also run over a link, where a step costs a frame. A vector has one form: a file with other bytes, for
example an additional space in its header, is refused, even if its meaning is the same.
"""

from __future__ import annotations

import json
import stat
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.proof.golden_json import integer, integers, json_object
from plumb.proof.golden_recipe import MAX_STEPS, is_name
from plumb.proof.golden_task_file import task_fields, task_of_fields
from plumb.spec import declarations, parameters
from plumb.spec.records import RECORDS
from plumb.spec.system import COMMAND_WORDS_MAX, COUNTS_MAX
from plumb.systems.tasks import Task

FORMAT = "plumb golden 3"
TASK_FORMAT = "plumb golden 4"
SUFFIX = ".golden"
MAX_HEADER_BYTES = 1 << 16
MAX_FILE_BYTES = MAX_HEADER_BYTES + (2 * (COUNTS_MAX + COMMAND_WORDS_MAX) + 8) * MAX_STEPS + 4
"""Header; for every step the inputs, a setpoint and a digest; the check value."""
_FIELDS = {"format", "name", "system", "on_link", "steps", "columns", "setpoint", "params", "final"}
_TASK_FIELDS = _FIELDS | {"kind", "changes", "tables", "unit_turn2_q56"}


@dataclass(frozen=True)
class Vector:
    """One golden vector. raw: (steps, inputs) int16; setpoint: (steps,) int32; digests: (steps,) uint32."""

    name: str
    system: str
    on_link: bool
    params: ControlParams
    raw: RawCounts
    setpoint: Setpoints
    digests: npt.NDArray[np.uint32]
    final: dict[str, int]
    task: Task | None = None

    @property
    def kind(self) -> str:
        return "step" if self.task is None else self.task.kind

    def encode(self) -> bytes:
        columns = [i for i in range(self.raw.shape[1]) if self.raw[:, i].any()]
        constant = bool((self.setpoint == self.setpoint[0]).all())
        header = {
            "format": FORMAT,
            "name": self.name,
            "system": self.system,
            "on_link": self.on_link,
            "steps": len(self.raw),
            "columns": columns,
            "setpoint": int(self.setpoint[0]) if constant else None,
            "params": self.params.own(),
            "final": self.final,
        }
        if self.task is not None:
            header |= {"format": TASK_FORMAT, **task_fields(self.task)}
        payload = self.raw[:, columns].astype("<i2").tobytes()
        payload += b"" if constant else self.setpoint.astype("<i4").tobytes()
        payload += self.digests.astype("<u4").tobytes()
        return sealed(json.dumps(header).encode() + b"\n" + payload)

    @classmethod
    def read(cls, path: Path) -> Vector:
        """Raises UsageError for a file that is not a complete golden vector."""
        return cls.decode(read_bounded(path, MAX_FILE_BYTES), path)

    @classmethod
    def decode(cls, data: bytes, path: Path) -> Vector:
        """From the bytes of a file; raises UsageError, with the path, when they are not a complete golden vector."""
        try:
            vector = cls._decode(data)
            if vector.encode() != data:
                raise ValueError("it holds a vector, but in other bytes than plumb writes")
            return vector
        except (ValueError, RecursionError, UsageError) as error:
            reason = "its header is nested too deeply" if isinstance(error, RecursionError) else str(error)
            raise UsageError(
                f"{path} is not a whole golden vector ({reason}); make it again with: plumb golden make"
            ) from None

    @classmethod
    def _decode(cls, data: bytes) -> Vector:
        end = data.find(b"\n", 0, MAX_HEADER_BYTES)
        if end < 0:
            raise ValueError("it has no header")
        header = json_object(data[:end])
        if header.get("format") not in (FORMAT, TASK_FORMAT):
            raise ValueError(f"its format is neither '{FORMAT}' nor '{TASK_FORMAT}'")
        fields = _FIELDS if header["format"] == FORMAT else _TASK_FIELDS
        if zlib.crc32(data[:-4]) != int.from_bytes(data[-4:], "little"):
            raise ValueError("its check value is wrong, so it is damaged")
        if set(header) != fields:
            raise ValueError(f"its header must have exactly the fields {', '.join(sorted(fields))}")
        name, system, on_link = header["name"], header["system"], header["on_link"]
        if not is_name(name):
            raise ValueError("its name is not valid")
        if system not in declarations.names():
            raise ValueError("its system does not exist")
        if not isinstance(on_link, bool):
            raise ValueError("on_link is neither true nor false")
        steps = integer(header["steps"], 1, MAX_STEPS, "steps")
        columns = header["columns"]
        if not isinstance(columns, list):
            raise ValueError("columns is no list")
        inputs = declarations.system(system).inputs
        columns = [integer(column, 0, inputs - 1, "a column") for column in columns]
        if columns != sorted(set(columns)):
            raise ValueError("the columns are not in ascending order")
        constant = header["setpoint"]
        if constant is not None:
            constant = integer(constant, -(1 << 31), (1 << 31) - 1, "setpoint")
        payload = memoryview(data)[end + 1 : -4]
        counts_bytes, setpoint_bytes = 2 * steps * len(columns), 0 if constant is not None else 4 * steps
        if len(payload) != counts_bytes + setpoint_bytes + 4 * steps:
            raise ValueError(f"it has {len(payload)} bytes after the header, which does not fit {steps} steps")
        values = integers(header["params"], "params")
        former = next((name for name in values if name in parameters.new_names()), None)
        if former is not None:
            now = parameters.new_names()[former]
            raise ValueError(f"it says {former}, which is named {now} now")
        params = ControlParams.of(system, values)
        final = integers(header["final"], "final")
        raw = np.zeros((steps, inputs), np.int16)
        raw[:, columns] = np.frombuffer(payload[:counts_bytes], "<i2").reshape(steps, len(columns))
        if constant is None:
            varying = np.frombuffer(payload[counts_bytes : counts_bytes + setpoint_bytes], "<i4")
            setpoint = varying.astype(np.int32)
        else:
            setpoint = np.full(steps, constant, np.int32)
        digests = np.frombuffer(payload[counts_bytes + setpoint_bytes :], "<u4").astype(np.uint32)
        task = None if header["format"] == FORMAT else task_of_fields(header, params, raw, setpoint)
        if set(final) != set((RECORDS[system] if task is None else task.record).names or ()):
            raise ValueError(f"final does not hold the words of a step of {system}")
        return cls(name, system, on_link, params, raw, setpoint, digests, final, task)


def sealed(data: bytes) -> bytes:
    """The bytes of a container with its check value behind them."""
    return data + zlib.crc32(data).to_bytes(4, "little")


def read_bounded(path: Path, limit: int) -> bytes:
    """The bytes of a regular file of at most `limit` bytes; raises UsageError for anything else."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise UsageError(f"{path} is not a file")
        if status.st_size > limit:
            raise UsageError(f"{path} is larger than {limit} bytes, which no file of its kind is")
        with path.open("rb") as file:
            return file.read(limit + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read ({error.strerror}); make it again with: plumb golden make") from None
