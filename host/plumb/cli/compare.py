"""Compare tilt errors of published algorithms and of plumb's systems on recordings with a reference.

FILE is a recording as `plumb replay` takes it, with a reference. VQF, BasicVQF (package vqf), Madgwick and Mahony
(package AHRS) run with their documented defaults, and every system of plumb that declares itself comparable, all on the
same counts: 16 bits at +-2000 deg/s and +-16 g.

    plumb compare walk.npz
    plumb compare walk.npz run.npz --decimate 3 --decimate 6
    plumb compare walk.npz --grade all --out out/compare
    plumb compare walk.npz --grade missing-1 --algorithm VQF --algorithm attitude

--decimate takes the mean of every 3 or 6 samples; --grade adds the errors of another sensor, loses samples, or starts
inside the motion. All combinations that are asked for are run; a run of Madgwick or Mahony takes seconds for every
minute that was recorded, and --algorithm leaves them out.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, nargs="+", metavar="FILE", help="recordings with a reference")
    parser.add_argument(
        "--decimate",
        type=int,
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
    parser.add_argument("--algorithm", action="append", metavar="NAME", help="run this one; repeatable (default: all)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html and DIR/comparison.json")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    import json

    from tqdm import tqdm

    from plumb.analyses.comparison import page
    from plumb.analyses.comparison.contenders import contenders
    from plumb.analyses.comparison.grades import AS_RECORDED, GRADES
    from plumb.analyses.comparison.samples import motion_of
    from plumb.analyses.comparison.table import compare, of_recordings, runs
    from plumb.errors import ExitCode, UsageError
    from plumb.inputs import recording
    from plumb.proof import table_text

    grades = list(dict.fromkeys(arguments.grade or [AS_RECORDED]))
    if "all" in grades:
        grades = list(GRADES)
    for grade in grades:
        if grade not in GRADES:
            known = "; ".join(f"{name}: {one.title}" for name, one in GRADES.items())
            raise UsageError(f"there is no grade '{grade}'; give all, or one of: {known}")
    algorithms = contenders(arguments.algorithm or ())
    motions = [motion_of(recording.load(path)) for path in dict.fromkeys(arguments.file)]
    blocks = dict.fromkeys(arguments.decimate or [1])
    inputs = [of_recordings(motions, grade, block) for grade in grades for block in blocks]
    with tqdm(total=runs(inputs, algorithms), unit="run", disable=None, leave=False) as bar:
        results = compare(inputs, algorithms, bar.update)
    told = page.to_json(results, algorithms)
    found = page.tables(results, algorithms)
    if arguments.out:
        from plumb.proof import report

        lead = f"{len(motions)} recordings, {len(algorithms)} algorithms on the same counts."
        html = report.page("Tilt error, compared", "", lead, [*found, *page.plots(results[0])])
        texts = {"report.html": html, "comparison.json": json.dumps(told, indent=1) + "\n"}
        report.write_whole(arguments.out, texts)
    print(json.dumps(told) if arguments.json else table_text.text(found))
    if arguments.out and not arguments.json:
        print(f"report: {arguments.out / 'report.html'}")
    return ExitCode.GOOD
