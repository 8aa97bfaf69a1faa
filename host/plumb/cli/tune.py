"""Find settings from measurements: noise of the sensors at rest, and Q and R of the filter on a recording.

    plumb tune noise rest.npz --out out/noise          Allan deviation, noise figures, and Q and R of quad
    plumb tune noise today.plog --system balancer      a log of `plumb record --run live`
    plumb tune noise walk.csv --axis y --begin 2 --end 40
    plumb tune filter walk.npz --out out/filter        Q and R that describe the whole recording best
    plumb tune filter today.plog --tuning constant

RECORDING is .npz or .csv as for `plumb replay`, or a log of `plumb record`. Nothing is sent to a board; the line
that sets the settings is printed.

`noise` takes the longest rest of the recording. The sensor lies still for some minutes; the longer, the better bias
instability and random walk are known. It prints white noise, bias instability and random walk with their confidence,
and the Q and R of the system's tuning that follow from them.

`filter` runs the filter of the system over the recording, and finds the Q and R that make its innovations most likely.
It prints settings with confidence, and how consistent the filter is before and after: NIS, whiteness, and, where the
recording has a reference, the tilt error. Exit code 1 when the settings are of no use: they make the tilt error larger,
or the board cannot hold them.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.proof.report import Plot, Table
    from plumb.proof.xy_plot import XyPlot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="action", required=True, metavar="noise|filter")
    noise = verbs.add_parser("noise", help="Q and R from a recording at rest, with an Allan plot")
    noise.add_argument("recording", type=Path, metavar="RECORDING", help=".npz, .csv, or a log of `plumb record`")
    add_target(noise, "whose Q and R are wanted (default: the recorded board's, else that of `plumb replay`)")
    noise.add_argument("--begin", type=float, metavar="S", help="begin of the rest (default: found)")
    noise.add_argument("--end", type=float, metavar="S", help="end of the rest (default: found)")
    noise.add_argument(
        "--highest-hz", type=float, metavar="HZ", help="highest frequency of the fit (default: an eighth of the rate)"
    )
    add_output(noise)
    likely = verbs.add_parser("filter", help="Q and R from the innovations over a recording")
    likely.add_argument("recording", type=Path, metavar="RECORDING", help=".npz, .csv, or a log of `plumb record`")
    add_target(likely, "whose filter is tuned (default: the recorded board's, else that of `plumb replay`)")
    options.add_seconds(likely, "only the first N seconds")
    add_output(likely)


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
    good = {"noise": tune_noise, "filter": tune_filter}[arguments.action](arguments)
    return ExitCode.GOOD if good else ExitCode.BAD_VERDICT


def require_scipy() -> None:
    from importlib.util import find_spec

    from plumb.errors import UsageError
    from plumb.extras import install_hint

    if find_spec("scipy") is None:
        raise UsageError(f"plumb tune needs scipy; install it {install_hint('tune')}")


def tune_noise(arguments: argparse.Namespace) -> bool:
    """Whether the board can hold what was found."""
    from plumb import systems
    from plumb.inputs.identification import noise, noise_page, rest

    whole = rest.load(arguments.recording)
    if arguments.begin is None and arguments.end is None:
        used = rest.longest_rest(whole)
    else:
        used = whole.part(arguments.begin or 0.0, whole.whole_s if arguments.end is None else arguments.end)
    system = arguments.system or whole.system or systems.default_for("replay")
    period_us = arguments.period_us
    if period_us is None and whole.system:
        period_us = round(whole.period_s * 1e6)
    found = noise.measure(used, arguments.highest_hz)
    for sentence in (sentence for one in found for sentence in one.warnings()):
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    settings = noise.filter_noise(found, system, arguments.tuning, period_us, arguments.axis)
    told = noise_page.to_json(used, found, settings)
    tables = [*noise_page.noise_tables(found), *noise_page.settings_tables(settings)]
    plots = noise_page.plots(used, found) if arguments.out else []
    give(arguments, "Noise of the sensors", noise_page.heading(used), tables, plots, told)
    return not settings.refusal


def tune_filter(arguments: argparse.Namespace) -> bool:
    """Whether the settings are of use."""
    from tqdm import tqdm

    from plumb import systems
    from plumb.inputs.identification import filter_inputs, filter_page, likelihood, rest

    path = arguments.recording
    system = arguments.system or ("" if rest.is_log(path) else systems.default_for("replay"))
    options.check_duration(arguments.seconds)
    inputs = filter_inputs.inputs_of(
        path, system, arguments.tuning, arguments.axis, arguments.period_us, arguments.seconds
    )
    with tqdm(unit="run", desc="likelihood", disable=None, leave=False) as bar:
        fit = likelihood.fit(inputs.measured, inputs.start, bar.update)
    for sentence in filter_page.warnings(inputs, fit):
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    steps, period_ms = len(inputs.measured.z_deg), 1e3 * inputs.measured.period_s
    lead = f"{inputs.title}: {steps} steps of {period_ms:.4g} ms; {inputs.tuning.system}, tuning {inputs.tuning_name}."
    plots = filter_page.plots(inputs, fit) if arguments.out else []
    tables, told = filter_page.tables(inputs, fit), filter_page.to_json(inputs, fit)
    give(arguments, "Filter, tuned by its innovations", lead, tables, plots, told)
    return filter_page.useful(inputs, fit)


def give(
    arguments: argparse.Namespace,
    title: str,
    lead: str,
    tables: Sequence[Table],
    plots: Sequence[XyPlot | Plot],
    told: dict[str, object],
) -> None:
    """Print the tables or the JSON; with --out write report.html and tune.json."""
    from plumb.proof import report, table_text

    if arguments.out:
        html = report.page(title, "", lead, [*tables, *plots])
        report.write_whole(arguments.out, {"report.html": html, "tune.json": json.dumps(told, indent=1) + "\n"})
    print(json.dumps(told) if arguments.json else f"{lead}\n\n{table_text.text(tables)}")
    if arguments.out and not arguments.json:
        print(f"\nreport: {arguments.out / 'report.html'}")
