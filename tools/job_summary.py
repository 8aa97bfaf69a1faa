#!/usr/bin/env python3
"""Markdown of one build: flash, RAM and stack by module with their limits, and the cycles of the kernels.

    tools/job_summary.py >>"$GITHUB_STEP_SUMMARY"

Reads build/stm32f103/firmware.size.json, which tools/size_table.py writes in every build, and measures like
`plumb bench`. Exit code 1 when a budget is exceeded, 2 without an image.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.bench import bench  # noqa: E402
from plumb.errors import PlumbError, UsageError  # noqa: E402


def table(head: list[str], rows: Iterable[list[object]]) -> list[str]:
    """A Markdown table: the first column left-aligned, the others right-aligned."""
    lines: list[list[object]] = [[*head], [":--", *["--:"] * (len(head) - 1)], *rows]
    return ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]


def sizes(path: Path) -> list[str]:
    """The tables of tools/size_table.py: the image with its limits, then modules by flash."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise UsageError(f"there is no {path}; build the image with: make image") from None
    kinds = ("flash", "ram", "stack")
    rows: list[list[object]] = [
        [f"**{label}**", *(found[of][kind] for kind in kinds)]
        for label, of in (("image", "totals"), ("limit", "limits"))
    ]
    for name, module in sorted(found["modules"].items(), key=lambda pair: -int(pair[1]["flash"])):
        deepest = max((item.get("deepest", 0) for item in module["items"].values()), default=0)
        rows.append([name, module["flash"], module["ram"], deepest])
    return ["### Flash image, bytes", "", *table(["module", "flash", "RAM", "stack"], rows), ""]


def cycles(result: bench.BenchResult) -> list[str]:
    rows: list[list[object]] = [
        [
            name, row.instructions_max, row.cycles_max, row.cycles_2ws_max, bench.BUDGETS[name].cycles or "-",
            row.bytes, row.stack, row.verdict(bench.BUDGETS[name]),
        ]
        for name, row in result.kernels.items()
    ]  # fmt: skip
    head = ["kernel", "instructions", "cycles", "cycles, 2 wait states", "budget", "bytes", "stack", "verdict"]
    return ["### Kernels on the Cortex-M3", "", *table(head, rows), ""]


def main() -> int:
    try:
        lines = sizes(ROOT / "build" / "stm32f103" / "firmware.size.json")
        result = bench.measure()
    except PlumbError as error:
        print(f"job_summary: {error}", file=sys.stderr)
        return error.exit_code
    print("\n".join([*lines, *cycles(result)]))
    return 0 if result.within_budget else 1


if __name__ == "__main__":
    sys.exit(main())
