"""Run a recording of a real three-axis sensor through a board, one axis, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/recording.py. An ideal sensor is scaled to the
recording, resampled to the period. Where the recording has an optical reference the tilt error is reported, over the
samples marked as movement. Exit code 1 on a mismatch.

With --system phone, pitch and roll of the whole sensor; FILE may then also hold the datagrams of a phone's app, one a
line, as `plumb phone --save` writes them. Of several runs in a file the longest is taken.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plumb.proof.runs import RunInputs
    from plumb.tuning.quantise import ControlParams


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    parser.add_argument(
        "--system", choices=("quad", "phone"), default="quad", help="quad: one axis; phone: both angles"
    )
    parser.add_argument("--axis", choices=("x", "y", "z"), default="x", help="quad: axis of rotation (default x)")
    parser.add_argument("--board", required=True, metavar="B", help="native, qemu, virtual, serial:PORT or can:BUS")
    parser.add_argument("--link", choices=("serial", "can"), default="serial", help="how `virtual` is spoken to")
    parser.add_argument("--image", type=Path, help="flash image for `virtual` (default: the checkout's build)")
    parser.add_argument("--period-us", type=int, help="control period (default: the recording's own)")
    parser.add_argument("--seconds", type=float, help="only the first so many seconds")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html, summary.json and steps.csv")
    parser.add_argument("--json", action="store_true", help="print JSON")


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards import open_board
    from plumb.cli.run import describe
    from plumb.proof import runs

    inputs, params, heading = (of_phone if arguments.system == "phone" else of_axis)(arguments)
    with open_board(arguments.board, link=arguments.link, image=arguments.image) as board:
        result = runs.open_loop(board, inputs, params)
    summary = result.summary(
        system=arguments.system,
        **heading,
        loop="open",
        board=arguments.board,
        link=arguments.link if arguments.board == "virtual" else None,
        seed=None,
        scored_steps=int(inputs.scored.sum()),
    )
    if arguments.out:
        from plumb.proof import run_report

        run_report.write_run(arguments.out, result, summary)
    print(json.dumps(summary) if arguments.json else describe(summary))
    return {"pass": 0, "fail": 1, "unverified": 3}[result.verdict]


def steps_in(seconds: float, period_us: int, most: int) -> int:
    """How many steps that is, of those that there are; raises UsageError when it is none."""
    from plumb.errors import UsageError

    if not seconds * 1e6 >= period_us:
        raise UsageError(f"{seconds:g} s is less than one period of {period_us} us")
    return int(min(seconds * 1e6 / period_us + 0.5, most))


def of_axis(arguments: argparse.Namespace) -> tuple[RunInputs, ControlParams, dict[str, Any]]:
    """One axis of a recording, and the tuning made to fit it."""
    from plumb.inputs import recording
    from plumb.systems.quad import scenarios as quad

    axis = recording.pick_axis(recording.load(arguments.file), arguments.axis, arguments.period_us)
    if arguments.seconds is not None:
        axis = axis.first(steps_in(arguments.seconds, axis.period_us, len(axis.raw)))
    inputs, params = recording.run_inputs(axis, quad.TUNINGS["recording"])
    return inputs, params, {"scenario": f"{arguments.file.name} about {arguments.axis}", "tuning": "recording"}


def of_phone(arguments: argparse.Namespace) -> tuple[RunInputs, ControlParams, dict[str, Any]]:
    """Pitch and roll of a recording, or of a file of datagrams."""
    from plumb.inputs import phone_run, phone_udp
    from plumb.systems.phone import scenarios as phone

    period_us = phone.PERIOD_US if arguments.period_us is None else arguments.period_us
    params = phone_run.params_of(phone.DEFAULT_TUNING, period_us)
    steps, intake, recorded = phone_udp.steps_of_file(arguments.file, period_us)
    longest = phone_run.longest_run(steps)
    if arguments.seconds is not None:
        longest = longest[: steps_in(arguments.seconds, period_us, len(longest))]
    heading = {"scenario": arguments.file.name, "tuning": phone.DEFAULT_TUNING, "received": intake.to_json()}
    return phone_run.inputs_of(longest, params, recorded), params, heading
