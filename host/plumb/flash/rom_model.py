"""Model of the part's ROM bootloader on its UART (ST's AN3155, AN2606): bytes in, bytes out.

It behaves like the real one: no time-outs, no answer until the first 0x7F, NACK for a command whose complement is
wrong, half-words that can only be programmed when they are erased. Erasing and programming take no time here. Faults
can be injected.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import xor

ACK, NACK = b"\x79", b"\x1f"
FLASH = 0x08000000
SYSTEM = 0x1FFFF000
SYSTEM_BYTES = 0x900
FLASH_SIZE = 0x1FFFF7E0
GET, GET_VERSION, GET_ID, READ, GO, WRITE, ERASE, EXTENDED_ERASE = 0x00, 0x01, 0x02, 0x11, 0x21, 0x31, 0x43, 0x44

Bytes = Generator[None, int, bytes]
"""A coroutine that receives single bytes and returns the bytes of a field."""
Step = Generator[None, int, None]


@dataclass
class Faults:
    """Fault injection. deaf_syncs: number of first 0x7F that are ignored. nack: command -> how often to refuse it.
    stores_nothing: writes are acknowledged but not stored. lose_received, lose_sent: indices of bytes, counted from the
    first one after the sync, that get lost. stuck: address -> value that programming leaves there. protected: flash can
    neither be read nor written. hides_size: the size register cannot be read. dies_after: number of bytes after which
    it falls silent."""

    deaf_syncs: int = 0
    nack: dict[int, int] = field(default_factory=dict)
    stores_nothing: bool = False
    lose_received: frozenset[int] = frozenset()
    lose_sent: frozenset[int] = frozenset()
    stuck: dict[int, int] = field(default_factory=dict)
    protected: bool = False
    hides_size: bool = False
    dies_after: int | None = None


class RomBootloader:
    """The bootloader: receive() takes the bytes of the line and returns the answer. flash: the memory that it reads;
    store(offset, bytes) writes it.

    erased, written, commands: page numbers, addresses and command codes in order. started_at: target of GO.
    """

    def __init__(
        self,
        flash: bytearray | memoryview,
        store: Callable[[int, bytes], None],
        *,
        device_id: int = 0x410,
        extended: bool = False,
        version: int = 0x22,
        faults: Faults | None = None,
    ) -> None:
        self.faults = faults or Faults()
        self.device_id, self.extended, self.version = device_id, extended, version
        self.page_bytes = 1024 if device_id == 0x410 else 2048
        self.flash, self._store = flash, store
        self.erased: list[int] = []
        self.written: list[int] = []
        self.commands: list[int] = []
        self.started_at: int | None = None
        self._received = self._sent = 0
        self._synchronised = False
        self._answer = bytearray()
        self._program = self._serve()
        next(self._program)

    def receive(self, data: bytes) -> bytes:
        """The answer to these bytes; b"" after GO."""
        for byte in data:
            if self._synchronised:
                number, self._received = self._received, self._received + 1
                dead = self.faults.dies_after is not None and number >= self.faults.dies_after
                if dead or number in self.faults.lose_received:
                    continue
            self._program.send(byte)
        answer, self._answer = bytes(self._answer), bytearray()
        return answer

    def _send(self, data: bytes) -> None:
        for byte in data:
            number, self._sent = self._sent, self._sent + 1
            if number not in self.faults.lose_sent:
                self._answer.append(byte)

    def _bytes(self, count: int) -> Bytes:
        data = bytearray()
        while len(data) < count:
            data.append((yield))
        return bytes(data)

    # ---- the protocol ----

    def _serve(self) -> Step:
        while not self._synchronised:
            if (yield) == 0x7F:
                self.faults.deaf_syncs -= 1
                self._synchronised = self.faults.deaf_syncs < 0
        self._send(ACK)
        self._received = self._sent = 0
        while self.started_at is None:
            yield from self._command()
        while True:
            yield

    def _command(self) -> Step:
        command, complement = yield from self._bytes(2)
        known: dict[int, Callable[[], Step]] = {
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
        yield from known[command]()

    def _get(self) -> Step:
        erase = EXTENDED_ERASE if self.extended else ERASE
        commands = bytes([GET, GET_VERSION, GET_ID, READ, GO, WRITE, erase, 0x63, 0x73, 0x82, 0x92])
        self._send(bytes([len(commands), self.version]) + commands + ACK)
        yield from ()

    def _get_version(self) -> Step:
        self._send(bytes([self.version, 0, 0]) + ACK)
        yield from ()

    def _get_id(self) -> Step:
        self._send(b"\x01" + self.device_id.to_bytes(2, "big") + ACK)
        yield from ()

    def _address(self) -> Generator[None, int, int | None]:
        data = yield from self._bytes(5)
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
            memory[FLASH_SIZE - SYSTEM : FLASH_SIZE - SYSTEM + 2] = (len(self.flash) // 1024).to_bytes(2, "little")
            return bytes(memory[address - SYSTEM : address - SYSTEM + count])
        return bytes(self.flash[address - FLASH : address - FLASH + count])

    def _read(self) -> Step:
        address = yield from self._address()
        if address is None:
            return
        count, complement = yield from self._bytes(2)
        if count ^ complement != 0xFF:
            self._send(NACK)
            return
        self._send(ACK + self._memory(address, count + 1))

    def _go(self) -> Step:
        self.started_at = yield from self._address()

    def _write(self) -> Step:
        address = yield from self._address()
        if address is None:
            return
        count = yield
        data = yield from self._bytes(count + 1)
        checksum = yield
        if reduce(xor, data, count) != checksum or address % 4 or (count + 1) % 4 or address >= SYSTEM:
            self._send(NACK)
            return
        self.written.append(address)
        self._send(ACK if self._store_erased(address - FLASH, data) else NACK)

    def _store_erased(self, offset: int, data: bytes) -> bool:
        if self.faults.stores_nothing:
            return True
        if any(byte != 0xFF for byte in self.flash[offset : offset + len(data)]):
            return False
        stuck = {address - FLASH - offset: value for address, value in self.faults.stuck.items()}
        self._store(offset, bytes(stuck.get(at, byte) for at, byte in enumerate(data)))
        return True

    def _erase(self) -> Step:
        count = yield
        if count == 0xFF:
            checksum = yield
            self._erase_pages(range(len(self.flash) // self.page_bytes), checksum == 0)
            return
        pages = yield from self._bytes(count + 1)
        checksum = yield
        self._erase_pages(pages, reduce(xor, pages, count) == checksum)

    def _extended_erase(self) -> Step:
        head = yield from self._bytes(2)
        count = int.from_bytes(head, "big")
        if count >= 0xFFF0:
            checksum = yield
            self._erase_pages(range(len(self.flash) // self.page_bytes), reduce(xor, head) == checksum)
            return
        body = yield from self._bytes(2 * (count + 1))
        pages = [int.from_bytes(body[i : i + 2], "big") for i in range(0, len(body), 2)]
        checksum = yield
        self._erase_pages(pages, reduce(xor, head + body) == checksum)

    def _erase_pages(self, pages: Sequence[int], good: bool) -> None:
        if not good or any((page + 1) * self.page_bytes > len(self.flash) for page in pages):
            self._send(NACK)
            return
        for page in pages:
            self.erased.append(page)
            self._store(page * self.page_bytes, b"\xff" * self.page_bytes)
        self._send(ACK)
