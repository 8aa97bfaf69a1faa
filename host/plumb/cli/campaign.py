"""Run thousands of runs of a study on all cores or on a cluster, and print figures with intervals.

    plumb campaign quad --runs 10000 --seconds 60                     seeds 1000 to 10999 on all cores
    plumb campaign balancer --runs 400 --open-loop --out out/balancer the runs, a page and a summary in a folder
    plumb campaign STUDY.toml --out out/study                         a declared study: what varies, and how it is drawn
    plumb campaign STUDY.toml --out out/study --resume                go on where it was killed
    plumb campaign quad --tuning quiet --runs 400 --against out/quad  paired by seed: is the difference real?
    plumb campaign STUDY.toml --scheduler tcp://localhost:8786        on the workers of a Dask cluster

Each run gives the digests of `plumb run --board native` with its seed, in batches that leave out the integer model. The
interval of a figure is the 95 % interval of the mean over all seeds (bootstrap). With --out every batch is kept as soon
as it is done. Exit code 1 when a run failed, when another board differed (--confirm), and when a run of a study with
`invariants = true` violates one.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumb.cli import checked_file, options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.campaign.study import Study

WORKERS_MOST = 1024
"""More processes are no machine's; each takes some hundred megabytes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="SYSTEM|STUDY.toml", help="a system, or a file that declares a study")
    parser.add_argument("--runs", type=whole_number, metavar="N", help="runs in all (default: the study's, else 400)")
    options.add_seconds(parser, "length of a run (default: the study's, else the scenario's own)")
    parser.add_argument("--first-seed", type=whole_number, metavar="N", help="seed of the first run (default 1000)")
    options.add_scenario(parser)
    options.add_tuning(parser)
    options.add_conditions(parser, "condition of every run")
    options.add_faults(parser, "fault of every run, instead of the study's; repeatable")
    options.add_open_loop(parser)
    checked_file.add_as_found(parser, given=False)
    parser.add_argument("--reference", action="store_true", help="compare every run with the float64 reference, too")
    parser.add_argument("--confirm", metavar="B", help="run every step on a further board and compare: virtual, qemu")
    options.add_link_and_image(parser)
    parser.add_argument("--workers", type=whole_number, metavar="N", help="processes (default: one for each core)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="tcp://HOST:PORT of a Dask scheduler, instead of cores")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep every batch, and write runs, summary and page")
    parser.add_argument("--resume", action="store_true", help="go on with the campaign in DIR")
    parser.add_argument("--against", type=Path, metavar="DIR", help="compare with the campaign in DIR, paired by seed")
    parser.add_argument(
        "--only", type=whole_number, metavar="I", help="run number I alone, from 0, and print its figures"
    )
    options.add_json(parser)


def _is_file(arguments: argparse.Namespace) -> bool:
    """Whether the study is a file, and not the name of a system."""
    return Path(arguments.study).suffix == ".toml"


def _study(arguments: argparse.Namespace) -> Study:
    from plumb.campaign import study
    from plumb.errors import UsageError

    given = str(arguments.study)
    path = Path(given)
    declared = _is_file(arguments)
    table: dict[str, Any] = study.read(path).to_json() if declared else {"system": given}  # Any: TOML
    asked = {
        "runs": arguments.runs, "seconds": arguments.seconds, "first_seed": arguments.first_seed,
        "scenario": arguments.scenario, "tuning": arguments.tuning, "confirm": arguments.confirm,
        "link": arguments.link if arguments.link != "serial" else None,
        "image": None if arguments.image is None else str(arguments.image),
    }  # fmt: skip
    table = {name: value for name, value in {**table, **_given(asked)}.items() if value is not None}
    if arguments.condition:
        conditions = dict(table.get("conditions", {}))
        for text in arguments.condition:
            name, _, number = text.partition("=")
            try:
                conditions[name] = float(number)
            except ValueError:
                raise UsageError(f"'{text}' sets nothing; write {name}=NUMBER") from None
        table["conditions"] = conditions
    if arguments.fault:
        table["faults"] = arguments.fault
    table["open_loop"] = arguments.open_loop or table.get("open_loop", False)
    table["as_found"] = arguments.as_found or table.get("as_found", False)
    table["reference"] = arguments.reference or table.get("reference", False)
    return study.from_table(table, given if declared else None)


def _given(values: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in values.items() if value is not None}


def check(arguments: argparse.Namespace) -> None:
    """Check the study. Raises UsageError."""
    from plumb.errors import UsageError

    if not _is_file(arguments):
        options.check_of_virtual(arguments, arguments.confirm or "")
    study = _study(arguments)
    options.check_of_virtual(arguments, study.confirm or "")
    if arguments.workers is not None and not 1 <= arguments.workers <= WORKERS_MOST:
        raise UsageError(f"--workers {arguments.workers}: 1 to {WORKERS_MOST} processes")
    if arguments.only is not None and not 0 <= arguments.only < study.runs:
        raise UsageError(f"--only {arguments.only}: the study has runs 0 to {study.runs - 1}")
    if arguments.resume and arguments.out is None:
        raise UsageError("--resume goes on with a folder: name it with --out")


def main(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from plumb.campaign import against, campaign, folder, report
    from plumb.campaign.batch import identity, run_batch
    from plumb.campaign.results import Results
    from plumb.errors import ExitCode
    from plumb.files import whole_files

    study = _study(arguments)
    other = folder.results_of(arguments.against, study) if arguments.against is not None else None
    if other is not None:
        against.check_seeds(range(study.seed(0), study.seed(study.runs - 1) + 1), other)
    checked = checked_file.said_first(study.recording_files(), study.as_found)
    if arguments.only is not None:
        found = Results([run_batch(study, range(arguments.only, arguments.only + 1))])
    else:
        where = campaign.Where(arguments.workers, arguments.scheduler, arguments.out, arguments.resume)
        with tqdm(total=study.runs, unit="run", desc=study.system, leave=False, disable=None) as bar:
            found = Results(campaign.run(study, where, bar.update))
    said = report.of(study, found, identity(study), arguments.command_line, other, checked)
    written = []
    if arguments.out is not None and arguments.only is None:
        files = said.files()
        whole_files.write_whole({arguments.out / name: content for name, content in files.items()}, folder.ADVICE)
        written = [
            f"report: {arguments.out / 'report.html'}",
            f"files: {', '.join(str(arguments.out / name) for name in files)}",
        ]
    print(json.dumps(said.to_json()) if arguments.json else "\n".join([said.text(), *written]))
    return ExitCode.BAD_VERDICT if found.failed or found.differing or found.violations else ExitCode.GOOD
