"""Diagnose why no board answers on a serial port: another program has it open, the baud rate differs, the ROM
bootloader listens, or nothing is connected.

The port is opened and written to, so use this only for a port that the user named.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from plumb.errors import PlumbError, UsageError
from plumb.flash.rom_loader import Line, Part, RomLoader
from plumb.link.endpoint_names import DEFAULT_BAUD, SerialName
from plumb.link.findings import Finding
from plumb.link.transports.byte_stream import OpenError, open_stream

BAUDS = (DEFAULT_BAUD, 115200, 230400, 460800, 1000000, 2000000)
"""Rates at which a board is looked for."""
LISTEN_S = 0.15
ST_BOOTLOADERS = range(0x20, 0x23)
"""Versions of the bootloader in ST's STM32F103 (AN2606: 2.0 to 2.2)."""
SILENT = (
    "nothing comes: set BOOT0 to 0 and press RESET, then swap RX and TX, check GND, the board's power, and that the "
    "adapter has 3.3 V levels; PB5 at ground moves the UART to PB6 and PB7"
)


def answers_at(port: str, baud: int) -> bytes:
    """The bytes that come back when the SLCAN command for the version is sent at this rate. Raises LinkError."""
    stream = open_stream(SerialName(port, baud), baud)
    try:
        stream.write(b"\rC\rV\r")
        data, end_s = b"", time.monotonic() + LISTEN_S
        while (left_s := end_s - time.monotonic()) > 0 and b"V" not in data:
            data += stream.read(left_s)
        return data
    finally:
        stream.close()


def bootloader_at(port: str) -> Part | None:
    """The chip whose ROM bootloader listens there; None when there is none, or without the extra `flash`. Nothing is
    written to its flash. Raises LinkError for a port that does not open."""
    line = Line(port, 115200)
    try:
        try:
            loader = RomLoader(line)
        except UsageError:
            return None
        return loader.identify() if loader.answers() else None
    finally:
        line.close()


def clone(part: Part) -> Finding | None:
    """A finding when the bootloader, and so the chip, is not one of ST's; else None."""
    if part.bootloader in ST_BOOTLOADERS:
        return None
    version = f"{part.bootloader >> 4}.{part.bootloader & 15}"
    detail = (
        f"the bootloader is version {version}, and those of ST's STM32F103 are 2.0 to 2.2: its oscillators, converters "
        "and flash are not those of ST's data sheet"
    )
    return Finding("clone", False, False, detail, "use it for trials; for flights take a board with ST's chip")


def _in_bootloader(port: str, part: Part) -> Iterator[Finding]:
    detail = f"the chip's own bootloader answers ({part.density}), not plumb: BOOT0 is at 1"
    mend = f"plumb flash --port {port}, then set BOOT0 to 0 and press RESET"
    yield Finding("BOOT0", False, True, detail, mend)
    found = clone(part)
    if found is not None:
        yield found


def diagnose(name: SerialName) -> Iterator[Finding]:
    """The reasons why no board answers on this port, the most likely first.

    The bootloader is asked first: it takes the baud rate from the first bytes that it receives.
    """
    try:
        part = None if "://" in name.port else bootloader_at(name.port)
        if part is not None:
            yield from _in_bootloader(name.port, part)
            return
        replies = {baud: answers_at(name.port, baud) for baud in dict.fromkeys((name.baud, *BAUDS))}
    except OpenError as error:
        yield Finding(name.port, False, True, str(error))
        return
    except PlumbError as error:
        yield Finding(name.port, False, True, str(error), "unplug the adapter, and plug it in again")
        return
    right = [baud for baud, data in replies.items() if b"V" in data and b"\r" in data]
    if right and right[0] != name.baud:
        at = "" if right[0] == DEFAULT_BAUD else f"@{right[0]}"
        detail = f"a board answers at {right[0]} baud, not at {name.baud}"
        yield Finding("baud", False, True, detail, f"--board serial:{name.port}{at}")
        return
    if any(replies.values()):
        detail = "bytes come, but no answer of a board: another device, or another program on the chip"
        yield Finding(name.port, False, True, detail, f"plumb flash --port {name.port}")
        return
    yield Finding(name.port, False, True, SILENT)
