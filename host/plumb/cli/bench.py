"""Instructions, estimated Cortex-M3 cycles, bytes, stack and error of the kernels, against the budgets.

The instruction counts are exact: the Arm code of the shipped image runs in an emulator. Cycles follow the timing model
at the top of plumb/bench/m3_timing.py, at zero and at two flash wait states. Exit code 1 when a budget is exceeded.

    plumb bench
    plumb bench --recording walk.npz --recording run.npz

--recording counts every step of recordings as `plumb compare` takes them, for the systems whose budget is one of the
mean step; a minute of recording takes some seconds.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--recording", type=Path, action="append", metavar="FILE",
        help="count the steps of this recording instead, for systems with a budget of the mean; repeatable",
    )  # fmt: skip
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.bench import bench
    from plumb.errors import ExitCode

    if arguments.recording:
        return _over_recordings(arguments.recording, arguments.json)
    result = bench.measure()
    print(json.dumps(result.to_json()) if arguments.json else result.render())
    return ExitCode.GOOD if result.within_budget else ExitCode.BAD_VERDICT


def _over_recordings(paths: list[Path], as_json: bool) -> int:
    from tqdm import tqdm

    from plumb.bench import bench, recordings
    from plumb.errors import ExitCode

    with tqdm(unit="step", desc="bench", leave=False, disable=None) as bar:
        found = recordings.loads(bench.find_image(), list(dict.fromkeys(paths)), bar.update)
    good = recordings.within_budget(found)
    if as_json:
        print(json.dumps({"loads": [asdict(one) for one in found]}))
    else:
        print("\n".join(one.line() for one in found))
        print("within the budget" if good else "over the budget")
    return ExitCode.GOOD if good else ExitCode.BAD_VERDICT
