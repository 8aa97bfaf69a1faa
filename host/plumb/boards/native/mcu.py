"""The native board: the shipped main loop in this process on simulated hardware (firmware/ports/native), without
Unicorn.

    mcu = NativeMcu()
    session = Session.open(mcu.uart)       # or Session.over(NativeCanBus(mcu))
    mcu.wires.arm_switch = 1
    mcu.run_us(1000)
    mcu.wires.pulse_halfus[0]

Time is simulated and passes only in the calls that advance it; the same calls give the same bytes.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import tempfile
from collections import deque
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path

import can
from can.typechecking import CanFilters

from plumb.boards.native.build import BUILD
from plumb.checkout import CHECKOUT, PACKAGE
from plumb.errors import UsageError
from plumb.spec.protocol import Frame, check, protocol

LIBRARY = "libplumb_board.so"
SLICE_US = 100
"""Time step of a wait for the board."""
_CHUNK = 4096
_FLASH_CELLS = 2048


class Identity(ctypes.Structure):
    """board_identity_t of firmware/app/board.h."""

    _fields_ = [
        ("part_id", ctypes.c_uint32),
        ("unique_id", ctypes.c_uint32 * 3),
        ("git_hash", ctypes.c_uint32 * 2),
        ("git_dirty", ctypes.c_uint32),
        ("flash_kib", ctypes.c_uint32),
        ("ram_kib", ctypes.c_uint32),
        ("reset_cause", ctypes.c_uint32),
        ("crash_pc", ctypes.c_uint32),
        ("crash_exception", ctypes.c_uint32),
        ("pins", ctypes.c_uint32),
        ("seed", ctypes.c_uint32),
    ]


class Wires(ctypes.Structure):
    """native_wires_t of firmware/ports/native/native.h, which says what each field means."""

    _fields_ = [
        ("identity", Identity),
        ("raw", ctypes.c_int32 * 9),
        *((name, ctypes.c_uint32) for name in (
            "arm_switch", "strap", "bridge_break", "hall_lost", "uart_in_byte_ns", "uart_out_byte_ns",
            "receiver_byte_ns", "battery_voltage", "battery_current",
            "can_kbit", "can_frame_ns", "faults", "railed", "stuck", "gyro", "accel", "adc_dead",
            "uart_damaged", "can_dead",
            "no_crystal", "image_damaged", "hangs", "turn_us", "flash_refuses", "flash_cut", "flash_cut_way",
            "state", "resets",
        )),
        ("pulse_halfus", ctypes.c_uint32 * 4),
        ("frame_halfus", ctypes.c_uint32),
        ("bridge_on", ctypes.c_uint32),
        ("duty_q15", ctypes.c_int32),
        ("wheels_on", ctypes.c_uint32),
        ("wheel_duty_q15", ctypes.c_int32 * 2),
        *((name, ctypes.c_uint32) for name in ("bus_offs", "turns", "armed", "steps", "receive_room")),
    ]  # fmt: skip


class _CanFrame(ctypes.Structure):
    _fields_ = [("id", ctypes.c_uint32), ("dlc", ctypes.c_uint32), ("data", ctypes.c_uint8 * 8)]


class State(IntEnum):
    OFF = 0
    RUNNING = 1
    BOOTLOADER = 2


NEVER = 0xFFFFFFFF
"""Value of a time in Wires that never passes."""


def library_path() -> Path:
    """Path of the library; without one raises UsageError, which says how to build it."""
    for path in (PACKAGE / LIBRARY, CHECKOUT / "build" / "native" / LIBRARY):
        if path.is_file():
            return path
    raise UsageError(f"the native board is not built: run '{BUILD}' in the checkout, or 'pip install .' there")


def _load(path: Path) -> ctypes.CDLL:
    """Load a copy of the library: each board needs its own, because the state is in static memory. The copy stays
    loaded."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # Windows keeps a library that is loaded
        copy = Path(folder) / path.name
        shutil.copy(path, copy)
        try:
            library = ctypes.CDLL(str(copy))
        except OSError as error:
            raise UsageError(f"{path} does not load ({error}): run '{BUILD}' in the checkout") from error
    for name in ("wires_bytes", "uart_send", "uart_receive", "receiver_send", "receiver_edge", "guarded_bytes"):
        getattr(library, f"native_{name}").restype = ctypes.c_size_t
    for name in ("can_send", "can_receive"):
        getattr(library, f"native_{name}").restype = ctypes.c_bool
    library.native_now_us.restype = ctypes.c_uint64
    library.native_flash_operations.restype = ctypes.c_uint32
    for name in ("flash", "flash_stuck_high"):
        getattr(library, f"native_{name}").restype = ctypes.POINTER(ctypes.c_uint16 * _FLASH_CELLS)
    if library.native_wires_bytes() != ctypes.sizeof(Wires):
        raise UsageError(f"{path} is of another version than this package: run '{BUILD}' in the checkout")
    return library


class NativeMcu:
    """A native board. library: another build of it. time_us: count of the board's clock at the start. power: switch the
    board on."""

    def __init__(self, library: Path | None = None, *, time_us: int = 0, power: bool = True) -> None:
        self._library = _load(library or library_path())
        self.wires = Wires.in_dll(self._library, "native")
        self.uart = NativeUart(self)
        self._library.native_defaults()
        if time_us:
            self._library.native_set_clock_us(ctypes.c_uint32(time_us & NEVER))
        if power:
            self.power_on()

    # ---- power and time ----

    def power_on(self) -> None:
        """Start the board, up to the first turn of the loop; the flash keeps its contents."""
        self._library.native_power_on()

    def power_off(self) -> None:
        self._library.native_power_off()

    @property
    def state(self) -> State:
        return State(self.wires.state)

    @property
    def now_us(self) -> int:
        """Simulated microseconds since the object was created."""
        return int(self._library.native_now_us())

    def sense(self, counts: Sequence[int]) -> None:
        """Counts that the sensors give from now on; those that are not given keep their values."""
        self.wires.raw[: len(counts)] = counts

    def run_us(self, time_us: int) -> None:
        """Advance the time; the loop sleeps and wakes as on the chip."""
        self._library.native_run(ctypes.c_uint32(time_us))

    def turn(self, time_us: int = SLICE_US) -> None:
        """Advance the time without the loop, then run one turn of it."""
        self._library.native_turn(ctypes.c_uint32(time_us))

    def set_clock_us(self, time_us: int) -> None:
        """Let the board's clock jump to another count."""
        self._library.native_set_clock_us(ctypes.c_uint32(time_us & NEVER))

    # ---- links ----

    def uart_send(self, data: bytes) -> int:
        """Send bytes to the board; returns how many the line accepted."""
        return int(self._library.native_uart_send(data, ctypes.c_size_t(len(data))))

    def uart_receive(self) -> bytes:
        out = ctypes.create_string_buffer(_CHUNK)
        data = b""
        while count := self._library.native_uart_receive(out, ctypes.c_size_t(_CHUNK)):
            data += out.raw[:count]
        return data

    def receiver_send(self, data: bytes) -> int:
        """Bytes of the radio receiver to the board; returns how many the line took."""
        return int(self._library.native_receiver_send(data, ctypes.c_size_t(len(data))))

    def receiver_edge(self, at_us: int) -> int:
        """A rising edge of the receiver's pulse train at a time of the board; returns how many the line took."""
        return int(self._library.native_receiver_edge(ctypes.c_uint64(at_us)))

    def can_send(self, identifier: int, data: bytes) -> bool:
        """Send a frame to the board; False when the bus has no room."""
        frame = _CanFrame(identifier, len(data), (ctypes.c_uint8 * 8)(*data))
        return bool(self._library.native_can_send(ctypes.byref(frame)))

    def can_receive(self) -> list[Frame]:
        """The frames that the board has sent since the last call."""
        frame, frames = _CanFrame(), []
        while self._library.native_can_receive(ctypes.byref(frame)):
            frames.append((int(frame.id), bytes(frame.data)[: frame.dlc]))
        return frames

    # ---- memory ----

    @property
    def flash(self) -> ctypes.Array[ctypes.c_uint16]:
        """The half-words of both slots of saved parameters."""
        cells: ctypes.Array[ctypes.c_uint16] = self._library.native_flash().contents
        return cells

    @property
    def flash_stuck_high(self) -> ctypes.Array[ctypes.c_uint16]:
        """Worn bits of these half-words: always 1."""
        cells: ctypes.Array[ctypes.c_uint16] = self._library.native_flash_stuck_high().contents
        return cells

    @property
    def flash_operations(self) -> int:
        """Pages erased and half-words programmed since the object was made."""
        return int(self._library.native_flash_operations())

    @property
    def guarded_bytes(self) -> int:
        """Size of the guarded memory, which decides the outputs."""
        return int(self._library.native_guarded_bytes())

    def flip(self, at: int, bit: int) -> None:
        """Flip a bit of the guarded memory."""
        self._library.native_flip(ctypes.c_size_t(at), ctypes.c_uint32(bit))


class NativeUart:
    """The host's end of the UART: read, write and in_waiting of a serial port. timeout: simulated seconds that a read
    waits for a first byte."""

    def __init__(self, mcu: NativeMcu) -> None:
        self._mcu = mcu
        self.name = "the native board"
        self.timeout = 0.005
        self._down = b""
        self._up = b""

    def clock_s(self) -> float:
        """Simulated seconds: the clock for time-outs."""
        return float(self._mcu.now_us) * 1e-6

    def pass_us(self, time_us: int) -> None:
        """Advance the time; waiting bytes move in both directions."""
        if self._down:
            self._down = self._down[self._mcu.uart_send(self._down) :]
        self._mcu.run_us(time_us)
        self._collect()

    def _collect(self) -> None:
        self._up += self._mcu.uart_receive()

    @property
    def in_waiting(self) -> int:
        self._collect()
        return len(self._up)

    def write(self, data: bytes) -> int:
        """Queue bytes on the line to the board; takes no time."""
        self._down += bytes(data)
        self._down = self._down[self._mcu.uart_send(self._down) :]
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; lets up to `timeout` pass for the first."""
        end_us = self._mcu.now_us + round(self.timeout * 1e6)
        while not self.in_waiting and self._mcu.now_us < end_us:
            self.pass_us(SLICE_US)
        out, self._up = self._up[:size], self._up[size:]
        return out

    def reset_input_buffer(self) -> None:
        self._up = b""
        self._mcu.uart_receive()

    def flush(self) -> None:
        """Does nothing: writes are not buffered."""

    def close(self) -> None:
        """Does nothing: there is nothing to release."""


class NativeCanBus(can.BusABC):
    """The other nodes on the board's CAN bus, as a python-can bus. clock: simulated seconds."""

    def __init__(self, mcu: NativeMcu, can_filters: CanFilters | None = None) -> None:
        self.mcu = mcu
        self.rejected = 0
        self.channel_info = "CAN of the native board"
        self._frames: deque[Frame] = deque()
        self._known = protocol().by_identifier
        super().__init__("the native board", can_filters=can_filters)

    def clock(self) -> float:
        return self.mcu.now_us * 1e-6

    def _wait(self, timeout_s: float) -> None:
        end_us = self.mcu.now_us + math.ceil(timeout_s * 1e6)
        self._frames.extend(self.mcu.can_receive())
        while not self._frames and self.mcu.now_us < end_us:
            self.mcu.run_us(min(SLICE_US, end_us - self.mcu.now_us))
            self._frames.extend(self.mcu.can_receive())

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """Frames of the protocol with a right CRC; advances up to timeout_s for the first frame."""
        self._wait(timeout_s)
        frames = [(identifier, data) for identifier, data in self._frames if identifier in self._known]
        self._frames.clear()
        good = [frame for frame in frames if check(*frame)]
        self.rejected += len(frames) - len(good)
        return good

    def write_frames(self, frames: Sequence[Frame]) -> None:
        for identifier, data in frames:
            self._send(identifier, data)

    def _send(self, identifier: int, data: bytes) -> None:
        while not self.mcu.can_send(identifier, data):
            self.mcu.run_us(SLICE_US)

    # ---- python-can ----

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._wait(0.5 if timeout is None else timeout)
        if not self._frames:
            return None, False
        identifier, data = self._frames.popleft()
        message = can.Message(timestamp=self.clock(), arbitration_id=identifier, is_extended_id=False, data=data)
        return message, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if not msg.is_extended_id and not msg.is_remote_frame:
            self._send(msg.arbitration_id, bytes(msg.data))
