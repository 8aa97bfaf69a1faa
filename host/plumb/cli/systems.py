"""List the systems of this version; with --system, the scenarios, tunings, start-up modes and faults of one.

    plumb systems --system quad             its scenarios, tunings, start-up modes, conditions, faults, noise
    plumb systems --table                   published figures, targets, and the figures that the integers reach
    plumb systems --table --first-seed 5000 the same with other seeds
    plumb systems --confirm virtual         run the table's scenarios on that board: every step must be identical
    plumb systems --plots docs/figures      draw the sources' figures with the integers

The table runs the C integers over seeds 1000 to 1039 of every scenario, which takes some minutes for all systems; so
does --confirm, with one seed. Exit code 1 when a figure is missed or a step differs; with other seeds a scenario's own
figure (~) is shown and not judged, because other seeds make it another one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

DEFAULT_SEEDS, DEFAULT_FIRST_SEED = 40, 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--table", action="store_true", help="run the scenarios and print the figures")
    parser.add_argument("--short", action="store_true", help="with --table: only the main figures of each system")
    options.add_systems(parser, "only this system: its presets, or its figures")
    parser.add_argument(
        "--confirm", metavar="B", help="run every scenario and tuning on a board, seed 1000, and compare with native"
    )
    options.add_link_and_image(parser)
    options.add_seconds(parser, "with --confirm: at most N seconds of each run")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="write the sources' figures as DIR/SYSTEM_NAME.svg")
    parser.add_argument("--seeds", type=whole_number, help=f"with --table: number of seeds (default {DEFAULT_SEEDS})")
    about = f"with --table: first seed (default {DEFAULT_FIRST_SEED})"
    parser.add_argument("--first-seed", type=whole_number, metavar="N", help=about)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems

    names = arguments.system or list(systems.SYSTEMS)
    for name in names:
        systems.load(name)
    check_together(arguments)
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

    from plumb.errors import ExitCode
    from plumb.proof import figures

    first = DEFAULT_FIRST_SEED if arguments.first_seed is None else arguments.first_seed
    seeds = range(first, first + (DEFAULT_SEEDS if arguments.seeds is None else arguments.seeds))
    rows = list(tqdm(figures.compute(names, seeds), leave=False, unit="figure", disable=None))
    if arguments.json:
        table = [{"system": name, **row.to_json()} for name, row in rows]
        print(json.dumps({"figures": table, "assumed": {name: figures.assumed(name) for name in names}}))
    else:
        if rows:
            print(figures.render(rows, short=arguments.short, colour=sys.stdout.isatty()))
        for name in figures.without_figures(names):
            print(f"no target figures are declared for {name} (judging/{name}/figures.py)")
    judged = [row for _, row in rows if seeds == figures.SEEDS or not row.of_scenario]
    return ExitCode.GOOD if all(row.met for row in judged) else ExitCode.BAD_VERDICT


def check_together(arguments: argparse.Namespace) -> None:
    """Raises UsageError for an option that the chosen work would ignore."""
    from plumb.errors import UsageError

    options.check_of_virtual(arguments, *([arguments.confirm] if arguments.confirm else []))
    if len([work for work in (arguments.plots, arguments.confirm, arguments.table) if work]) > 1:
        raise UsageError("give one of --table, --confirm and --plots")
    of_table = {"--short": arguments.short or None, "--seeds": arguments.seeds, "--first-seed": arguments.first_seed}
    for option, value in of_table.items():
        if value is not None and not arguments.table:
            raise UsageError(f"{option} is for --table")
    if arguments.seconds is not None and not arguments.confirm:
        raise UsageError("--seconds is for --confirm")
    if (arguments.seeds is not None and not 1 <= arguments.seeds <= 1000) or (arguments.first_seed or 0) < 0:
        raise UsageError("the table takes 1 to 1000 seeds, from 0 on")


def confirm(arguments: argparse.Namespace, names: Sequence[str]) -> int:
    """Run everything on the board; prints a line when a run is done. Returns the exit code."""
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
    """The presets of a system: option -> name -> description."""
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
    """The presets of a system as text, and the assumptions of its figures."""
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
    yield f"{name}: {systems.SYSTEMS[name]}; every {system.PERIOD_US / 1000:g} ms (* marks the default)"
    for option, texts in named(name).items():
        if texts:
            yield f"{titles[option]}:"
        for key, text in texts.items():
            yield f"  {key + ('*' if key == defaults.get(option) else ''):<18}{text}".rstrip()
        if option == "fault" and system.FAULT_CHANNELS:
            yield f"  {'WHAT':<18}{', '.join(system.FAULT_CHANNELS)}"
    if name in figures.without_figures([name]):
        yield "no target figures are declared for this system"
        return
    yield "noise and how figures are measured (seeds 0-19 to fit, 1000-1039 to report):"
    yield from (f"  {sentence}" for sentence in figures.assumed(name))
