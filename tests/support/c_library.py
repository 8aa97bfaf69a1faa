"""The C library as a stranger gets it: configured, built and installed by CMake."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HEADERS = ROOT / "firmware" / "include" / "plumb"
ARCHIVE = ROOT / "build" / "native" / "libplumb.a"
EXAMPLES = ROOT / "examples" / "c"
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")


def run(*command: str | Path, cwd: Path = ROOT) -> str:
    """Standard output of a command; what it said on both outputs where it fails."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def build(source: Path, folder: Path, *options: str) -> str:
    """Configure and build; the output of the build."""
    run("cmake", "-S", source, "-B", folder, *options)
    return run("cmake", "--build", folder)
