"""Single C functions of the link: the parser, the CRC-8, and the session under a slow and lossy link."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.spec import dbc

LIBRARY = Path(__file__).resolve().parents[2] / "build" / "native" / "tests" / "c" / "liblink_functions.so"


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    loaded = ctypes.CDLL(str(LIBRARY))
    loaded.frames_parse.restype = ctypes.c_size_t
    loaded.frames_crc8.restype = ctypes.c_uint8
    loaded.table_unsafe.restype = ctypes.c_uint16
    loaded.injected_first_doubt.restype = ctypes.c_uint32
    loaded.receiver_follow.restype = ctypes.c_size_t
    loaded.pulses_follow.restype = ctypes.c_size_t
    loaded.crsf_after_damage.restype = ctypes.c_size_t
    loaded.keepalive_study.restype = ctypes.c_uint32
    return loaded


def crc8(identifier: int, length: int, data: bytes) -> int:
    """Byte 0 that a frame should have."""
    return int(library().frames_crc8(identifier, length, (ctypes.c_uint8 * 8)(*data)))


def unsafe(words: Sequence[int]) -> int:
    """Index of the first word with which the board is not armed; the number of words: there is none."""
    return int(library().table_unsafe((ctypes.c_uint32 * len(words))(*(word & 0xFFFFFFFF for word in words))))


def first_doubt(words: Sequence[int], counts: npt.NDArray[np.int16]) -> int:
    """The first step, from 1 on, at which punctual injected samples with these counts disarm the board; 0: none."""
    table = (ctypes.c_uint32 * len(words))(*(word & 0xFFFFFFFF for word in words))
    rows = np.zeros((len(counts), dbc.inputs_most()), np.int16)
    rows[:, : counts.shape[1]] = counts
    return int(library().injected_first_doubt(table, rows.ctypes.data_as(ctypes.c_void_p), ctypes.c_uint32(len(rows))))


def disarms(seconds: int, round_trip_ms: float, loss: float, frame_us: int, seed: int) -> int:
    """How often a host that answers at once loses the board over such a link: tests/c/keepalive_study.c."""
    arguments = (seconds, round(1000 * round_trip_ms), round(1e6 * loss), frame_us, seed)
    return int(library().keepalive_study(*map(ctypes.c_uint32, arguments)))


def parse(data: bytes) -> tuple[list[tuple[int, bytes]], int]:
    """The C parser on a whole stream: checked frames, and lines thrown away."""
    frames = ctypes.create_string_buffer(10 * (len(data) // 5 + 1))
    bad = ctypes.c_uint32()
    count = library().frames_parse(data, ctypes.c_size_t(len(data)), frames, ctypes.byref(bad))
    entries = [frames.raw[10 * i : 10 * i + 10] for i in range(count)]
    return [(int.from_bytes(entry[:2], "big"), entry[2:]) for entry in entries], bad.value
