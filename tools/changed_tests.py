"""Print the tests of a change: those of its floor of host/plumb and of every floor above it.

usage: .venv/bin/python tools/changed_tests.py [COMMIT]     what differs from COMMIT (default: HEAD), new files included

A change of firmware/ runs from the kernels upwards; one of another folder (tools, docs, examples, the build) runs the
tests outside the floors. A changed test runs with the rest of its folder.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from gen_floors import floors  # type: ignore[import-not-found]

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests"
FIRMWARE_FLOOR = "kernels"


def lines(*command: str) -> list[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()


def changed(commit: str) -> set[str]:
    """Paths that differ from a commit, or are new and not ignored."""
    return {*lines("git", "diff", "--name-only", commit), *lines("git", "ls-files", "--others", "--exclude-standard")}


def wanted(paths: set[str], order: list[str]) -> list[str]:
    """Folders and files below tests/, for these changed paths; order: the floors from the ground up."""
    lowest, found = len(order), set()
    for path in paths:
        match path.split("/"):
            case ["host", "plumb", floor, *_] if floor.removesuffix(".py") in order:
                lowest = min(lowest, order.index(floor.removesuffix(".py")))
            case ["firmware", *_]:
                lowest = min(lowest, order.index(FIRMWARE_FLOOR))
            case ["tests", "support" | "conftest.py", *_] | ["host", *_]:
                lowest = 0
            case ["tests", folder, *_] if (TESTS / folder).exists():
                found.add(f"tests/{folder}")
    above = {f"tests/{floor}" for floor in order[lowest:] if (TESTS / floor).is_dir()}
    others = {f"tests/{path.name}" for path in TESTS.glob("test_*.py")} if paths else set()
    return sorted(found | above | others)


if __name__ == "__main__":
    print(*wanted(changed(sys.argv[1] if len(sys.argv) > 1 else "HEAD"), floors()))
