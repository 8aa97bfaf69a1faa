#!/usr/bin/env python3
"""Processor time of the last whole run of the tests, by folder and by test: `make test-times`.

    tools/test_times.py [--longest N]

Reads build/test-times.json, which the tests write. Exit code 2 without it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

TIMES = Path(__file__).resolve().parents[1] / "build" / "test-times.json"


def main() -> int:
    parser = argparse.ArgumentParser(description="Processor time of the last whole run of the tests.")
    parser.add_argument("--longest", type=int, default=200, metavar="N", help="tests to show (default %(default)s)")
    wanted = parser.parse_args()
    try:
        times_s: dict[str, float] = json.loads(TIMES.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        print(f"there is no {TIMES.name} in {TIMES.parent}; run: make test", file=sys.stderr)
        return 2
    folders: dict[str, float] = {}
    counts = Counter[str]()
    for test, time_s in times_s.items():
        folder = test.partition("::")[0].rpartition("/")[0]
        folders[folder] = folders.get(folder, 0.0) + time_s
        counts[folder] += 1
    print(f"{sum(times_s.values()) / 60:.1f} minutes of processor time, {len(times_s)} tests\n")
    for folder, time_s in sorted(folders.items(), key=lambda one: -one[1]):
        print(f"{time_s:8.1f} s  {counts[folder]:5}  {folder}")
    print()
    for test, time_s in sorted(times_s.items(), key=lambda one: -one[1])[: wanted.longest]:
        print(f"{time_s:8.2f} s  {test}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
