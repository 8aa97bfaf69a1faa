#!/usr/bin/env python3
"""Processor and wall time of the last whole run of the tests, by folder and by test: `make test-times`.

    tools/test_times.py [--longest N] [--by processor|wall|waiting]

Reads build/test-times.json, which the tests write: for each test its processor time and its wall time in s. Waiting is
the difference; with fewer cores than workers some of it is waiting for a core. Exit code 2 without the file.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

TIMES = Path(__file__).resolve().parents[1] / "build" / "test-times.json"
COLUMNS = ("processor", "wall", "waiting")


def row(processor_s: float, wall_s: float) -> dict[str, float]:
    return dict(zip(COLUMNS, (processor_s, wall_s, max(wall_s - processor_s, 0.0)), strict=True))


def main() -> int:
    parser = argparse.ArgumentParser(description="Times of the last whole run of the tests.")
    parser.add_argument("--longest", type=int, default=200, metavar="N", help="tests to show (default %(default)s)")
    parser.add_argument("--by", choices=COLUMNS, default="processor", help="order (default %(default)s)")
    wanted = parser.parse_args()
    try:
        tests = {test: row(*times_s) for test, times_s in json.loads(TIMES.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, TypeError):
        print(f"there is no {TIMES.name} of this version in {TIMES.parent}; run: make test", file=sys.stderr)
        return 2
    folders = {test: test.partition("::")[0].rpartition("/")[0] for test in tests}
    counts = Counter(folders.values())
    sums = {folder: dict.fromkeys(COLUMNS, 0.0) for folder in counts}
    for test, times_s in tests.items():
        for column in COLUMNS:
            sums[folders[test]][column] += times_s[column]
    minutes = {column: sum(one[column] for one in tests.values()) / 60 for column in COLUMNS}
    print(", ".join(f"{minutes[column]:.1f} minutes {column}" for column in COLUMNS) + f", {len(tests)} tests\n")
    print("  ".join(f"{column:>9}" for column in COLUMNS))
    for folder, times_s in sorted(sums.items(), key=lambda one: -one[1][wanted.by]):
        print("  ".join(f"{times_s[column]:7.1f} s" for column in COLUMNS), f" {counts[folder]:5}  {folder}")
    print()
    for test, times_s in sorted(tests.items(), key=lambda one: -one[1][wanted.by])[: wanted.longest]:
        print("  ".join(f"{times_s[column]:7.2f} s" for column in COLUMNS), f" {test}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
