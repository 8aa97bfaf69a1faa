"""Inject named faults into the virtual board while it is armed and drives; compare each reaction with its limit.

    plumb faults                              all faults, on every system that drives an actuator or reads chips
    plumb faults gyro-frozen --system quad    one fault, on one system
    plumb faults hangs 'can-*' --json         groups and names, with * and ?
    plumb faults host-silent --phases 1000    injected at a thousand different moments within 60 ms
    plumb faults gyro-frozen --system quad --gdb 3333    stop in it, step and look into it with gdb
    plumb faults --list 'can-*'               faults with their limits (default: all); runs nothing

The virtual board runs the flash image. A fault passes when every output pin is safe within its limit and stays safe,
and the board reports the fault in the expected frame. A fault that must have no effect (limit 0) passes when every
step is the same as without it. A system that drives nothing is not armed; its sensors' faults have to be named, and its
steps go on. Exit code 1 when a fault fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.proof.faults.fault import Fault

MOST_PHASES = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fault", nargs="*", metavar="FAULT", help="names or groups (default: all)")
    options.add_systems(parser, "a system that drives an actuator or reads chips (default: all)")
    parser.add_argument(
        "--phases", type=whole_number, default=50, help="moments to inject a fault that depends on timing (default 50)"
    )
    options.add_image(parser, "flash image, its ELF file in the same folder")
    options.add_gdb(parser, options.GDB_FIRST)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html and DIR/summary.json")
    parser.add_argument("--list", action="store_true", help="list the faults instead of running them")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError, exit_code_of
    from plumb.proof.faults import table

    if not 1 <= arguments.phases <= MOST_PHASES:
        raise UsageError(f"--phases {arguments.phases}: give a number from 1 to {MOST_PHASES}")
    tested = table.tested_systems()
    for name in arguments.system or ():
        if name not in tested:
            raise UsageError(f"'{name}' neither drives an actuator nor reads chips; use one of {', '.join(tested)}")
    faults = table.chosen(arguments.fault)
    if arguments.list:
        return list_faults(faults, arguments.json)
    from tqdm import tqdm

    from plumb.boards.debugging import debugged
    from plumb.flash.image import find_image
    from plumb.proof.faults.runner import run_all
    from plumb.proof.faults.scene import scenarios_of
    from plumb.proof.faults.text import render
    from plumb.spec import images

    systems = list(dict.fromkeys(arguments.system or tested))
    image = find_image(arguments.image or images.running(systems[0] if len(systems) == 1 else None))
    scenes = [(system, scenario) for system in systems for scenario in scenarios_of(system)]
    rows = []
    total = len(scenes) * len(faults)
    with (
        debugged(arguments.gdb, waits=True),
        tqdm(total=total, desc="faults", unit="fault", leave=False, disable=None) as bar,
    ):
        for system, scenario in scenes:
            rows += run_all(system, faults, arguments.image, arguments.phases, bar.update, scenario)
    if not rows:
        raise UsageError(f"none of these faults applies to {', '.join(systems)}")
    verdict = "pass" if all(row.verdict == "pass" for row in rows) else "fail"
    files = []
    if arguments.out:
        from plumb.proof.faults.fault_report import write_report

        files = write_report(arguments.out, rows, verdict, image, getattr(arguments, "command_line", ""))
    if arguments.json:
        print(json.dumps({"verdict": verdict, "faults": [row.to_json() for row in rows]}))
    else:
        print(render(rows, colour=sys.stdout.isatty()))
        for label, path in zip(("report", "files"), files, strict=False):
            print(f"{label}: {path}")
    return exit_code_of(verdict)


def list_faults(faults: Sequence[Fault], as_json: bool) -> int:
    """Print faults with their descriptions and limits, then the limits that they have; run nothing."""
    from plumb.proof.faults.limits import limits

    rows = [
        {"group": fault.group, "name": fault.name, "what": fault.what, "limit": fault.limit,
         "limit_ms": limits()[fault.limit].safe_ms, "needs": sorted(fault.needs)}
        for fault in faults
    ]  # fmt: skip
    if as_json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        print(f"{row['group']:<8} {row['name']:<28} {row['limit_ms']:>5g} ms  {row['what']}")
    print()
    used = {fault.limit for fault in faults}
    for name, limit in limits().items():
        if name not in used:
            continue
        print(f"{name:<8} safe within {limit.safe_ms:g} ms, noticed within {limit.detected_ms:g} ms: {limit.why}")
    return 0
