"""The shipped loop on the native port, on the bench of a test: undefined behaviour ends the process.

A test reads its UART by hand (`say`, `received`), spoils what passes, and sets its wires.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

from plumb.boards.native.mcu import NativeCanBus, NativeMcu, NativeUart, State

BUILD = Path(__file__).resolve().parents[2] / "build" / "native" / "tests" / "c"
SLICE_US = 100
AT_REST = (1676, 2048, 3041, 0, 0, 0)
"""Counts of an axis that is level and still, by the calibration of the default table."""
BAUD_921600_NS = 10851
"""Time of a byte."""


class UartBoard(NativeUart):
    """The far end of a serial link, as a stream what PlumbBus takes, and the board behind it.

    spoil_down, spoil_up: called with every chunk on its way, to damage it; a chunk is what passes in 100 us.
    """

    def __init__(self, seed: int = 1, time_us: int = 0) -> None:
        mcu = NativeMcu(BUILD / "libplumb_board_trapping.so", time_us=time_us, power=False)
        super().__init__(mcu)
        self.mcu, self.wires, self._begin_us = mcu, mcu.wires, time_us
        self.wires.identity.unique_id[:] = (seed, 0x22222222, 0x33333333)
        self.wires.identity.git_hash[:] = (0x01234567, 0x89ABCDEF)
        self.spoil_down: Callable[[bytes], bytes] = bytes
        self.spoil_up: Callable[[bytes], bytes] = bytes
        mcu.power_on()

    def reset(self) -> None:
        """Power off and on: what was saved is found again, what was on the line is lost."""
        self.mcu.power_off()
        self._down = self._up = b""
        self.sensors()
        self.mcu.power_on()

    # ---- the UART, by hand ----

    def say(self, text: bytes, turns: int = 3) -> bytes:
        """Send text, let some turns go by, and give what was answered."""
        self.write(text)
        for _ in range(turns):
            self.pass_us(SLICE_US)
        return self.received()

    def received(self) -> bytes:
        data, self._up = self._up, b""
        return data

    def write(self, data: bytes) -> int:
        return super().write(self.spoil_down(bytes(data)))

    def _collect(self) -> None:
        data = self.mcu.uart_receive()
        if data:
            self._up += self.spoil_up(data)

    def turn(self, step_us: int = SLICE_US) -> None:
        """One turn of the loop, after so much time without it."""
        self.mcu.turn(step_us)
        self._collect()

    def run_us(self, time_us: int, step_us: int = SLICE_US) -> None:
        for _ in range(time_us // step_us):
            self.pass_us(step_us)

    # ---- wires ----

    def sensors(self, raw: tuple[int, ...] = AT_REST, faults: int = 0) -> None:
        self.mcu.sense(raw)
        self.wires.faults = faults

    def switch(self, closed: bool) -> None:
        self.wires.arm_switch = closed

    def baud(self, *, down_ns: int | None = None, up_ns: int | None = None) -> None:
        """Time of a byte to the board and from it; 0: none."""
        self.wires.uart_in_byte_ns = self.wires.uart_in_byte_ns if down_ns is None else down_ns
        self.wires.uart_out_byte_ns = self.wires.uart_out_byte_ns if up_ns is None else up_ns

    @property
    def time_us(self) -> int:
        """What its clock says, without the wrap."""
        return self._begin_us + self.mcu.now_us

    @property
    def leaves(self) -> bool:
        """Gone into the ROM bootloader."""
        return self.mcu.state == State.BOOTLOADER

    def flash_cells(self) -> ctypes.Array[ctypes.c_uint16]:
        """The half-words of both slots."""
        return self.mcu.flash

    @property
    def armed(self) -> bool:
        return bool(self.wires.armed)

    @property
    def receive_room(self) -> int:
        """How many bytes the session would take now."""
        return int(self.wires.receive_room)

    @property
    def steps(self) -> int:
        """Steps of the run, modulo 2^16."""
        return int(self.wires.steps)

    @property
    def pulses(self) -> tuple[int, int]:
        return self.wires.pulse_halfus[0], self.wires.pulse_halfus[1]

    # ---- the second link, and trouble ----

    def can_bus(self) -> NativeCanBus:
        return NativeCanBus(self.mcu)

    def stop_converter(self) -> None:
        self.wires.adc_dead = 1

    def rail_input(self, channel: int) -> None:
        self.wires.railed = 1 << channel

    def hang(self) -> None:
        """The loop comes round no more, until the next reset."""
        self.wires.hangs = 1

    def damage(self, data: bytes) -> None:
        """Bytes to the board that arrive with a framing error."""
        self.wires.uart_damaged = len(data)
        self.mcu.uart_send(data)

    def short_can(self, shorted: bool) -> None:
        self.wires.can_dead = shorted

    def flip(self, at: float, bit: int) -> None:
        """A bit of guarded memory, at this share of it."""
        self.mcu.flip(int(at * self.mcu.guarded_bytes), bit)

    def set_clock_back(self) -> None:
        self.mcu.set_clock_us(self.mcu.now_us // 2)

    def write_and_cut_power(self, request: bytes, operation: int) -> None:
        """Power fails in the middle of this operation of the flash, counted from the request."""
        self.wires.flash_cut, self.wires.flash_cut_way = operation, operation % 4
        self.write(request)
        self.run_us(20_000)
        assert self.mcu.state == State.OFF


NewBoard = Callable[[], UartBoard]
"""Makes a board that is switched on: in a test that takes `new_board`, on the native port or of the flash image."""
