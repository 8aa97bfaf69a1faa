"""Run a system's scenario on a board, and compare every step with the integer model.

    plumb run quad --board native --open-loop --seed 7                the estimator on prescribed motion
    plumb run quad --board virtual --scenario hold --out out/hold     the loop closed on the flash image, and a report
    plumb run balancer --board virtual --live --seconds 20            armed, on its own sensors, Hall edges and bridge
    plumb run turntable --board virtual --link can --tuning attitude  over CAN
    plumb run quad --board native --tuning paper --start fast --fault stuck:gyro@60-70 --condition bandwidth_hz=20

What a system has of scenarios, tunings, start-up modes, conditions and faults: `plumb systems --system SYSTEM`.

The plant and its sensors live on this machine, raw counts go to the board in lockstep, and the board answers each step
with a digest of all its words. The board's outputs move the plant, which is asked to follow the scenario; with
--open-loop the motion is prescribed, as the estimator's figures want it. With --live the virtual board is armed and
samples by its own timer, while the plant drives its sensors and follows its actuators. `qemu` runs whole vectors: its
loop is closed with the native core, then its inputs run on QEMU. Exit code 1 when a step differs, 3 when answers were
lost.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plumb.boards import Board
    from plumb.proof.runs import Run
    from plumb.systems.contracts import Scenario
    from plumb.tuning.quantise import ControlParams


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from plumb.spec import declarations

    parser.add_argument("system", help=", ".join(declarations.names()))
    parser.add_argument("--board", required=True, metavar="B", help="native, qemu, virtual, serial:PORT or can:BUS")
    parser.add_argument("--link", choices=("serial", "can"), default="serial", help="how `virtual` is spoken to")
    parser.add_argument("--image", type=Path, help="flash image for `virtual` (default: the checkout's build)")
    parser.add_argument("--seed", type=int, default=1000, help="of every random number (default 1000)")
    parser.add_argument("--seconds", type=float, help="length (default: the scenario's own)")
    parser.add_argument("--scenario", help="a name from the system's list; a wrong one prints it")
    parser.add_argument("--tuning", help="a name from the system's list; a wrong one prints it")
    parser.add_argument("--start", metavar="MODE", help="start-up mode of the filter, instead of the tuning's own")
    parser.add_argument(
        "--condition", action="append", default=[], metavar="NAME=NUMBER", help="of the scenario; repeatable"
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND[:WHAT]@START[-STOP]",
        help="railed, stuck, noisy, silent of a sensor, a push, ...; repeatable; `plumb systems --system S` lists them",
    )
    parser.add_argument("--open-loop", action="store_true", help="prescribed motion: the outputs move nothing")
    parser.add_argument("--live", action="store_true", help="`virtual` only: its own sensors and pins, in real time")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html, summary.json and steps.csv")
    parser.add_argument("--json", action="store_true", help="print JSON")


def main(arguments: argparse.Namespace) -> int:
    from dataclasses import replace

    from plumb import systems
    from plumb.boards import open_board
    from plumb.errors import UsageError
    from plumb.physics import disturbance
    from plumb.proof import runs
    from plumb.tuning import quantise

    system = systems.load(arguments.system)
    tuning, name = arguments.tuning or system.DEFAULT_TUNING, arguments.scenario or system.DEFAULT_SCENARIO
    if tuning not in system.TUNINGS:
        raise UsageError(f"{arguments.system} has no tuning '{tuning}'; it has {', '.join(system.TUNINGS)}")
    settings = system.TUNINGS[tuning]
    if arguments.start:
        if arguments.start not in system.STARTS:
            modes = ", ".join(system.STARTS) or "none"
            raise UsageError(f"{arguments.system} has no start-up mode '{arguments.start}'; it has {modes}")
        settings, tuning = replace(settings, start=system.STARTS[arguments.start]), f"{tuning}, {arguments.start}"
    faults = system.faults([disturbance.parse(text) for text in arguments.fault])
    conditions = conditions_of(arguments.system, system.CONDITIONS, arguments.condition)
    scenario = system.scenario(name, arguments.seed, seconds=arguments.seconds, faults=faults, **conditions)
    params = quantise.quantise(systems.fitted(scenario, settings))
    closes = bool(system.OUTPUTS) and not arguments.open_loop
    if arguments.live and arguments.board != "virtual":
        raise UsageError("--live is for --board virtual: its plant drives the sensors' pins and follows the actuators'")
    if arguments.live:
        systems.load(arguments.system, "pins")
    with open_board(arguments.board, link=arguments.link, image=arguments.image) as board:
        if arguments.live:
            result = live_run(board, scenario, params, closes)
        elif not closes:
            result = runs.open_loop(board, runs.prescribed(scenario), params)
        elif arguments.board == "qemu":
            with open_board("native") as native:
                inputs = runs.closed_loop(native, scenario, params).inputs
            result = runs.open_loop(board, inputs, params)
        else:
            result = runs.closed_loop(board, scenario, params)
    summary = result.summary(
        system=arguments.system,
        scenario=name,
        tuning=tuning,
        loop="closed" if closes else "open",
        board=arguments.board,
        **({"live": True} if arguments.live else {}),
        link=arguments.link if arguments.board == "virtual" else None,
        seed=arguments.seed,
        **({"faults": arguments.fault} if arguments.fault else {}),
        **({"conditions": conditions} if conditions else {}),
    )
    if arguments.out:
        from plumb.proof import run_report

        run_report.write_run(arguments.out, result, summary)
    print(json.dumps(summary) if arguments.json else describe(summary))
    return {"pass": 0, "fail": 1, "unverified": 3}[result.verdict]


def live_run(board: Board, scenario: Scenario, params: ControlParams, closes: bool) -> Run:
    """The board paces the steps on its own sensors."""
    from plumb.boards.virtual import VirtualBoard
    from plumb.proof import live_run

    assert isinstance(board, VirtualBoard)
    return live_run.run_live(board, scenario, params, open_loop=not closes)


def conditions_of(system: str, known: Mapping[str, str], texts: Sequence[str]) -> dict[str, float]:
    """NAME=NUMBER each; raises UsageError for what is none."""
    from plumb.errors import UsageError

    found = {}
    for text in texts:
        name, _, number = text.partition("=")
        if name not in known:
            raise UsageError(f"{system} has no condition '{name}'; it has {', '.join(known) or 'none'}")
        try:
            found[name] = float(number)
        except ValueError:
            raise UsageError(f"'{text}' sets nothing; write {name}=NUMBER") from None
        if not 0.0 <= found[name] < math.inf:
            raise UsageError(f"'{text}': a number from 0 up")
    return found


def describe(summary: dict[str, object]) -> str:
    """The summary for a reader: one line a figure."""
    metrics = summary["metrics"]
    assert isinstance(metrics, dict)
    seed = "" if summary["seed"] is None else f"seed {summary['seed']}, "
    lines = [
        f"{summary['system']} {summary['scenario']}, tuning {summary['tuning']}, {summary['loop']} loop, "
        f"{seed}{summary['steps']} steps on {summary['board']}{', live' if 'live' in summary else ''}",
        *(f"  {name:<28} {'nothing to score' if value is None else f'{value:.6g}'}" for name, value in metrics.items()),
    ]
    if "first_divergence" in summary:
        lines.append(f"  first divergence: {summary['first_divergence']}")
    lines.append(str(summary["verdict"]))
    return "\n".join(lines)
