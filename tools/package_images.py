#!/usr/bin/env python3
"""Put the flash images into the package: those of host/plumb/spec/images.toml.

    tools/package_images.py                              host/plumb/images, from build/stm32f103 and build/images
    tools/package_images.py --release dist/firmware      also .bin, .elf and .hex of each, with SHA256SUMS
    tools/package_images.py --unchecked --images quad    without the golden check; those of all systems, and this

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
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tools")]

import build_images  # type: ignore[import-not-found]  # noqa: E402
from plumb.errors import PlumbError, UsageError, VerdictError  # noqa: E402
from plumb.flash.image import load_image, own_header  # noqa: E402
from plumb.flash.named_images import build_of  # noqa: E402
from plumb.flash.packaged_images import FORMAT, MANIFEST  # noqa: E402
from plumb.spec import images  # noqa: E402
from plumb.spec.images import Image  # noqa: E402

BUILD = ROOT / "build" / "images"
VECTORS = ROOT / "tests" / "vectors"
CHECKED = BUILD / "checked.json"
KINDS = (".bin", ".elf", ".hex")


def built(image: Image) -> Path:
    """firmware.bin of an image: `make image` built the one with every system, the others are built here."""
    path = ROOT / build_of(image.name)
    if image.name != images.ALL:
        build_images.build(image)
    elif not path.is_file():
        raise UsageError(f"there is no {path}; build it with: make image")
    return path


def golden_check(image: Path, systems: tuple[str, ...]) -> dict[str, int]:
    """Vectors and steps that the image passed on the virtual board; raises VerdictError when one differs."""
    from plumb.boards import open_board
    from plumb.proof import golden

    with open_board("virtual", image=image) as board:
        result = golden.check(board, VECTORS, chosen=golden.cases(VECTORS, systems))
    if result.verdict != "pass":
        raise VerdictError(f"{image}: {result.describe()}; it does not become part of the package")
    return {"vectors": result.vectors, "steps": result.steps}


def golden_checks(paths: dict[str, Path]) -> dict[str, dict[str, int]]:
    """golden_check of every image that was not checked before, on all cores."""
    manifest = (VECTORS / "manifest.json").read_bytes()
    keys = {name: hashlib.sha256(path.read_bytes() + manifest).hexdigest() for name, path in paths.items()}
    checked = json.loads(CHECKED.read_text(encoding="ascii")) if CHECKED.is_file() else {}
    left = [name for name, key in keys.items() if key not in checked]
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        systems = [images.image(name).systems for name in left]
        results = pool.map(golden_check, [paths[name] for name in left], systems)
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
    paths = {name: built(images.image(name)) for name in names}
    golden = {} if unchecked else golden_checks(paths)
    for name, path in paths.items():
        data = load_image(path)
        header = own_header(data, str(path))
        stem = "plumb" if name == images.ALL else f"plumb-{name}"
        (staged / f"{stem}.bin").write_bytes(data)
        if release:
            for kind in KINDS:
                shutil.copy(path.with_suffix(kind), release / (stem + kind))
        rows.append(
            {
                "name": name,
                "file": f"{stem}.bin",
                "sha256": hashlib.sha256(data).hexdigest(),
                "bytes": len(data),
                "git_hash": header.git_hash,
                "git_dirty": header.git_dirty,
                "systems": list(images.image(name).systems),
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
    parser.add_argument("--images", nargs="*", metavar="NAME", help="these images, in addition to those of all systems")
    parser.add_argument("--unchecked", action="store_true", help="skip the golden check; the manifest says so")
    options = parser.parse_args()
    try:
        chosen = images.images() if options.images is None else options.images
        names = dict.fromkeys([images.ALL, *images.left_out_of_all(), *chosen])
        for row in package(list(names), options.out, options.release, options.unchecked):
            passed = row["golden"]
            proof = f"{passed['vectors']} golden vectors" if isinstance(passed, dict) else "not checked"
            print(f"{row['file']}: {row['bytes']} bytes, {proof}")
    except PlumbError as error:
        print(f"package_images: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
