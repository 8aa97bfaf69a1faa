"""The words of a step: raw inputs, intermediates and outputs, in the written order that digests are taken over.

One numpy record per step and system, little endian, without padding: the same bytes as the firmware's struct. The order
is the one that each system declares; the C struct is generated from the same declaration. Every record begins with the
raw counts and the setpoint as given, and ends with the flags and the number of the step.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.spec import declarations


def dtype_of(words: Iterable[declarations.Word]) -> np.dtype[np.void]:
    """The packed record of declared words."""
    return np.dtype([(word.name, declarations.TYPES[word.type]) for word in words])


RECORDS: dict[str, np.dtype[np.void]] = {
    name: dtype_of(system.words) for name, system in declarations.systems().items()
}
"""The record of each system, in the order of their numbers."""


def block_dtype(name: str) -> np.dtype[np.void]:
    """The state struct of a kernel, as `plumb.spec.declarations.blocks` has it, of words that are no arrays."""
    return np.dtype([(word["name"], declarations.TYPES[word["type"]]) for word in declarations.blocks()[name]["words"]])


def names_of(system: str) -> tuple[str, ...]:
    """The words of a system's step in the written order."""
    return RECORDS[system].names or ()


def packer(system: str) -> struct.Struct:
    """Packs the values of one step, in the written order, into the bytes that the digest is taken over."""
    kinds = {"i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
    return struct.Struct("<" + "".join(kinds[RECORDS[system][name].str[1:]] for name in names_of(system)))


class Words(Mapping[str, npt.NDArray[np.int64]]):
    """Name -> int64 array of shape (steps,) or (steps, runs), backed by one packed record array of one system."""

    def __init__(self, record: npt.NDArray[np.void]) -> None:
        if record.dtype not in RECORDS.values():
            raise UsageError(f"no system's step is a record of {record.dtype}")
        self.record = np.ascontiguousarray(record)

    @classmethod
    def from_bytes(cls, data: bytes | bytearray | memoryview, shape: tuple[int, ...], system: str) -> Words:
        """From the packed bytes of the firmware's struct, steps (then runs) in C order."""
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
        """CRC-32 of every step's bytes, shape (steps,) or (steps, runs)."""
        size = self.record.dtype.itemsize
        data = memoryview(self.record.tobytes())
        crcs = [zlib.crc32(data[at : at + size]) for at in range(0, len(data), size)]
        return np.array(crcs, np.uint32).reshape(self.record.shape)
