"""The host's end of the simulated UART, in process, with the interface of a serial port object.

Reading advances simulated time as far as needed, by `timeout` at most; writing takes no time.
"""

from __future__ import annotations

from typing import Protocol

from plumb.f103.core.timeline import TICKS_PER_S
from plumb.f103.peripherals.usart import FE, NE, ORE, Usart

LOOK_AHEAD = 128
"""Bytes for which a read waits while the board goes on sending: frames arrive whole, in few calls, and a board that
never pauses cannot hold up the reader."""


class WiredChip(Protocol):
    """The machine whose UART the stream is the other end of."""

    @property
    def now(self) -> int: ...
    @property
    def rom(self) -> object | None:
        """The ROM bootloader while it has the UART."""

    def rom_receives(self, data: bytes, /) -> bytes: ...
    def run_to(self, time: int, /) -> None: ...
    def run_until_sending(self, deadline: int, /) -> None: ...


class UartStream:
    """read, write and in_waiting of a serial port. timeout: simulated seconds that a read waits for its first byte."""

    def __init__(self, machine: WiredChip, usart: Usart, *, of_rom: bool = False) -> None:
        """of_rom: the ROM bootloader, while it runs, has this UART."""
        self.machine, self._usart, self._of_rom = machine, usart, of_rom
        self.timeout = 0.02
        self.name = "the virtual board"
        self._arrived = bytearray()

    @property
    def baudrate(self) -> int:
        return self._usart.host_baud

    @baudrate.setter
    def baudrate(self, baud: int) -> None:
        self._usart.host_baud = baud

    def clock_s(self) -> float:
        """Simulated seconds, the clock of all time-outs, so that a run does not depend on the speed of the host."""
        return self.machine.now / TICKS_PER_S

    def write(self, data: bytes) -> int:
        """Queue bytes on the line to the board; they arrive at the baud rate as simulated time passes."""
        if self._of_rom and self.machine.rom is not None:
            self._arrived += self.machine.rom_receives(bytes(data))
        else:
            self._usart.receive(bytes(data))
        return len(data)

    @property
    def in_waiting(self) -> int:
        """Number of bytes that have arrived; takes no time."""
        self._collect()
        return len(self._arrived)

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes: fewer when the board pauses after at least one or when LOOK_AHEAD have arrived, none when
        `timeout` passes first."""
        machine = self.machine
        deadline = machine.now + int(self.timeout * TICKS_PER_S)
        self._collect()
        while len(self._arrived) < min(size, LOOK_AHEAD) and machine.now < deadline:
            under_way = self._usart.time_of_byte(LOOK_AHEAD - len(self._arrived))
            if under_way is not None:
                machine.run_to(min(under_way, deadline))
            elif self._arrived:
                break
            else:
                machine.run_until_sending(deadline)
            self._collect()
        out = bytes(self._arrived[:size])
        del self._arrived[:size]
        return out

    def _collect(self) -> None:
        self._arrived += self._usart.bytes_out(self.machine.now)

    def reset_input_buffer(self) -> None:
        self._collect()
        self._arrived.clear()

    def flush(self) -> None:
        """Does nothing: writes are not buffered."""

    def close(self) -> None:
        """Does nothing: there is nothing to release."""

    # Fault injection

    def write_with_framing_error(self, data: bytes) -> None:
        for byte in data:
            self._usart.receive(bytes([byte]), FE)

    def write_with_noise(self, data: bytes) -> None:
        for byte in data:
            self._usart.receive(bytes([byte]), NE)

    def write_overrun(self, data: bytes) -> None:
        """Send bytes that take their time on the line but that the receiver loses, with its overrun flag set."""
        for byte in data:
            self._usart.receive(bytes([byte]), ORE)
