"""Builds of the sources for a test: a native core and a flash image of some systems, and `plumb` with them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

LIMIT_S = 300


@dataclass(frozen=True)
class Plumb:
    """`plumb` with a native core and an image. environment: added to that of this process."""

    python: Path
    core: Path
    image: Path
    environment: Mapping[str, str]

    def __call__(self, *words: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        image = ["--image", str(self.image)] if "virtual" in words else []
        return self.run(self.python, "-m", "plumb", *words, *image, code=code)

    def run(self, *program: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
        """Any program in the same environment."""
        environment = {**os.environ, "PLUMB_NATIVE_CORE": str(self.core), **self.environment}
        done = subprocess.run(program, env=environment, capture_output=True, text=True, timeout=LIMIT_S)
        assert done.returncode == code, done.stdout + done.stderr
        return done


def build(
    source: Path, target: Path, python: Path, *options: str, image: str = "", core: bool = True
) -> tuple[Path, Path]:
    """The native core and the flash image of the sources, nothing else: the cores for QEMU and the C library would
    double the time. The core without optimisation, which builds twice as fast. image: the systems of the image, where
    they are fewer than those of the core. core: False for the image alone."""
    chip = f"-DCMAKE_TOOLCHAIN_FILE={source}/firmware/ports/stm32f103/toolchain.cmake"
    for name, wanted, own in (
        ("native", "python_libraries", ["-DPLUMB_TESTS=OFF", "-DCMAKE_BUILD_TYPE=Debug"]),
        ("image", "firmware", [chip, "-DCMAKE_BUILD_TYPE=Image", *([f"-DPLUMB_SYSTEMS={image}"] if image else [])]),
    ):
        if name == "native" and not core:
            continue
        configure: list[str | Path] = [
            "cmake",
            "-S",
            source,
            "-B",
            target / name,
            "-G",
            "Ninja",
            f"-DPython3_EXECUTABLE={python}",
        ]
        finish: list[str | Path] = ["cmake", "--build", target / name, "--target", wanted]
        commands = [[*configure, *own, *options], finish]
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
            assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return target / "native" / "libplumb_native.so", target / "image" / "firmware.elf"
