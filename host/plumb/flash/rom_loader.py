"""Flashing over the ROM bootloader of an STM32F103 (ST's AN3155) with stm32loader: find it, erase pages, write, read
back.

The bootloader listens on USART1 (PA9, PA10) at 8E1 after a reset with BOOT0 high, and measures its baud rate from the
first byte, 0x7F. It has no time-outs: after a lost byte it waits for ever. The host then sends 0x7F until the
bootloader expects a command again: it refuses 0x7F 0x7F as a command.

stm32loader is under the GPL-3: an optional extra, imported only here and only when used.
"""

from __future__ import annotations

import contextlib
import io
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import xor
from types import ModuleType
from typing import Any, TypeVar

from plumb.errors import LinkError, UsageError
from plumb.extras import install_hint
from plumb.flash.image import FLASH_BASE
from plumb.flash.rom_model import RomBootloader
from plumb.link.identity import NackError
from plumb.link.transports.byte_stream import WRITE_TIMEOUT_S, OpenError, open_advice
from plumb.link.transports.serial_ports import check_port

FLASH_SIZE_ADDRESS = 0x1FFFF7E0  # RM0008 30.1.1, in KiB
BLOCK_BYTES = 256
REPLY_S = 1.0  # a page erase takes up to 40 ms (datasheet, table 30); the rest is margin
SYNC_S = 0.3
BRIDGE_PINS = 1
"""Number of the pin set with the UART on PB6 and PB7 (IDENTITY.PINS, parameter `pins`)."""
LEAVES_S = 0.3  # a board enters the bootloader 0.1 s after its answer to the request
_TRIES = 3
_ACK, _NACK, _SYNC = 0x79, 0x1F, b"\x7f"
WRITE_TO = b"\x08\x00\x00\x00\x08"
"""The address 0x08000000 and its checksum."""
Result = TypeVar("Result")

MOST_DEVICE_ID = 0xFFF
"""The number is 12 bits long (RM0008 31.6.1)."""
# Device ids of the F103 (AN2606): density, page size in bytes, smallest flash of this density in KiB.
_DENSITIES = {
    0x410: ("medium density", 1024, 64),
    0x414: ("high density", 2048, 256),
    0x430: ("XL density", 2048, 768),
}


class SilenceError(OSError):
    """Fewer bytes arrived than expected."""


@dataclass(frozen=True)
class Part:
    """The connected chip. size_known: False when its size is unreadable and the smallest for its device id is
    assumed."""

    device_id: int
    density: str
    page_bytes: int
    flash_kib: int
    size_known: bool
    bootloader: int


def import_stm32loader() -> ModuleType:
    try:
        from stm32loader import bootloader
    except ImportError:
        raise UsageError(f"stm32loader is not installed; install it {install_hint('flash')}") from None
    module: ModuleType = bootloader
    return module


def part_of(device_id: int, flash_kib: int | None, bootloader: int) -> Part:
    """The part with these numbers. flash_kib: as read from the chip, None when unreadable. Raises UsageError for a part
    that is not supported."""
    if device_id not in _DENSITIES:
        raise UsageError(
            f"the chip has device id 0x{device_id:03x}, which is no STM32F103 from the C8 up; nothing was written"
        )
    density, page_bytes, least_kib = _DENSITIES[device_id]
    known = flash_kib is not None and 16 <= flash_kib <= 1024
    return Part(device_id, density, page_bytes, flash_kib if known and flash_kib else least_kib, known, bootloader)


class Line:
    """Serial port with the interface that stm32loader expects: complete reads or SilenceError, optional reset lines."""

    def __init__(self, port: str, baud: int) -> None:
        import serial

        check_port(port)
        self.timeout = REPLY_S
        exclusive = True if os.name == "posix" else None
        opened = partial(
            serial.serial_for_url, port, baud, timeout=0.05, write_timeout=WRITE_TIMEOUT_S, exclusive=exclusive
        )
        self.has_parity = True
        try:
            try:
                self._port: Any = opened(parity=serial.PARITY_EVEN)  # Any: pyserial has a class a kind
            except (OSError, ValueError):
                raise
            except Exception:  # termios.error, which is no OSError: a pseudo-terminal knows no parity
                self._port = opened()
                self.has_parity = False
        except Exception as error:
            raise OpenError(open_advice(port, error)) from None

    def read(self, count: int = 1) -> bytes:
        end = time.monotonic() + self.timeout
        data = bytes(self._port.read(count))
        while len(data) < count:
            last = time.monotonic() >= end  # read once more: this process may have been suspended since the last read
            data += self._port.read(count - len(data))
            if last and len(data) < count:
                raise SilenceError(f"{len(data)} bytes of {count} came")
        return data

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def discard(self) -> None:
        """Discards the bytes that have arrived."""
        self._port.reset_input_buffer()

    def enable_reset(self, on: bool) -> None:
        # A pseudo-terminal and many adapters have no such lines; then somebody presses the button.
        with contextlib.suppress(OSError):
            self._port.dtr = on

    def enable_boot0(self, on: bool) -> None:
        with contextlib.suppress(OSError):
            self._port.rts = not on

    def reset(self, boot0: bool) -> None:
        """Reset the chip by DTR and RTS, if they are wired to RESET and BOOT0; else nothing happens."""
        self.enable_boot0(boot0)
        self.enable_reset(True)
        time.sleep(0.05)
        self.enable_reset(False)
        time.sleep(0.05)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


class RomLoader:
    """A bootloader. Every method raises LinkError when the chip refuses or does not answer after all attempts."""

    def __init__(self, line: Line) -> None:
        self._module = import_stm32loader()
        self._line, self._erasing = line, False
        self._boot: Any = self._module.Stm32Bootloader(line, device_family="F1", verbosity=0)  # Any: no types

    def answers(self) -> bool:
        """True when a bootloader answers: with ACK after a reset, with NACK when it was running already."""
        return any(self._knock() for _ in range(_TRIES))

    def synchronise(self, wait_s: float) -> None:
        """Sends 0x7F until the bootloader answers."""
        end = time.monotonic() + wait_s
        while not self._knock():
            if time.monotonic() >= end:
                raise LinkError(
                    "no bootloader answers: set BOOT0 to 1 and BOOT1 to 0, check that the adapter's TX goes to "
                    "PA10 and its RX to PA9, press RESET and try again"
                )

    def _knock(self) -> bool:
        self._line.timeout = SYNC_S
        try:
            self._line.discard()
            self._line.write(_SYNC)
            with contextlib.suppress(SilenceError):
                return self._line.read()[0] in (_ACK, _NACK)
            return False
        except OSError as error:
            raise self._broken(error) from None
        finally:
            self._line.timeout = REPLY_S

    def identify(self) -> Part:
        """Identify the chip. Raises UsageError when it is not supported."""
        version = self._persist("report its version", self._boot.get)
        device_id = self._persist("identify itself", self._boot.get_id)
        if device_id > MOST_DEVICE_ID:
            raise LinkError("no bootloader answers, only an echo: check the wires, and that the port is the board's")
        part_of(device_id, None, version)
        try:
            size = int.from_bytes(self.read(FLASH_SIZE_ADDRESS, 2), "little")
        except LinkError:
            # Read protection covers the whole flash; if the flash can be read, only the size register is unreadable.
            try:
                self.read(FLASH_BASE, 4)
            except LinkError:
                raise LinkError(
                    "the chip refuses to be read: lift its read protection with a probe or `stm32loader --unprotect`, "
                    "which erases all of it, and try again"
                ) from None
            return part_of(device_id, None, version)
        return part_of(device_id, size, version)

    def erase(self, page: int) -> None:
        """Erase one page. Not repeated after a time-out: the chip could take the next command for more page numbers."""
        self._erasing = True
        for attempt in range(_TRIES):
            try:
                # stm32loader announces the extended command on every page.
                with contextlib.redirect_stderr(io.StringIO()):
                    self._boot.erase_memory([page])
                return
            except self._module.CommandError:
                if attempt == _TRIES - 1:
                    raise LinkError(
                        f"the chip refused to erase page {page}: lift its write protection with a probe or "
                        "`stm32loader --unprotect` and try again"
                    ) from None
            except OSError as error:
                raise self._broken(error) from None
            finally:
                self._line.timeout = REPLY_S

    def write(self, address: int, data: bytes) -> None:
        """Write up to 256 bytes into erased flash. Repeated after an error only when the flash is still blank there."""
        for attempt in range(_TRIES):
            try:
                self._boot.write_memory(address, data)
                return
            except OSError as error:
                trouble = error
            self._settle(trouble)
            found = self.read(address, len(data))
            if found == data:
                return
            if attempt == _TRIES - 1 or found != b"\xff" * len(data):
                break
        if isinstance(trouble, self._module.CommandError):
            raise LinkError(
                f"the chip refused to be written at 0x{address:08x}: lift its write protection with a probe or "
                "`stm32flash -u` and try again"
            )
        raise self._broken(trouble)

    def read(self, address: int, count: int) -> bytes:
        """Read up to 256 bytes."""
        return bytes(self._persist(f"be read at 0x{address:08x}", partial(self._boot.read_memory, address, count)))

    def start(self, address: int) -> bool:
        """Start the image at `address`; False when the bootloader refuses, which does no harm."""
        try:
            self._boot.go(address)
        except OSError:
            return False
        self._line.reset(boot0=False)
        return True

    def _persist(self, what: str, action: Callable[[], Result]) -> Result:
        for _ in range(_TRIES):
            try:
                return action()
            except OSError as error:
                trouble = error
            self._settle(trouble)
        if isinstance(trouble, self._module.CommandError):
            raise LinkError(f"the chip refused to {what}: press RESET with BOOT0 at 1 and try again")
        raise self._broken(trouble)

    def _settle(self, trouble: OSError) -> None:
        """Bring the bootloader back to the start of a command: send 0x7F until it answers with NACK."""
        self._line.timeout = SYNC_S
        try:
            for _ in range(8):
                self._line.discard()
                self._line.write(_SYNC)
                with contextlib.suppress(SilenceError):
                    if self._line.read()[0] == _NACK:
                        return
        except OSError as error:
            raise self._broken(error) from None
        finally:
            self._line.timeout = REPLY_S
        raise self._broken(trouble)

    def _broken(self, error: OSError) -> LinkError:
        left = "what it holds now is incomplete" if self._erasing else "nothing was written"
        return LinkError(
            f"the chip stopped answering ({error}): check the wires, press RESET with BOOT0 at 1 and run the command "
            f"again; {left}"
        )


def ask_running_board(port: str) -> bool:
    """Ask a running plumb board at a serial port to enter its bootloader; False when no board answers.

    Firmware and host may be of different versions: the nonce and this verb are the same in all. Raises LinkError when
    the board refuses.
    """
    from plumb.link.session import Session

    try:
        session = Session.open(port)
    except OpenError:
        raise
    except LinkError:
        return False
    with session:
        try:
            session.execute("BOOTLOADER", matching=False)
        except NackError as error:
            if error.reason == "UNSUPPORTED" and (session.identity or session.connect())["PINS"] == BRIDGE_PINS:
                raise LinkError(
                    "the board that answers there has the bridge's pins, and its bootloader listens on two of the "
                    "gates: use --probe, or switch the motor's supply off, move the adapter to PA9 and PA10, and set "
                    "BOOT0 to 1"
                ) from None
            if error.reason == "UNSUPPORTED":
                return False
            raise LinkError(f"{error}: end the run, open the arm switch, and try again") from None
    time.sleep(LEAVES_S)
    return True


@dataclass(frozen=True)
class Flashed:
    """Result of flashing. wrong: offsets of bytes that read back differently; blank: all of those read as erased
    flash."""

    part: Part
    pages: Sequence[int]
    wrong: Sequence[int]
    blank: bool


def block_bytes(data: bytes) -> int:
    """Number of these bytes to send in one block, at most BLOCK_BYTES.

    A block is sent without acknowledgement in between: its length, the data, a checksum. If the length is lost, the
    bootloader takes the first byte of data for it, and the remaining bytes for commands. A block is made shorter when
    such commands would erase, write or start something.
    """
    for count in range(min(len(data), BLOCK_BYTES), 0, -4):
        block = data[:count]
        chip = RomBootloader(bytearray(b"\xff" * 0x10000), lambda _offset, _data: None)
        chip.receive(_SYNC + b"\x31\xce" + WRITE_TO)
        chip.receive(block + bytes([reduce(xor, block, count - 1)]) + 8 * _SYNC)
        if not chip.erased and not chip.written and chip.started_at is None:
            return count
    raise UsageError("the image holds bytes that a bootloader could take for a command; build another one")


def program(loader: RomLoader, part: Part, image: bytes, done: Callable[[str, int], None]) -> Flashed:
    """Erase the image's pages and no others, write, read back. done(step, bytes) is called to report progress."""
    if len(image) > part.flash_kib * 1024:
        raise UsageError(
            f"the image has {len(image)} bytes, the chip {part.flash_kib} KiB of flash; nothing was written"
        )
    pages = range((len(image) + part.page_bytes - 1) // part.page_bytes)
    for page in pages:
        loader.erase(page)
        done("erasing", min(part.page_bytes, len(image) - page * part.page_bytes))
    start = 0
    while start < len(image):
        block = image[start : start + block_bytes(image[start : start + BLOCK_BYTES])]
        loader.write(FLASH_BASE + start, block)
        done("writing", len(block))
        start += len(block)
    found = b""
    for start in range(0, len(image), BLOCK_BYTES):
        found += loader.read(FLASH_BASE + start, min(BLOCK_BYTES, len(image) - start))
        done("reading back", len(found) - start)
    wrong = [i for i, (is_, should_be) in enumerate(zip(found, image, strict=True)) if is_ != should_be]
    return Flashed(part, pages, wrong, found == b"\xff" * len(image))
