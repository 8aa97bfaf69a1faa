#!/usr/bin/env python3
"""Build and check flash images by name: each system alone, the sets, and all systems (host/plumb/spec/images.toml).

    tools/build_images.py                  every image
    tools/build_images.py quad vehicles    these
    tools/build_images.py --left-out       those of the systems that `all` leaves out, and their programs for QEMU

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
QEMU = ("plumb_qemu", *(f"plumb_qemu_{core}" for core in ("m0", "m4", "m7")))
"""Targets of the core as programs for QEMU."""
QEMU_FOLDER = Path("build") / "qemu"
"""Where they are built with every system, when `all` leaves one out."""
HEAD = f"{'image':<12} {'flash':>6} {'of':>6} {'free':>6} {'RAM':>6} {'of':>6} {'free':>6}  systems"


def build(image: Image) -> Path:
    """firmware.bin of an image; raises VerdictError with what the build said when there is none."""
    target = ROOT / build_of(image.name)
    asked = "" if image.name == images.ALL else image.name
    _make(f"image {image.name}", target.parent, [f"-DPLUMB_SYSTEMS={asked}"], ["firmware"])
    return target


def _make(what: str, folder: Path, options: list[str], targets: list[str]) -> None:
    configure = ["cmake", "-S", str(ROOT), "-B", str(folder), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Image",
                 f"-DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN}", f"-DPython3_EXECUTABLE={sys.executable}", *options]  # fmt: skip
    for command in (configure, ["cmake", "--build", str(folder), "--target", *targets]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("check_elf: ")]
            why = "\n".join(said) or done.stdout + done.stderr
            raise VerdictError(f"{what} is not built:\n{why}")


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


def build_left_out() -> None:
    """What stands for `all` where it leaves a system out; raises VerdictError when there is none."""
    left_out = images.left_out_of_all()
    for image in left_out.values():
        build(image)
    if left_out:
        _make("the core for QEMU", ROOT / QEMU_FOLDER, ["-DPLUMB_WHOLE=ON"], [*QEMU])


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
    parser.add_argument("--left-out", action="store_true", help="of the systems that `all` leaves out, with QEMU's")
    options = parser.parse_args()
    try:
        if options.left_out:
            build_left_out()
            return 0
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
