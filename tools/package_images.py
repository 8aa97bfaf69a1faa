#!/usr/bin/env python3
"""Put the flash images into the package: one with every system, and one for each system alone.

    tools/package_images.py                              host/plumb/images, from build/stm32f103 and build/images
    tools/package_images.py --release dist/firmware      also .bin, .elf and .hex of each, with SHA256SUMS
    tools/package_images.py --unchecked --systems quad   without the golden check, and only one system's image

Each image first runs the golden vectors of its systems on the virtual board; the tool stops at a difference. Passed
images are recorded by the SHA-256 of image and vectors in build/images/checked.json and are not checked again. Format
of images.json: plumb/flash/packaged_images.py.

Exit code 0: done. 1: an image differs from its golden vectors. 2: an image cannot be built or read.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.errors import PlumbError, UsageError, VerdictError  # noqa: E402
from plumb.flash.image import load_image, own_header  # noqa: E402
from plumb.flash.packaged_images import ALL_SYSTEMS, FORMAT, MANIFEST  # noqa: E402
from plumb.spec import declarations  # noqa: E402

BUILD = ROOT / "build" / "images"
FULL = ROOT / "build" / "stm32f103"
VECTORS = ROOT / "tests" / "vectors"
CHECKED = BUILD / "checked.json"
TOOLCHAIN = ROOT / "firmware" / "ports" / "stm32f103" / "toolchain.cmake"
KINDS = (".bin", ".elf", ".hex")


def built(name: str) -> Path:
    """firmware.bin of an image: `make image` built the one with every system, the others are built here."""
    if name == ALL_SYSTEMS:
        if not (FULL / "firmware.bin").is_file():
            raise UsageError(f"there is no {FULL / 'firmware.bin'}; build it with: make image")
        return FULL / "firmware.bin"
    folder = BUILD / name
    configure = ["cmake", "-S", str(ROOT), "-B", str(folder), "-G", "Ninja", f"-DCMAKE_TOOLCHAIN_FILE={TOOLCHAIN}",
                 "-DCMAKE_BUILD_TYPE=Image", f"-DPLUMB_SYSTEMS={name}"]  # fmt: skip
    for command in (configure, ["cmake", "--build", str(folder), "--target", "firmware"]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise UsageError(f"the image of {name} does not build:\n{done.stdout}{done.stderr}")
    return folder / "firmware.bin"


def golden_check(image: Path, systems: list[str]) -> dict[str, int]:
    """Vectors and steps that the image passed on the virtual board; raises VerdictError when one differs."""
    manifest = (VECTORS / "manifest.json").read_bytes()
    key = hashlib.sha256(image.read_bytes() + manifest).hexdigest()
    checked = json.loads(CHECKED.read_text(encoding="ascii")) if CHECKED.is_file() else {}
    if key not in checked:
        from plumb.boards import open_board
        from plumb.proof import golden

        with open_board("virtual", image=image) as board:
            result = golden.check(board, VECTORS, chosen=golden.cases(VECTORS, systems))
        if result.verdict != "pass":
            raise VerdictError(f"{image}: {result.describe()}; it does not become part of the package")
        checked[key] = {"vectors": result.vectors, "steps": result.steps}
        CHECKED.parent.mkdir(parents=True, exist_ok=True)
        CHECKED.write_text(json.dumps(checked, indent=1) + "\n", encoding="ascii")
    found: dict[str, int] = checked[key]
    return found


def package(names: list[str], folder: Path, release: Path | None, unchecked: bool) -> list[dict[str, object]]:
    """Writes the images and their manifest into `folder`; returns the manifest's rows."""
    every = declarations.names()
    staged = folder.with_name(folder.name + ".part")
    for stale in (staged, *([release] if release else [])):
        shutil.rmtree(stale, ignore_errors=True)
        stale.mkdir(parents=True)
    rows: list[dict[str, object]] = []
    for name in names:
        image = built(name)
        systems = list(every) if name == ALL_SYSTEMS else [name]
        data = load_image(image)
        header = own_header(data, str(image))
        stem = "plumb" if name == ALL_SYSTEMS else f"plumb-{name}"
        golden = None if unchecked else golden_check(image, systems)
        (staged / f"{stem}.bin").write_bytes(data)
        if release:
            for kind in KINDS:
                shutil.copy(image.with_suffix(kind), release / (stem + kind))
        rows.append(
            {
                "name": name,
                "file": f"{stem}.bin",
                "sha256": hashlib.sha256(data).hexdigest(),
                "bytes": len(data),
                "git_hash": header.git_hash,
                "git_dirty": header.git_dirty,
                "systems": systems,
                "golden": golden,
            }
        )
    lines = ",\n".join("  " + json.dumps(row) for row in rows)
    (staged / MANIFEST).write_text(f'{{"format": "{FORMAT}", "images": [\n{lines}\n]}}\n', encoding="ascii")
    shutil.rmtree(folder, ignore_errors=True)
    staged.rename(folder)
    if release:
        sums = (f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(release.iterdir()))
        (release / "SHA256SUMS").write_text("".join(sums), encoding="ascii")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "host" / "plumb" / "images", help="folder to write")
    parser.add_argument("--release", type=Path, metavar="DIR", help="also write .bin, .elf, .hex and SHA256SUMS there")
    parser.add_argument("--systems", nargs="*", help="images of these systems alone, besides the one with all of them")
    parser.add_argument("--unchecked", action="store_true", help="skip the golden check; the manifest says so")
    options = parser.parse_args()
    try:
        alone = list(declarations.names()) if options.systems is None else options.systems
        for row in package([ALL_SYSTEMS, *alone], options.out, options.release, options.unchecked):
            golden = row["golden"]
            proof = f"{golden['vectors']} golden vectors" if isinstance(golden, dict) else "not checked"
            print(f"{row['file']}: {row['bytes']} bytes, {proof}")
    except PlumbError as error:
        print(f"package_images: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
