"""The record of a step: its words (raw inputs, intermediate values, outputs) in the declared order.

A record is little endian and without padding, byte for byte the firmware's struct, which is generated from the same
declaration; the digest of a step is the CRC-32 of these bytes. Every record begins with the raw counts and the setpoint
and ends with the flags and the step number.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.spec.system import TYPES, Word


def dtype_of(words: Iterable[Word]) -> np.dtype[np.void]:
    """Packed numpy type of a record with these words."""
    return np.dtype([(word.name, TYPES[word.type]) for word in words])


RECORDS: dict[str, np.dtype[np.void]] = {
    name: dtype_of(system.words) for name, system in declarations.systems().items()
}
"""System -> numpy type of its record, in the order of the systems' numbers."""


PLAUSIBILITY: np.dtype[np.void] = np.dtype(
    [(f"{name}_s_q33", "<u4") for name in ("accel", "innovation", "rate", "converged", "ready")]
    + [(name, "<i4") for name in ("mismatch_turn_q32", "unevenness_turn_q32", "measured_turn_q32", "rate_turnps_q28",
                                  "innovation_turn_q32", "rate_mean_turnps_q28", "accel_mean_g2_q20")]
    + [(name, "<u4") for name in ("begun", "converged", "failed", "missing")]
)  # fmt: skip
"""plumb_plausibility_t after a step, each member as a word of 32 bits."""
VALIDITY: np.dtype[np.void] = np.dtype([("valid", "<u4")])
"""Whether the core takes a table of parameters: 1 or 0."""


def block_dtype(name: str) -> np.dtype[np.void]:
    """Numpy type of a kernel's state struct (blocks.toml); only for structs without arrays."""
    return np.dtype([(word["name"], TYPES[word["type"]]) for word in declarations.blocks()[name]["words"]])


def names_of(system: str) -> tuple[str, ...]:
    """Names of the words of a system's record, in order."""
    return RECORDS[system].names or ()


def packer(system: str) -> struct.Struct:
    """Packs the values of one record, in order, into the bytes that the digest is taken over."""
    kinds = {"i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
    return struct.Struct("<" + "".join(kinds[RECORDS[system][name].str[1:]] for name in names_of(system)))


class Words(Mapping[str, npt.NDArray[np.int64]]):
    """The records of a run of one system, or what is beside them, by word: name -> int64 array of shape (steps,) or
    (steps, runs)."""

    def __init__(self, record: npt.NDArray[np.void]) -> None:
        if record.dtype not in (*RECORDS.values(), PLAUSIBILITY, VALIDITY):
            raise UsageError(f"no system's step is a record of {record.dtype}")
        self.record = np.ascontiguousarray(record)

    @classmethod
    def from_bytes(cls, data: bytes | bytearray | memoryview, shape: tuple[int, ...], system: str) -> Words:
        """From the packed bytes of the firmware's structs. shape: (steps,) or (steps, runs), in C order."""
        return cls(np.frombuffer(data, RECORDS[system]).reshape(shape))

    @property
    def system(self) -> str:
        return next(name for name, dtype in RECORDS.items() if dtype == self.record.dtype)

    @property
    def names(self) -> tuple[str, ...]:
        return self.record.dtype.names or ()

    def __getitem__(self, name: str) -> npt.NDArray[np.int64]:
        return self.record[name].astype(np.int64)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def digests(self) -> npt.NDArray[np.uint32]:
        """CRC-32 of every record, shape (steps,) or (steps, runs)."""
        size = self.record.dtype.itemsize
        data = memoryview(self.record.tobytes())
        crcs = [zlib.crc32(data[at : at + size]) for at in range(0, len(data), size)]
        return np.array(crcs, np.uint32).reshape(self.record.shape)
