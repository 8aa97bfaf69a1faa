#!/usr/bin/env python3
"""Build and check flash images by name: each system alone, the sets, and all systems (host/plumb/spec/images.toml).

    tools/build_images.py                  every image
    tools/build_images.py quad vehicles    these

The build holds each image to its budget and to the promises of tools/check_elf.py. Then the image boots on the virtual
board and says which systems it holds. `all` is built in build/stm32f103, as by `make image`, the others in
build/images/NAME. The table shows bytes used and free.

Exit code 0: every image is built and as it should be. 1: one is not; the others are built. 2: a name is wrong, or a
tool is missing.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.errors import PlumbError, UsageError, VerdictError  # noqa: E402
from plumb.flash.elf import Elf  # noqa: E402
from plumb.flash.named_images import build_of  # noqa: E402
from plumb.spec import images  # noqa: E402
from plumb.spec.images import Image  # noqa: E402

TOOLCHAIN = ROOT / "firmware" / "ports" / "stm32f103" / "toolchain.cmake"
COMPILER = "arm-none-eabi-gcc"
HEAD = f"{'image':<12} {'flash':>6} {'of':>6} {'free':>6} {'RAM':>6} {'of':>6} {'free':>6}  systems"


def build(image: Image) -> Path:
    """firmware.bin of an image; raises VerdictError with what the build said when there is none."""
    target = ROOT / build_of(image.name)
    asked = "" if image.name == images.ALL else image.name
    configure = ["cmake", "-S", str(ROOT), "-B", str(target.parent), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Image",
                 f"-DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN}", f"-DPython3_EXECUTABLE={sys.executable}",
                 f"-DPLUMB_SYSTEMS={asked}"]  # fmt: skip
    for command in (configure, ["cmake", "--build", str(target.parent), "--target", "firmware"]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("check_elf: ")]
            why = "\n".join(said) or done.stdout + done.stderr
            raise VerdictError(f"image {image.name} is not built:\n{why}")
    return target


def check_systems(image: Image, path: Path) -> None:
    """Boot the image on the virtual board; raises VerdictError unless it says that it holds exactly its systems."""
    from plumb.boards.virtual import VirtualBoard

    with VirtualBoard(path) as board:
        held = board.session.require_match().systems
    if held != image.systems:
        raise VerdictError(f"image {image.name} says that it holds {', '.join(held)}, not {', '.join(image.systems)}")


def row(image: Image, path: Path) -> str:
    """The line of an image: what it takes, what it may take, and what is free; RAM with the reserved stack."""
    elf = Elf(path.with_suffix(".elf"))
    flash, ram = elf.flash_bytes, elf.ram_bytes + elf.reserved_stack_bytes
    limits = elf.limits
    used = [flash, limits["flash"], limits["flash"] - flash, ram, limits["ram"], limits["ram"] - ram]
    return f"{image.name:<12} {' '.join(f'{number:>6}' for number in used)}  {', '.join(image.systems)}"


def rows(chosen: list[Image]) -> Iterator[str]:
    """Build and check one image after the other; raises VerdictError at the end when one failed."""
    failed = []
    for image in chosen:
        try:
            path = build(image)
            check_systems(image, path)
            yield row(image, path)
        except VerdictError as error:
            failed.append(str(error))
    if failed:
        raise VerdictError("\n".join(failed))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="images to build; all of them without a name")
    options = parser.parse_args()
    try:
        if shutil.which(COMPILER) is None:
            raise UsageError(f"{COMPILER} is not installed; install gcc-arm-none-eabi")
        chosen = [images.image(name) for name in options.names or images.images()]
        print(HEAD)
        for line in rows(chosen):
            print(line, flush=True)
    except PlumbError as error:
        print(f"build_images: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
