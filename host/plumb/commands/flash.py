"""Write the flash image to an STM32F103 through its ROM bootloader: a USB-serial adapter is all it takes.

    plumb flash --port /dev/ttyUSB0

The bootloader listens on PA9 (TX) and PA10 (RX) after a reset with BOOT0 at 1. Only the pages of the image are erased,
so parameters survive, and all of it is read back. Exit code 1 when the chip does not hold what was written.
Adapters that wire DTR to RESET and RTS to BOOT0 need no hand on the board.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plumb.romloader import Flashed, Part, RomLoader

STEPS = """\
  1. wire the adapter: TX to PA10, RX to PA9, GND to GND (3.3 V levels)
  2. set BOOT0 to 1 (BOOT1 stays 0) and press RESET
waiting for the bootloader ..."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", required=True, help="serial port of the adapter; `plumb ports` lists them")
    parser.add_argument("--baud", type=int, default=115200, help="1200 to 115200 (default 115200)")
    parser.add_argument("--image", type=Path, help="flash image, .bin, .hex or .elf (default: the checkout's build)")
    parser.add_argument("--wait", type=float, default=15.0, metavar="S", help="for the bootloader (default 15 s)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def main(arguments: argparse.Namespace) -> int:
    from plumb import romloader
    from plumb.errors import UsageError, VerdictError
    from plumb.f103.image import FLASH_BASE, find_image, load_image, own_header

    if not 1200 <= arguments.baud <= 115200:
        raise UsageError(f"the bootloader does not do {arguments.baud} baud; use 1200 to 115200")
    path = find_image(arguments.image)
    image = load_image(path)
    header = own_header(image, str(path))
    romloader.import_stm32loader()
    commit = (header.git_hash or "of no known commit") + ("+" if header.git_dirty else "")
    print(f"{path}: {len(image)} bytes, {commit}\n{STEPS}", file=sys.stderr, flush=True)

    line = romloader.Line(arguments.port, arguments.baud)
    if not line.has_parity:
        print(f"{arguments.port} does no even parity, which every real bootloader wants; going on", file=sys.stderr)
    try:
        line.reset(boot0=True)
        loader = romloader.RomLoader(line)
        loader.synchronise(arguments.wait)
        part = loader.identify()
        size = f"{part.flash_kib} KiB" if part.size_known else f"at least {part.flash_kib} KiB (it does not say)"
        print(f"chip 0x{part.device_id:03x}, {part.density}, flash {size}, pages of {part.page_bytes}", file=sys.stderr)
        flashed = flash_with_progress(loader, part, image)
        started = not flashed.wrong and loader.start(FLASH_BASE)
    finally:
        line.close()

    if arguments.json:
        report = {
            "verdict": "fail" if flashed.wrong else "pass",
            "image": str(path),
            "bytes": len(image),
            "git_hash": header.git_hash,
            "git_dirty": header.git_dirty,
            "port": arguments.port,
            "part": asdict(part),
            "pages_erased": len(flashed.pages),
            "wrong_bytes": len(flashed.wrong),
            "first_wrong_address": FLASH_BASE + flashed.wrong[0] if flashed.wrong else None,
            "started": started,
        }
        print(json.dumps(report))
    if flashed.wrong:
        raise VerdictError(complaint(flashed, image))
    if not arguments.json:
        then = "it runs" if started else "press RESET to start it"
        print(f"written and read back: {len(image)} bytes in {len(flashed.pages)} pages; set BOOT0 back to 0, {then}")
    return 0


def flash_with_progress(loader: RomLoader, part: Part, image: bytes) -> Flashed:
    """Programs the chip; a bar over erasing, writing and reading back when on a terminal."""
    from tqdm import tqdm

    from plumb.romloader import program

    with tqdm(total=3 * len(image), unit="B", unit_scale=True, leave=False, disable=None) as bar:

        def done(step: str, amount: int) -> None:
            bar.set_description(step, refresh=False)
            bar.update(amount)

        return program(loader, part, image, done)


def complaint(flashed: Flashed, image: bytes) -> str:
    """One sentence about what read back wrong."""
    from plumb.f103.image import FLASH_BASE

    if flashed.blank:
        return (
            "the chip acknowledged every write and holds nothing: some clones do that, and so does a worn-out chip; "
            "use another board"
        )
    return (
        f"{len(flashed.wrong)} of {len(image)} bytes read back wrong, the first at "
        f"0x{FLASH_BASE + flashed.wrong[0]:08x}: press RESET with BOOT0 at 1 and run the command again; "
        "use another board if it stays wrong"
    )
