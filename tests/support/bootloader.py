"""The simulated ROM bootloader of host/plumb/flash/rom_model.py behind a pseudo-terminal: a chip at the end of an
adapter."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from types import TracebackType

from plumb.flash.rom_model import Faults, RomBootloader


class Bootloader(RomBootloader):
    """`with Bootloader() as chip:` serves at chip.port. flash: what it holds, 0xA5 everywhere at first."""

    def __init__(
        self,
        faults: Faults | None = None,
        *,
        device_id: int = 0x410,
        flash_kib: int = 64,
        extended: bool = False,
        version: int = 0x22,
    ) -> None:
        memory = bytearray(b"\xa5" * (flash_kib * 1024))

        def store(offset: int, data: bytes) -> None:
            memory[offset : offset + len(data)] = data

        super().__init__(memory, store, device_id=device_id, extended=extended, faults=faults, version=version)

    def __enter__(self) -> Bootloader:
        self._far, self._near = pty.openpty()
        tty.setraw(self._near)
        self.port = os.ttyname(self._near)
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._answer_the_port, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._wake_write, b"x")
        self._thread.join(10)
        for descriptor in (self._far, self._near, self._wake_read, self._wake_write):
            os.close(descriptor)

    def _answer_the_port(self) -> None:
        while True:
            ready, _, _ = select.select([self._far, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            os.write(self._far, self.receive(os.read(self._far, 4096)))
