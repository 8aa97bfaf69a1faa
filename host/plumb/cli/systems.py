"""The systems this version has; with --system, everything a run of that one can be asked for by name.

    plumb systems --system quad             its scenarios, tunings, start-up modes, conditions, faults, noise
    plumb systems --table                   what the sources claim, what was to be reached, and what the integers reach
    plumb systems --table --first-seed 5000 the same on other seeds
    plumb systems --confirm virtual         the runs the table stands on, step for step the same on that board
    plumb systems --plots docs/figures      the sources' figures, drawn again

The table runs the C integers over seeds 1000 to 1039 of every scenario, some minutes for all systems; so does the
confirmation of one seed. Exit code 1 when a figure is missed or a step differs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--table", action="store_true", help="run the scenarios and print the figures")
    parser.add_argument(
        "--short", action="store_true", help="with --table: only what was asked, and what stands beside"
    )
    options.add_systems(parser, "only this system: its presets, or its figures")
    parser.add_argument(
        "--confirm", metavar="B", help="every scenario and tuning on a board, seed 1000, against native"
    )
    options.add_link_and_image(parser)
    options.add_seconds(parser, "with --confirm: at most N seconds of each run")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="write the sources' figures as DIR/SYSTEM_NAME.svg")
    parser.add_argument("--seeds", type=int, default=40, help="how many seeds (default 40)")
    parser.add_argument("--first-seed", type=int, default=1000, metavar="N", help="from which on (default 1000)")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems

    names = arguments.system or list(systems.SYSTEMS)
    for name in names:
        systems.load(name)
    if arguments.plots:
        from plumb.proof import figures

        files = [str(path) for name in names for path in figures.write_plots(name, arguments.plots)]
        said = "\n".join(files) or f"{', '.join(names)}: no figures to draw"
        print(json.dumps({"written": files}) if arguments.json else said)
        return 0
    if arguments.confirm:
        return confirm(arguments, names)
    if not arguments.table:
        if arguments.json:
            print(json.dumps({"systems": systems.SYSTEMS, "presets": {name: named(name) for name in names}}))
        elif arguments.system:
            print("\n\n".join("\n".join(presets(name)) for name in arguments.system))
        else:
            print("\n".join(f"{name}: {text}" for name, text in systems.SYSTEMS.items()))
        return 0
    from tqdm import tqdm

    from plumb.errors import ExitCode, UsageError
    from plumb.proof import figures

    if not 1 <= arguments.seeds <= 1000 or arguments.first_seed < 0:
        raise UsageError("the table takes 1 to 1000 seeds, from 0 on")
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    rows = list(tqdm(figures.compute(names, seeds), leave=False, unit="figure", disable=None))
    if arguments.json:
        table = [{"system": name, **row.to_json()} for name, row in rows]
        print(json.dumps({"figures": table, "assumed": {name: figures.assumed(name) for name in names}}))
    else:
        if rows:
            print(figures.render(rows, short=arguments.short, colour=sys.stdout.isatty()))
        for name in figures.without_figures(names):
            print(f"{name} has no figures: nothing was asked of it (systems/{name}/figures.py)")
    return ExitCode.GOOD if all(row.met for _, row in rows) else ExitCode.BAD_VERDICT


def confirm(arguments: argparse.Namespace, names: Sequence[str]) -> int:
    """A line a run, as it is ready."""
    from plumb.errors import ExitCode
    from plumb.proof import confirmed

    rows = []
    for name in names:
        with options.board_of(arguments, arguments.confirm) as board:
            for row in confirmed.confirm(board, name, seconds=arguments.seconds):
                rows.append(row)
                if not arguments.json:
                    print(row, flush=True)
    if arguments.json:
        print(json.dumps({"board": arguments.confirm, "seed": confirmed.SEED, "runs": [vars(row) for row in rows]}))
    return ExitCode.BAD_VERDICT if any(row.differ for row in rows) else ExitCode.GOOD


def named(name: str) -> dict[str, Mapping[str, str]]:
    """Everything a run of the system can be asked for: option -> name -> what it is."""
    from plumb import systems

    system = systems.load(name)
    return {
        "scenario": {key: f"{system.SECONDS[key]:g} s; {text}" for key, text in system.SCENARIOS.items()},
        "tuning": system.TUNING_NOTES,
        "start": system.START_NOTES,
        "condition": system.CONDITIONS,
        "fault": system.FAULTS,
    }


def presets(name: str) -> Iterator[str]:
    """The same for a reader, and what the figures rest on."""
    from plumb import systems
    from plumb.proof import figures

    system = systems.load(name)
    defaults = {"scenario": system.DEFAULT_SCENARIO, "tuning": system.DEFAULT_TUNING}
    titles = {
        "scenario": "scenarios (--scenario)",
        "tuning": "tunings (--tuning)",
        "start": "start-up modes (--start)",
        "condition": "conditions (--condition NAME=NUMBER)",
        "fault": "faults (--fault KIND[:WHAT]@START[-STOP])",
    }
    yield f"{name}: {systems.SYSTEMS[name]}; every {system.PERIOD_US / 1000:g} ms (* unless told otherwise)"
    for option, texts in named(name).items():
        if texts:
            yield f"{titles[option]}:"
        for key, text in texts.items():
            yield f"  {key + ('*' if key == defaults.get(option) else ''):<18}{text}".rstrip()
        if option == "fault":
            yield f"  {'WHAT':<18}{', '.join(system.FAULT_CHANNELS)}"
    if name in figures.without_figures([name]):
        yield "it has no figures: nothing was asked of it"
        return
    yield "noise and how figures are measured (seeds 0-19 to fit, 1000-1039 to report):"
    yield from (f"  {sentence}" for sentence in figures.assumed(name))
