"""The firmware's session and core in this process: a board of memory whose clock only the test moves."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TURN_US = 100
AT_REST = (1676, 2048, 3041, 0, 0, 0)
"""Counts of an axis that is level and still, by the calibration of the default table."""


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Compiled once a run, undefined behaviour trapped."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    assert compiler, "a C compiler is needed"
    own = ("link_board", "keepalive_study", "flash")
    sources = [*(ROOT / f"tests/c/{name}.c" for name in own), *sorted((ROOT / "firmware/link").glob("*.c"))]
    for folder in ("core", "systems", "generated"):
        sources += sorted((ROOT / "firmware" / folder).glob("*.c"))
    with tempfile.TemporaryDirectory() as temporary:
        target = Path(temporary) / "liblink_board.so"
        flags = ["-std=c99", "-O1", "-g", "-fPIC", "-shared", "-Wall", "-Wextra", "-Werror", f"-I{ROOT}/firmware"]
        flags += ["-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]
        subprocess.run([compiler, *flags, "-o", str(target), *map(str, sources)], check=True)
        loaded = ctypes.CDLL(str(target))
    for name in ("bytes", "take", "give", "room", "parse"):
        getattr(loaded, f"link_board_{name}").restype = ctypes.c_size_t
    loaded.link_board_armed.restype = loaded.link_board_leaves.restype = ctypes.c_bool
    loaded.link_board_crc8.restype = ctypes.c_uint8
    loaded.keepalive_study.restype = ctypes.c_uint32
    return loaded


class MemoryBoard:
    """The far end of a serial link. As a stream (read, write, in_waiting, clock_s) it is what PlumbBus takes.

    down_per_turn, up_per_turn: what the simulated UART carries in a turn of 100 us (921600 baud: 9). spoil_down,
    spoil_up: called with every chunk on its way, to damage it.
    """

    def __init__(self, seed: int = 1, time_us: int = 0) -> None:
        self.lib = library()
        self._memory = ctypes.create_string_buffer(self.lib.link_board_bytes())
        self.time_us = time_us
        self.down_per_turn = self.up_per_turn = 4096
        self.spoil_down: Callable[[bytes], bytes] = bytes
        self.spoil_up: Callable[[bytes], bytes] = bytes
        self._down = b""
        self._up = b""
        self.lib.flash_blank()
        self.reset(seed)

    def reset(self, seed: int = 1) -> None:
        """Power off and on: what was saved is found again."""
        self.lib.link_board_init(self._memory, seed)
        self.sensors()

    # ---- the UART, by hand ----

    def say(self, text: bytes, turns: int = 3) -> bytes:
        """Send text, let some turns go by, and give what was answered."""
        self.write(text)
        for _ in range(turns):
            self.turn()
        return self.heard()

    def heard(self) -> bytes:
        data, self._up = self._up, b""
        return data

    def turn(self, step_us: int = TURN_US) -> None:
        self.time_us += step_us
        now = ctypes.c_uint32(self.time_us & 0xFFFFFFFF)
        part = self._down[: self.down_per_turn]
        taken = self.lib.link_board_take(self._memory, part, ctypes.c_size_t(len(part)), now)
        self._down = self._down[taken:]
        self.lib.link_board_turn(self._memory, now)
        out = ctypes.create_string_buffer(self.up_per_turn)
        count = self.lib.link_board_give(self._memory, out, ctypes.c_size_t(len(out)))
        if count:
            self._up += self.spoil_up(out.raw[:count])

    def run_us(self, time_us: int, step_us: int = TURN_US) -> None:
        for _ in range(time_us // step_us):
            self.turn(step_us)

    def sensors(self, raw: tuple[int, ...] = AT_REST, faults: int = 0) -> None:
        self.lib.link_board_sensors(self._memory, (ctypes.c_int16 * 6)(*raw), ctypes.c_uint32(faults))

    def switch(self, closed: bool) -> None:
        self.lib.link_board_switch(self._memory, ctypes.c_bool(closed))

    @property
    def leaves(self) -> bool:
        """On its way into the ROM bootloader."""
        return bool(self.lib.link_board_leaves(self._memory, ctypes.c_uint32(self.time_us & 0xFFFFFFFF)))

    def flash_cells(self) -> ctypes.Array[ctypes.c_uint16]:
        """The half-words of both slots."""
        return (ctypes.c_uint16 * 2048).in_dll(self.lib, "flash")

    @property
    def armed(self) -> bool:
        return bool(self.lib.link_board_armed(self._memory))

    @property
    def receive_room(self) -> int:
        """How many bytes the session would take now."""
        return int(self.lib.link_board_room(self._memory))

    @property
    def steps(self) -> int:
        return int(self.lib.link_board_steps(self._memory))

    @property
    def pulses(self) -> tuple[int, int]:
        pulses = (ctypes.c_uint32 * 2)()
        self.lib.link_board_pulses(self._memory, pulses)
        return pulses[0], pulses[1]

    # ---- as a stream ----

    def clock_s(self) -> float:
        return self.time_us * 1e-6

    @property
    def in_waiting(self) -> int:
        return len(self._up)

    def write(self, data: bytes) -> int:
        self._down += self.spoil_down(bytes(data))
        return len(data)

    def read(self, count: int) -> bytes:
        """What the board says, letting up to 5 ms go by until it says something."""
        for _ in range(50):
            if self._up:
                break
            self.turn()
        data, self._up = self._up[:count], self._up[count:]
        return data


def disarms(seconds: int, round_trip_ms: float, loss: float, frame_us: int, seed: int) -> int:
    """How often a host that answers at once loses the board over such a link: tests/c/keepalive_study.c."""
    arguments = (seconds, round(1000 * round_trip_ms), round(1e6 * loss), frame_us, seed)
    return int(library().keepalive_study(*map(ctypes.c_uint32, arguments)))


def parse(data: bytes) -> tuple[list[tuple[int, bytes]], int]:
    """The C parser on a whole stream: checked frames, and lines thrown away."""
    frames = ctypes.create_string_buffer(10 * (len(data) // 5 + 1))
    bad = ctypes.c_uint32()
    count = library().link_board_parse(data, ctypes.c_size_t(len(data)), frames, ctypes.byref(bad))
    entries = [frames.raw[10 * i : 10 * i + 10] for i in range(count)]
    return [(int.from_bytes(entry[:2], "big"), entry[2:]) for entry in entries], bad.value
