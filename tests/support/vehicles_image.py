"""The flash image `vehicles`, built when a test needs it: `make image` builds `all` and those that it leaves out."""

from __future__ import annotations

import subprocess
import sys
from functools import lru_cache
from pathlib import Path

from filelock import FileLock

from plumb.flash.image import find_image

ROOT = Path(__file__).parents[2]
NAME = "vehicles"


@lru_cache
def vehicles_image() -> Path:
    """Its firmware.bin, as of the sources of now; the workers of a run build one after the other."""
    lock = ROOT / "build/images" / f"{NAME}.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(lock):
        done = subprocess.run(
            [sys.executable, "tools/build_images.py", NAME], cwd=ROOT, capture_output=True, text=True, check=False
        )
    assert done.returncode == 0, done.stdout + done.stderr
    return find_image(Path(NAME))
