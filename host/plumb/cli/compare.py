"""Compare tilt errors of published algorithms and of plumb's systems, on recordings, prescribed motions or in flight.

FILE is a recording as `plumb replay` takes it, with a reference. VQF, BasicVQF (package vqf), Madgwick and Mahony
(package AHRS) run with their documented defaults, and every system of plumb that declares itself comparable, all on the
same counts: 16 bits at +-2000 deg/s and +-16 g.

    plumb compare walk.npz
    plumb compare walk.npz run.npz --decimate 3 --decimate 6
    plumb compare walk.npz --grade all --out out/compare
    plumb compare walk.npz --grade missing-1 --algorithm VQF --algorithm attitude
    plumb compare --motions --seeds 10 --algorithm VQF --algorithm attitude
    plumb compare --flights --only calm-place --only sticks

--decimate takes the mean of every 3 or 6 samples; --grade adds the errors of another sensor, loses samples, or starts
inside the motion. All combinations that are asked for are run; a run of Madgwick or Mahony takes seconds for every
minute that was recorded, and --algorithm leaves them out. --motions runs on motions that no recording has: on an arm,
in dashes, round a roundabout, in a bank turn, vibrating. Each has sensors of its own for every seed, from 1000 on.
--flights flies a simulated quadrotor on the estimate of each algorithm that can fly: VQF, BasicVQF, Mahony with the
settings of a flight controller, and plumb's; with the same wind, pilot and sensors for each. A flight of a minute and
four seeds takes some twenty seconds; those of ten minutes are flown when --only names them.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import checked_file, options
from plumb.cli.whole_numbers import whole_number
from plumb.errors import counted

if TYPE_CHECKING:
    from plumb.analyses.comparison.contenders import Contender
    from plumb.analyses.comparison.table import Compared
    from plumb.analyses.flights.estimators import Estimator


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, nargs="*", metavar="FILE", help="recordings with a reference")
    parser.add_argument(
        "--decimate",
        type=whole_number,
        action="append",
        choices=(1, 3, 6),
        help="mean of so many samples; repeatable (default 1)",
    )
    parser.add_argument(
        "--grade",
        action="append",
        metavar="NAME",
        help="errors to add, or all; repeatable (default: recorded); a wrong name lists them",
    )
    parser.add_argument("--motions", action="store_true", help="run on prescribed motions, too")
    parser.add_argument("--flights", action="store_true", help="fly a simulated quadrotor on each estimate")
    parser.add_argument("--only", action="append", metavar="NAME", help="this motion or flight only; repeatable")
    parser.add_argument(
        "--seeds", type=whole_number, metavar="N", help="seeds of a motion or flight, from 1000 on (default 4)"
    )
    parser.add_argument(
        "--drag-setting",
        type=float,
        metavar="D",
        help="rotor drag by mass, 1/s, set in estimators that use it (default: that of the airframe)",
    )
    parser.add_argument("--algorithm", action="append", metavar="NAME", help="run this one; repeatable (default: all)")
    checked_file.add_as_found(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write report.html, errors.svg, comparison.json")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    import json

    from plumb.analyses.comparison import page
    from plumb.errors import ExitCode, UsageError
    from plumb.proof import table_text

    if arguments.flights and (arguments.file or arguments.motions or arguments.grade or arguments.decimate):
        raise UsageError("--flights stands alone: its algorithms are not those of recordings and motions")
    if not (arguments.file or arguments.motions or arguments.flights):
        raise UsageError("there is nothing to compare on: name recordings, or give --motions or --flights")
    if (arguments.only or arguments.seeds is not None) and not (arguments.motions or arguments.flights):
        raise UsageError("--only and --seeds choose among motions or flights: give --motions or --flights")
    if arguments.drag_setting is not None and not (arguments.flights and 0.0 <= arguments.drag_setting <= 2.0):
        raise UsageError("--drag-setting belongs to --flights, and is 0 (no aid) to 2 per second")
    if arguments.seeds is not None and arguments.seeds < 1:
        raise UsageError(f"--seeds is 1 or more, not {arguments.seeds}")
    results, algorithms = _flown(arguments) if arguments.flights else _replayed(arguments)
    document = {**page.to_json(results, algorithms), "check": getattr(arguments, "checked", {})}
    found = page.tables(results, algorithms)
    if arguments.out:
        from plumb.proof import report
        from plumb.proof.svg_plot import plot_svg

        lead = f"{counted(len(results), 'input')}, {counted(len(algorithms), 'algorithm')} on the same counts."
        drawn = [plot for one in (results if arguments.flights else results[:1]) for plot in page.plots(one)]
        html = report.page("Tilt error, compared", "", lead, [*drawn, *found])
        texts = {"report.html": html, "errors.svg": plot_svg(*drawn)}
        texts["comparison.json"] = json.dumps(document, indent=1) + "\n"
        report.write_whole(arguments.out, texts)
    print(json.dumps(document) if arguments.json else table_text.text(found))
    if arguments.out and not arguments.json:
        print(f"report: {arguments.out / 'report.html'}")
    return ExitCode.GOOD


def _replayed(arguments: argparse.Namespace) -> tuple[list[Compared], tuple[Contender, ...]]:
    from tqdm import tqdm

    from plumb.analyses.comparison import motions
    from plumb.analyses.comparison.contenders import contenders
    from plumb.analyses.comparison.grades import AS_RECORDED, GRADES
    from plumb.analyses.comparison.samples import motion_of
    from plumb.analyses.comparison.table import compare, of_recordings, runs
    from plumb.errors import UsageError

    grades = list(dict.fromkeys(arguments.grade or [AS_RECORDED]))
    if "all" in grades:
        grades = list(GRADES)
    for grade in grades:
        if grade not in GRADES:
            known = "; ".join(f"{name}: {one.title}" for name, one in GRADES.items())
            raise UsageError(f"there is no grade '{grade}'; give all, or one of: {known}")
    for name in arguments.only or ():
        if name not in motions.MOTIONS:
            raise UsageError(f"there is no motion '{name}'; there are {', '.join(motions.MOTIONS)}")
    algorithms = contenders(arguments.algorithm or ())
    loaded = [checked_file.load(path, arguments) for path in dict.fromkeys(arguments.file)]
    arguments.checked = {one.path.name: checked_file.told(found, arguments.as_found) for one, found in loaded}
    recorded = [motion_of(one) for one, _ in loaded]
    blocks = dict.fromkeys(arguments.decimate or [1])
    inputs = [of_recordings(recorded, grade, block) for grade in grades for block in blocks] if recorded else []
    if arguments.motions:
        seeds = range(motions.FIRST_SEED, motions.FIRST_SEED + (arguments.seeds or motions.SEEDS))
        chosen = [name for name in motions.MOTIONS if name in (arguments.only or motions.MOTIONS)]
        inputs += [motions.of_motion(name, seeds) for name in chosen]
    with tqdm(total=runs(inputs, algorithms), unit="run", disable=None, leave=False) as bar:
        return compare(inputs, algorithms, bar.update), algorithms


def _flown(arguments: argparse.Namespace) -> tuple[list[Compared], tuple[Estimator, ...]]:
    from tqdm import tqdm

    from plumb.analyses.flights import inputs
    from plumb.analyses.flights.estimators import estimators

    names, algorithms = inputs.chosen(arguments.only or ()), estimators(arguments.algorithm or ())
    seeds = range(inputs.FIRST_SEED, inputs.FIRST_SEED + (arguments.seeds or inputs.SEEDS))
    with tqdm(total=inputs.seconds(names), unit="s", disable=None, leave=False) as bar:
        return [inputs.flown(name, seeds, algorithms, bar.update, arguments.drag_setting) for name in names], algorithms
