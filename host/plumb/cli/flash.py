"""Write the flash image to an STM32F103, over its UART or over a debug probe.

    plumb flash --port /dev/ttyUSB0
    plumb flash --probe openocd
    plumb flash --probe pyocd

Over the UART a USB-serial adapter is enough: the ROM bootloader listens on PA9 (TX) and PA10 (RX) after a reset with
BOOT0 at 1. With an adapter that wires DTR to RESET and RTS to BOOT0, no jumper has to be set; nor on a board that runs
plumb, is disarmed and idle, and has these pins as its UART: it enters the bootloader on request. Only the pages of the
image are erased, so that the parameters survive, and the whole image is read back. Exit code 1 when the chip does not
hold the image.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number
from plumb.errors import counted

if TYPE_CHECKING:
    from plumb.flash.image import ImageHeader
    from plumb.flash.rom_loader import Flashed, Line, Part, RomLoader

STEPS = """\
  1. wire the adapter: TX to PA10, RX to PA9, GND to GND (3.3 V levels)
  2. set BOOT0 to 1 (BOOT1 stays 0) and press RESET
waiting for the bootloader ..."""
CLONE = (
    "plumb: warning: the debug port says 0x2ba01477, and ST's says 0x1ba01477: the chip is a clone; what its "
    "oscillators, converters and flash are good for is not in ST's data sheet"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    way = parser.add_mutually_exclusive_group()
    way.add_argument(
        "--port", help="serial port of the adapter, or auto for the only one (default: the setting `port`)"
    )
    way.add_argument(
        "--probe", metavar="openocd[:INTERFACE]|pyocd", help="debug probe, named by the tool that drives it"
    )
    parser.add_argument("--baud", type=whole_number, default=115200, help="1200 to 115200 (default 115200)")
    options.add_image(parser, "flash image, .bin, .hex or .elf")
    parser.add_argument(
        "--wait", type=float, default=15.0, metavar="S", help="longest wait for the bootloader (default 15 s)"
    )
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError, VerdictError
    from plumb.flash.image import find_image, load_image, own_header

    if not 1200 <= arguments.baud <= 115200:
        raise UsageError(f"the bootloader does not support {arguments.baud} baud; use 1200 to 115200")
    if not arguments.probe:
        arguments.port = options.port_of(arguments)
    path = find_image(arguments.image)
    image = load_image(path)
    header = own_header(image, str(path))
    commit = (header.git_hash or "of no known commit") + ("+" if header.git_dirty else "")
    announcement = f"{path}: {len(image)} bytes, {commit}"
    if arguments.probe:
        flashed, how = over_probe(arguments.probe, image, announcement)
    else:
        flashed, how = over_uart(arguments, image, announcement)
    if arguments.json:
        print(json.dumps(report(path, image, header, flashed, how)))
    if flashed.wrong:
        raise VerdictError(complaint(flashed, image))
    if not arguments.json:
        then = "it runs" if how["started"] else "press RESET to start it"
        jumper = "" if arguments.probe or how["asked"] else "set BOOT0 back to 0, "
        print(
            f"written and read back: {counted(len(image), 'byte')} in {counted(len(flashed.pages), 'page')}; "
            f"{jumper}{then}"
        )
    return 0


def report(
    path: Path, image: bytes, header: ImageHeader, flashed: Flashed, how: dict[str, object]
) -> dict[str, object]:
    from plumb.flash.image import FLASH_BASE

    return {
        "verdict": "fail" if flashed.wrong else "pass",
        "image": str(path),
        "bytes": len(image),
        "git_hash": header.git_hash,
        "git_dirty": header.git_dirty,
        **how,
        "part": asdict(flashed.part),
        "pages_erased": len(flashed.pages),
        "wrong_bytes": len(flashed.wrong),
        "first_wrong_address": FLASH_BASE + flashed.wrong[0] if flashed.wrong else None,
    }


def over_probe(spec: str, image: bytes, announcement: str) -> tuple[Flashed, dict[str, object]]:
    """Through the tool that drives the probe; returns what was done and how."""
    from plumb.flash import debug_probe

    tool = debug_probe.open_probe(spec)
    print(announcement, file=sys.stderr, flush=True)
    chip = tool.identify()
    print(described(chip.part), file=sys.stderr)
    if chip.clone:
        print(CLONE, file=sys.stderr)
    flashed = debug_probe.program(tool, chip.part, image)
    if not flashed.wrong:
        tool.start()
    how: dict[str, object] = {
        "probe": spec,
        "idcode": chip.idcode,
        "clone": chip.clone,
        "started": not flashed.wrong,
        "asked": False,
    }
    return flashed, how


def over_uart(arguments: argparse.Namespace, image: bytes, announcement: str) -> tuple[Flashed, dict[str, object]]:
    """Through the ROM bootloader; returns what was done and how."""
    from plumb.flash import rom_loader
    from plumb.flash.image import FLASH_BASE

    rom_loader.import_stm32loader()
    print(announcement, file=sys.stderr, flush=True)
    line = rom_loader.Line(arguments.port, arguments.baud)
    if not line.has_parity:
        print(f"{arguments.port} has no even parity, which the chip's bootloader needs; continuing", file=sys.stderr)
    try:
        line.reset(boot0=True)
        asked, loader = False, rom_loader.RomLoader(line)
        if not loader.answers():
            line, asked = ask_the_board(line, arguments)
            if not asked:
                print(STEPS, file=sys.stderr, flush=True)
            loader = rom_loader.RomLoader(line)
            loader.synchronise(arguments.wait)
        part = loader.identify()
        print(described(part), file=sys.stderr)
        flashed = flash_with_progress(loader, part, image)
        started = not flashed.wrong and loader.start(FLASH_BASE)
    finally:
        line.close()
    return flashed, {"port": arguments.port, "started": started, "asked": asked}


def ask_the_board(line: Line, arguments: argparse.Namespace) -> tuple[Line, bool]:
    """If a plumb board answers, let it enter its bootloader. Returns the port, reopened, and whether the board did."""
    from plumb.flash import rom_loader

    line.close()
    asked = rom_loader.ask_running_board(arguments.port)
    if asked:
        print("the board enters its bootloader by itself", file=sys.stderr, flush=True)
    return rom_loader.Line(arguments.port, arguments.baud), asked


def described(part: Part) -> str:
    size = f"{part.flash_kib} KiB" if part.size_known else f"at least {part.flash_kib} KiB (it does not say)"
    return f"chip 0x{part.device_id:03x}, {part.density}, flash {size}, pages of {part.page_bytes}"


def flash_with_progress(loader: RomLoader, part: Part, image: bytes) -> Flashed:
    """Programs the chip; a bar over erasing, writing and reading back when on a terminal."""
    from tqdm import tqdm

    from plumb.flash.rom_loader import program

    with tqdm(total=3 * len(image), unit="B", unit_scale=True, leave=False, disable=None) as bar:

        def done(step: str, amount: int) -> None:
            bar.set_description(step, refresh=False)
            bar.update(amount)

        return program(loader, part, image, done)


def complaint(flashed: Flashed, image: bytes) -> str:
    """Error sentence about the bytes that were read back wrong."""
    from plumb.flash.image import FLASH_BASE

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
