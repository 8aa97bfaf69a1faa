"""A simulated STM32F103 in its ROM bootloader (ST's AN3155, AN2606) behind a pseudo-terminal.

It keeps the real one's habits: no time-outs, silence until the first 0x7F, NACK for a command whose complement is
wrong, half-words that can only be programmed when they are erased. It misbehaves on request.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from operator import xor
from types import TracebackType

ACK, NACK = b"\x79", b"\x1f"
FLASH = 0x08000000
SYSTEM = 0x1FFFF000
SYSTEM_BYTES = 0x900
FLASH_SIZE = 0x1FFFF7E0
GET, GET_VERSION, GET_ID, READ, GO, WRITE, ERASE, EXTENDED_ERASE = 0x00, 0x01, 0x02, 0x11, 0x21, 0x31, 0x43, 0x44


@dataclass
class Faults:
    """deaf_syncs: so many first 0x7F are not heard. nack: command -> how many of it to refuse. stores_nothing: writes
    are acknowledged only. lose_received, lose_sent: numbers of bytes, from the first one after the sync, that vanish.
    stuck: address -> value that programming leaves there. protected: flash can neither be read nor written.
    hides_size: the size register cannot be read. dies_after: so many bytes."""

    deaf_syncs: int = 0
    nack: dict[int, int] = field(default_factory=dict)
    stores_nothing: bool = False
    lose_received: frozenset[int] = frozenset()
    lose_sent: frozenset[int] = frozenset()
    stuck: dict[int, int] = field(default_factory=dict)
    protected: bool = False
    hides_size: bool = False
    dies_after: int | None = None


class Bootloader:
    """`with Bootloader() as chip:` serves at chip.port. flash: what it holds, 0xA5 everywhere at first.

    erased, written, commands, started_at: page numbers, addresses and codes in order, and where GO went.
    """

    def __init__(
        self, faults: Faults | None = None, *, device_id: int = 0x410, flash_kib: int = 64, extended: bool = False
    ) -> None:
        self.faults = faults or Faults()
        self.device_id, self.extended = device_id, extended
        self.page_bytes = 1024 if device_id == 0x410 else 2048
        self.flash = bytearray(b"\xa5" * (flash_kib * 1024))
        self.flash_kib = flash_kib
        self.erased: list[int] = []
        self.written: list[int] = []
        self.commands: list[int] = []
        self.started_at: int | None = None
        self._received = self._sent = 0
        self._synchronised = False

    def __enter__(self) -> Bootloader:
        self._far, self._near = pty.openpty()
        tty.setraw(self._near)
        self.port = os.ttyname(self._near)
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._wake_write, b"x")
        self._thread.join(10)
        for descriptor in (self._far, self._near, self._wake_read, self._wake_write):
            os.close(descriptor)

    # ---- bytes ----

    def _chunks(self) -> Iterator[int]:
        while True:
            ready, _, _ = select.select([self._far, self._wake_read], [], [])
            if self._wake_read in ready:
                raise EOFError
            yield from os.read(self._far, 4096)

    def _byte(self) -> int:
        while True:
            byte = next(self._stream)
            if not self._synchronised:
                return byte
            number, self._received = self._received, self._received + 1
            if self.faults.dies_after is not None and number >= self.faults.dies_after:
                continue
            if number not in self.faults.lose_received:
                return byte

    def _bytes(self, count: int) -> bytes:
        return bytes(self._byte() for _ in range(count))

    def _send(self, data: bytes) -> None:
        kept = bytearray()
        for byte in data:
            number, self._sent = self._sent, self._sent + 1
            if number not in self.faults.lose_sent:
                kept.append(byte)
        os.write(self._far, kept)

    # ---- the protocol ----

    def _serve(self) -> None:
        self._stream = self._chunks()
        with contextlib.suppress(EOFError):
            while not self._synchronised:
                if self._byte() == 0x7F:
                    self.faults.deaf_syncs -= 1
                    self._synchronised = self.faults.deaf_syncs < 0
            self._send(ACK)
            self._received = self._sent = 0
            while self.started_at is None:
                self._command()
            while True:
                self._byte()

    def _command(self) -> None:
        command, complement = self._bytes(2)
        known = {
            GET: self._get,
            GET_VERSION: self._get_version,
            GET_ID: self._get_id,
            READ: self._read,
            GO: self._go,
            WRITE: self._write,
            (EXTENDED_ERASE if self.extended else ERASE): self._extended_erase if self.extended else self._erase,
        }
        if command ^ complement != 0xFF or command not in known:
            self._send(NACK)
            return
        self.commands.append(command)
        if self.faults.nack.get(command, 0) > 0:
            self.faults.nack[command] -= 1
            self._send(NACK)
            return
        if self.faults.protected and command in (READ, GO, WRITE, ERASE, EXTENDED_ERASE):
            self._send(NACK)
            return
        self._send(ACK)
        known[command]()

    def _get(self) -> None:
        erase = EXTENDED_ERASE if self.extended else ERASE
        commands = bytes([GET, GET_VERSION, GET_ID, READ, GO, WRITE, erase, 0x63, 0x73, 0x82, 0x92])
        self._send(bytes([len(commands), 0x22]) + commands + ACK)

    def _get_version(self) -> None:
        self._send(b"\x22\x00\x00" + ACK)

    def _get_id(self) -> None:
        self._send(b"\x01" + self.device_id.to_bytes(2, "big") + ACK)

    def _address(self) -> int | None:
        data = self._bytes(5)
        address = int.from_bytes(data[:4], "big")
        in_system = SYSTEM <= address < SYSTEM + SYSTEM_BYTES
        if reduce(xor, data) or not (in_system or FLASH <= address < FLASH + len(self.flash)):
            self._send(NACK)
            return None
        if self.faults.hides_size and in_system:
            self._send(NACK)
            return None
        self._send(ACK)
        return address

    def _memory(self, address: int, count: int) -> bytes:
        if address >= SYSTEM:
            memory = bytearray(SYSTEM_BYTES)
            memory[FLASH_SIZE - SYSTEM : FLASH_SIZE - SYSTEM + 2] = self.flash_kib.to_bytes(2, "little")
            return bytes(memory[address - SYSTEM : address - SYSTEM + count])
        return bytes(self.flash[address - FLASH : address - FLASH + count])

    def _read(self) -> None:
        address = self._address()
        if address is None:
            return
        count, complement = self._bytes(2)
        if count ^ complement != 0xFF:
            self._send(NACK)
            return
        self._send(ACK + self._memory(address, count + 1))

    def _go(self) -> None:
        self.started_at = self._address()

    def _write(self) -> None:
        address = self._address()
        if address is None:
            return
        count = self._byte()
        data = self._bytes(count + 1)
        if reduce(xor, data, count) != self._byte() or address % 4 or (count + 1) % 4 or address >= SYSTEM:
            self._send(NACK)
            return
        self.written.append(address)
        self._send(ACK if self._program(address - FLASH, data) else NACK)

    def _program(self, offset: int, data: bytes) -> bool:
        if self.faults.stores_nothing:
            return True
        if any(self.flash[offset : offset + len(data)][i] != 0xFF for i in range(len(data))):
            return False
        self.flash[offset : offset + len(data)] = data
        for address, value in self.faults.stuck.items():
            if offset <= address - FLASH < offset + len(data):
                self.flash[address - FLASH] = value
        return True

    def _erase(self) -> None:
        count = self._byte()
        if count == 0xFF:
            self._erase_pages(range(len(self.flash) // self.page_bytes), self._byte() == 0)
            return
        pages = self._bytes(count + 1)
        self._erase_pages(pages, reduce(xor, pages, count) == self._byte())

    def _extended_erase(self) -> None:
        head = self._bytes(2)
        count = int.from_bytes(head, "big")
        if count >= 0xFFF0:
            self._erase_pages(range(len(self.flash) // self.page_bytes), reduce(xor, head) == self._byte())
            return
        body = self._bytes(2 * (count + 1))
        pages = [int.from_bytes(body[i : i + 2], "big") for i in range(0, len(body), 2)]
        self._erase_pages(pages, reduce(xor, head + body) == self._byte())

    def _erase_pages(self, pages: bytes | range | list[int], good: bool) -> None:
        if not good or any((page + 1) * self.page_bytes > len(self.flash) for page in pages):
            self._send(NACK)
            return
        for page in pages:
            self.erased.append(page)
            self.flash[page * self.page_bytes : (page + 1) * self.page_bytes] = b"\xff" * self.page_bytes
        self._send(ACK)
