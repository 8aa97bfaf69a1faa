"""Run a system's scenario on a board, and compare every step with the integer model.

    plumb run quad --board native --open-loop --seed 7                the estimator on prescribed motion
    plumb run quad --board virtual --scenario hold --out out/hold     the loop closed on the flash image, and a report
    plumb run balancer --board virtual --live --seconds 20            armed, on its own sensors, Hall edges and bridge
    plumb run quad --board virtual --live --change 2:pid.kp=0.06      gains changed on the way, armed
    plumb run turntable --board virtual --link can --tuning attitude  over CAN
    plumb run quad --board virtual --live --gdb 3333                  stop, step and look into it with gdb
    plumb run quad --board native --tuning paper --start fast --fault stuck:gyro@60-70 --condition bandwidth_hz=20

`plumb systems --system SYSTEM` lists the scenarios, tunings, start-up modes, conditions and faults of a system.

Plant and sensors are simulated on this machine; raw counts go to the board in lockstep, and the board answers each step
with a digest of all its signals. The outputs of the board move the plant, and the setpoints follow the scenario. With
--open-loop the motion is prescribed, as for the figures of the estimators. With --live the virtual board is armed and
samples by its own timer, while the plant drives its sensors and follows its actuators. `qemu` runs whole vectors: the
native core closes the loop, then QEMU runs the same inputs. Exit code 1 when a step differs, 3 when answers were lost.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.proof.scenario_run import RunRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_system_argument(parser)
    options.add_board(parser)
    options.add_link_and_image(parser)
    options.add_gdb(parser, options.GDB_FIRST, of_virtual=True)
    options.add_seed(parser)
    options.add_seconds(parser, "length (default: the scenario's own)")
    options.add_scenario(parser)
    options.add_tuning(parser)
    parser.add_argument("--start", metavar="MODE", help="start-up mode of the filter, instead of the tuning's own")
    options.add_conditions(parser, "condition of the scenario")
    options.add_faults(
        parser,
        "railed, stuck, noisy, silent of a sensor, a push, ...; repeatable; `plumb systems --system S` lists them",
    )
    options.add_open_loop(parser)
    parser.add_argument("--live", action="store_true", help="`virtual` only: its own sensors and pins, in real time")
    parser.add_argument(
        "--change",
        action="append",
        default=[],
        metavar="SECONDS:NAME=VALUE",
        help="--live only: a gain that changes on the way, while the board is armed, as 3:pid.kp=0.06; repeatable",
    )
    options.add_out(parser)
    options.add_json(parser)


def check(arguments: argparse.Namespace) -> None:
    """Checks that do not depend on the board. Raises UsageError."""
    from plumb.proof import scenario_run

    scenario_run.check(_request(arguments))


def _request(arguments: argparse.Namespace) -> RunRequest:
    from plumb.proof.scenario_run import RunRequest

    return RunRequest(
        system=arguments.system,
        board=arguments.board,
        scenario=arguments.scenario,
        tuning=arguments.tuning,
        start=arguments.start,
        seed=arguments.seed,
        seconds=arguments.seconds,
        faults=arguments.fault,
        conditions=arguments.condition,
        open_loop=arguments.open_loop,
        live=arguments.live,
        changes=arguments.change,
        link=arguments.link,
        image=arguments.image,
    )


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards.debugging import debugged
    from plumb.cli.run_summary import report, require_out
    from plumb.proof.scenario_run import perform

    require_out(arguments)
    with debugged(arguments.gdb, waits=True):
        done = perform(_request(arguments))
    return report(arguments, done.run, done.summary(), more=done.statements())
