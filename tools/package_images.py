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
import multiprocessing
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
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
                 f"-DPython3_EXECUTABLE={sys.executable}", "-DCMAKE_BUILD_TYPE=Image", f"-DPLUMB_SYSTEMS={name}",
                 ]  # fmt: skip
    for command in (configure, ["cmake", "--build", str(folder), "--target", "firmware"]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise UsageError(f"the image of {name} does not build:\n{done.stdout}{done.stderr}")
    return folder / "firmware.bin"


def systems_of(name: str) -> list[str]:
    return list(declarations.names()) if name == ALL_SYSTEMS else [name]


def golden_check(image: Path, systems: list[str]) -> dict[str, int]:
    """Vectors and steps that the image passed on the virtual board; raises VerdictError when one differs."""
    from plumb.boards import open_board
    from plumb.proof import golden

    with open_board("virtual", image=image) as board:
        result = golden.check(board, VECTORS, chosen=golden.cases(VECTORS, systems))
    if result.verdict != "pass":
        raise VerdictError(f"{image}: {result.describe()}; it does not become part of the package")
    return {"vectors": result.vectors, "steps": result.steps}


def golden_checks(images: dict[str, Path]) -> dict[str, dict[str, int]]:
    """golden_check of every image that was not checked before, on all cores."""
    manifest = (VECTORS / "manifest.json").read_bytes()
    keys = {name: hashlib.sha256(image.read_bytes() + manifest).hexdigest() for name, image in images.items()}
    checked = json.loads(CHECKED.read_text(encoding="ascii")) if CHECKED.is_file() else {}
    left = [name for name, key in keys.items() if key not in checked]
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        results = pool.map(golden_check, [images[name] for name in left], [systems_of(name) for name in left])
        checked |= {keys[name]: result for name, result in zip(left, results, strict=True)}
    CHECKED.parent.mkdir(parents=True, exist_ok=True)
    CHECKED.write_text(json.dumps(checked, indent=1) + "\n", encoding="ascii")
    return {name: checked[key] for name, key in keys.items()}


def package(names: list[str], folder: Path, release: Path | None, unchecked: bool) -> list[dict[str, object]]:
    """Writes the images and their manifest into `folder`; returns the manifest's rows."""
    staged = folder.with_name(folder.name + ".part")
    for stale in (staged, *([release] if release else [])):
        shutil.rmtree(stale, ignore_errors=True)
        stale.mkdir(parents=True)
    rows: list[dict[str, object]] = []
    images = {name: built(name) for name in names}
    golden = {} if unchecked else golden_checks(images)
    for name, image in images.items():
        data = load_image(image)
        header = own_header(data, str(image))
        stem = "plumb" if name == ALL_SYSTEMS else f"plumb-{name}"
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
                "systems": systems_of(name),
                "golden": golden.get(name),
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
            passed = row["golden"]
            proof = f"{passed['vectors']} golden vectors" if isinstance(passed, dict) else "not checked"
            print(f"{row['file']}: {row['bytes']} bytes, {proof}")
    except PlumbError as error:
        print(f"package_images: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
