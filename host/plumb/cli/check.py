"""Audit a recording of a gyro and an accelerometer by physics: units, axes, signs, clock, lags, limits, the reference.

    plumb check walk.csv                            what is wrong, with the number behind it and the mend
    plumb check walk.csv --out page                 the same with plots, in page/report.html
    plumb check walk.csv --mend acc*-1              the audit after a mend by hand; repeatable
    plumb check walk.csv --as-found                 the audit after all that is sure is undone
    plumb check walk.csv --units "gyr=rad/s,acc=m/s2,time=us" --columns "time=t,gyr=wx wy wz,acc=ax ay az" --frame frd

The gyro says how a direction that is fixed to the earth turns in the sensor's axes, and the accelerometer shows it:
over the factor, the 48 ways to name axes, and lags, one fits. Nothing of an estimator is used, and no board.

Each finding is `sure`, `likely` (two readings, or no motion that tells them apart: both are named) or `unknown`. A line
that begins with ! is a fault; the mend undoes it. The lines that begin with `read:` say what of the file was taken:
format, header, separator, columns and units. --as-found audits again with all that is sure undone, and prints what
that was; what is likely is never applied unless --mend names it.

Exit code 0 when nothing is surely wrong, 1 when something is, 2 for a file that cannot be read.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.audit.audit import Audit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    parser.add_argument("--mend", action="append", default=[], metavar="WORD", help="undo this first; repeatable")
    parser.add_argument("--as-found", action="store_true", help="undo all that is sure, say what, and audit again")
    options.add_given(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html, with plots")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    import json

    from plumb.audit.audited_files import audited
    from plumb.errors import ExitCode

    given = options.given_of(arguments)
    taken: list[str] = []
    found = audited(arguments.file, arguments.mend, given, taken)
    applied: list[str] = []
    if arguments.as_found:
        applied = found.sure_mends
        found = audited(arguments.file, [*arguments.mend, *applied], given)
    if arguments.out:
        from plumb.audit import page
        from plumb.proof import report

        html = report.page(
            f"Check of {arguments.file.name}", "", verdict(found), [*page.tables(found), *page.plots(found)]
        )
        report.write_whole(arguments.out, {"report.html": html})
    if arguments.json:
        print(json.dumps(to_json(arguments, found, applied, taken)))
    else:
        print("\n".join([f"read: {one}" for one in taken] + lines(found, applied)))
        if arguments.out:
            print(f"report: {arguments.out / 'report.html'}")
    return ExitCode.BAD_VERDICT if found.sure_fault else ExitCode.GOOD


def to_json(arguments: argparse.Namespace, found: Audit, applied: list[str], taken: list[str]) -> dict[str, object]:
    return {
        "recording": str(arguments.file),
        "taken": taken,
        "mends": [*arguments.mend, *applied],
        "sure_fault": found.sure_fault,
        "as_found": found.sure_mends,
        "findings": [one.to_json() for one in found.findings],
    }


def lines(found: Audit, applied: list[str]) -> list[str]:
    """Faults first, then properties, then the verdict."""
    said = [f"as found: {' '.join(applied)}"] if applied else []
    said += [f"! {one.line}" for one in found.faults]
    said += [f"  {one.line}" for one in found.findings if not one.wrong]
    return [*said, verdict(found)]


def verdict(found: Audit) -> str:
    """The last line."""
    sure = sum(one.sure_fault for one in found.findings)
    if sure:
        mends = "; --as-found undoes " + " ".join(found.sure_mends) if found.sure_mends else ""
        return f"{sure} surely wrong{mends}"
    likely = len(found.faults)
    if likely:
        return f"nothing is surely wrong, {likely} likely"
    return "nothing is wrong" if found.enough else "nothing can be told: too few samples"
