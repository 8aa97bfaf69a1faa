"""Find settings from measurements: Q and R of a system's filter from the noise of its sensors at rest.

    plumb tune noise rest.npz --out out/noise          Allan deviation, noise figures, and Q and R of quad
    plumb tune noise today --system balancer           a folder of `plumb record --run live`
    plumb tune noise walk.csv --axis y --from 2 --to 40

`noise` takes the longest rest of the recording: .npz or .csv as for `plumb replay`, or a folder of `plumb record`. The
sensor lies still for some minutes; the longer, the better bias instability and random walk are known. It prints white
noise, bias instability and random walk with their confidence, Q and R of the system's tuning, and the line that sets
them. Nothing is sent to a board.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="action", required=True, metavar="noise")
    noise = verbs.add_parser("noise", help="Q and R from a recording at rest, with an Allan plot")
    noise.add_argument("recording", type=Path, metavar="RECORDING", help=".npz, .csv, or a folder of `plumb record`")
    add_target(noise, "whose Q and R are wanted (default: the recorded board's, else that of `plumb replay`)")
    noise.add_argument("--from", type=float, dest="first_s", metavar="S", help="begin of the rest (default: found)")
    noise.add_argument("--to", type=float, dest="last_s", metavar="S", help="end of the rest (default: found)")
    noise.add_argument(
        "--highest-hz", type=float, metavar="HZ", help="highest frequency of the fit (default: an eighth of the rate)"
    )
    add_output(noise)


def add_target(parser: argparse.ArgumentParser, about: str) -> None:
    options.add_system(parser, f"system {about}")
    options.add_tuning(parser)
    axis = "axis of a three-axis recording, for systems with one axis (default x)"
    parser.add_argument("--axis", choices=("x", "y", "z"), default="x", help=axis)
    parser.add_argument("--period-us", type=int, metavar="US", help="period of the system's steps (default: its own)")


def add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html and DIR/tune.json")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import ExitCode

    require_scipy()
    tune_noise(arguments)
    return ExitCode.GOOD


def require_scipy() -> None:
    from importlib.util import find_spec

    from plumb.errors import UsageError
    from plumb.extras import install_hint

    if find_spec("scipy") is None:
        raise UsageError(f"plumb tune needs scipy; install it {install_hint('tune')}")


def tune_noise(arguments: argparse.Namespace) -> None:
    from plumb import systems
    from plumb.inputs.identification import noise, noise_page, rest
    from plumb.proof import report, table_text

    whole = rest.load(arguments.recording)
    if arguments.first_s is None and arguments.last_s is None:
        used = rest.longest_rest(whole)
    else:
        used = whole.part(arguments.first_s or 0.0, whole.whole_s if arguments.last_s is None else arguments.last_s)
    system = arguments.system or whole.system or systems.default_for("replay")
    period_us = arguments.period_us
    if period_us is None and whole.system:
        period_us = round(whole.period_s * 1e6)
    found = noise.measure(used, arguments.highest_hz)
    for sentence in (sentence for one in found for sentence in one.warnings()):
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    settings = noise.filter_noise(found, system, arguments.tuning, period_us, arguments.axis)
    told = noise_page.to_json(used, found, settings)
    tables = [*noise_page.noise_tables(found), noise_page.settings_table(settings), noise_page.apply_table(settings)]
    if arguments.out:
        plots = noise_page.plots(used, found)
        html = report.page("Noise of the sensors", "", noise_page.heading(used), [*tables, *plots])
        report.write_whole(arguments.out, {"report.html": html, "tune.json": json.dumps(told, indent=1) + "\n"})
    print(json.dumps(told) if arguments.json else f"{noise_page.heading(used)}\n\n{table_text.text(tables)}")
    if arguments.out and not arguments.json:
        print(f"\nreport: {arguments.out / 'report.html'}")
