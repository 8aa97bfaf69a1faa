"""Instructions, estimated Cortex-M3 cycles, bytes, stack and error of the kernels, against the budgets.

The instruction counts are exact: the Arm code of the shipped image runs in an emulator. Cycles follow the timing model
at the top of plumb/bench/m3_timing.py, at zero and at two flash wait states. Exit code 1 when a budget is exceeded.
"""

from __future__ import annotations

import argparse
import json

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.bench import bench
    from plumb.errors import ExitCode

    result = bench.measure()
    print(json.dumps(result.to_json()) if arguments.json else result.render())
    return ExitCode.GOOD if result.within_budget else ExitCode.BAD_VERDICT
