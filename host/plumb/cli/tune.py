"""Find settings from measurements: sensor noise at rest, Q and R of the filter, gains of the PID, a vehicle's drag.

    plumb tune noise rest.npz --out out/noise          Allan deviation, noise figures, and Q and R of quad
    plumb tune noise today.plog --system balancer      a log of `plumb record --run live`
    plumb tune noise walk.csv --axis y --begin 2 --end 40
    plumb tune filter walk.npz --out out/filter        Q and R that describe the whole recording best
    plumb tune filter today.plog --tuning constant
    plumb tune pid --board native --out out/pid        test quad's loop with its plant, and gains with margins
    plumb tune pid --board native --test step --phase-deg 40
    plumb tune pid --board native --system quadrotor --loop pitch --phase-deg 45 --gain-db 8 --delay-ms 30
    plumb tune pid --board native --system wheels --phase-deg 30 --delay-ms 20             its turn rate
    plumb tune pid flight.plog --loop roll --phase-deg 45 --out out/roll        a vehicle that you have flown
    plumb tune pid --board serial:/dev/ttyUSB0 --arm-and-move
    plumb tune vehicle flight.plog                     thrust of a hover and drag of a vehicle that you have flown
    plumb tune vehicle flight.plog --write --board serial:/dev/ttyUSB0

RECORDING is .npz or .csv as for `plumb replay`, or a log of `plumb record`. No command but `vehicle --write` changes
the parameters of a board; the line that sets the settings is printed.

`noise` takes the longest rest of the recording. The sensor lies still for some minutes; the longer, the better bias
instability and random walk are known. It prints white noise, bias instability and random walk with their confidence,
and the Q and R of the system's tuning that follow from them.

`filter` runs the filter of the system over the recording, and finds the Q and R that make its innovations most likely.
It prints settings with confidence, and how consistent the filter is before and after: NIS, whiteness, and, where the
recording has a reference, the tilt error. Exit code 1 when the settings are of no use: they make the tilt error larger,
or the board cannot hold them.

`pid` excites the setpoint of a closed attitude loop by a sum of sines, or by steps up and down every 2 s (--test
step), fits a plant with lag and delay to the tilt rate, and works out gains with the wanted margins of phase, gain and
delay. On `native` and `virtual` the system's plant is simulated, and the test is repeated with the new gains. On a
board behind a link the test arms the board and moves the machine: only with --arm-and-move.
On a vehicle with a receiver, `pid` excites the stick of one loop (--loop), in simulation only; the page of the system
says which loops the margins belong to. A real vehicle is never armed for a test: fly it by its receiver and record with
`plumb record --run live`, or fly with `plumb fly`, and give the log. One minute is enough in which the stick of the
axis moves without a pause, level and gently. Exit code 1 when no gains have the margins.

`vehicle` takes the log of a flight to and fro, by 15 to 30 deg for a minute, in mode level. It prints the thrust
command of a hover and the drag by mass and speed, each with its interval of 95 %, and the offsets of the accelerometer
where the flight determines them. A flight that only hovers does not determine the drag, and is refused.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options, tune_vehicle
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.analyses.identification.loop_test import LoopRun
    from plumb.analyses.identification.pid_design import Wanted
    from plumb.boards.contract import StepBoard
    from plumb.contract.parameters import ControlParams
    from plumb.proof.report import Plot, Table
    from plumb.proof.xy_plot import XyPlot

FILES = ("report.html", "tune.json")
"""Files that --out writes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="action", required=True, metavar="noise|filter|pid|vehicle")
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
    add_pid(verbs.add_parser("pid", help="gains of the PID from a test of the loop"))
    flown = verbs.add_parser("vehicle", help="thrust of a hover and drag of a vehicle from a flight")
    tune_vehicle.add_arguments(flown)
    add_output(flown)


def add_pid(pid: argparse.ArgumentParser) -> None:
    pid.add_argument(
        "recording", type=Path, nargs="?", metavar="LOG", help="log of a flight, or of a run whose setpoint moved"
    )
    pid.add_argument("--board", metavar="B", help=f"native, {options.LINKED_BOARD}; or give a LOG")
    options.add_link_and_image(pid)
    options.add_system(pid, "simulated system (default: that of `plumb demo`)")
    options.add_tuning(pid)
    pid.add_argument(
        "--loop",
        metavar="AXIS",
        help="which loop of the system (default: its first; another name is answered with those that it has)",
    )
    pid.add_argument(
        "--period-us", type=whole_number, metavar="US", help="period of the simulated system (default: its own)"
    )
    options.add_seed(pid, "the plant")
    pid.add_argument("--live", action="store_true", help="`virtual` samples its own sensors, armed, as a machine does")
    pid.add_argument(
        "--arm-and-move",
        action="store_true",
        help="arm a real board and swing its machine; it is fixed so that it turns about its axis alone, and you hold "
        "the power switch",
    )
    pid.add_argument(
        "--test", choices=("sines", "step"), default="sines", help="signal of the setpoint (default sines)"
    )
    pid.add_argument(
        "--amplitude",
        type=float,
        default=8.0,
        metavar="DEG",
        help="largest setpoint; of turn in deg/s (default 8)",
    )
    pid.add_argument(
        "--periods", type=whole_number, default=8, help="repetitions of the test signal, 4 s each (default 8)"
    )
    pid.add_argument("--phase-deg", type=float, default=35.0, help="least phase margin (default 35)")
    pid.add_argument("--gain-db", type=float, default=6.0, help="least gain margin, both ways (default 6)")
    pid.add_argument("--delay-ms", type=float, default=0.0, help="least further delay (default 0: as it comes)")
    add_output(pid)


def add_target(parser: argparse.ArgumentParser, about: str) -> None:
    options.add_system(parser, f"system {about}")
    options.add_tuning(parser)
    axis = "axis of a three-axis recording, for systems with one axis (default x)"
    parser.add_argument("--axis", choices=("x", "y", "z"), default="x", help=axis)
    parser.add_argument(
        "--period-us", type=whole_number, metavar="US", help="period of the system's steps (default: its own)"
    )


def add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html and DIR/tune.json")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import ExitCode

    require_scipy()
    if arguments.out:  # before a machine moves for it
        require_writable(arguments.out)
    good = {"noise": tune_noise, "filter": tune_filter, "pid": tune_pid, "vehicle": tune_flown_vehicle}[
        arguments.action
    ](arguments)
    return ExitCode.GOOD if good else ExitCode.BAD_VERDICT


def require_scipy() -> None:
    """Raises UsageError where scipy is missing or broken: it is loaded before a machine moves for it."""
    from importlib.util import find_spec

    from plumb.errors import UsageError
    from plumb.extras import install_hint

    if find_spec("scipy") is None:
        raise UsageError(f"plumb tune needs scipy; install it {install_hint('tune')}")
    try:
        import scipy.optimize  # noqa: F401
        import scipy.stats  # noqa: F401
    except Exception as error:  # a wheel of another Python or numpy fails with whatever its first import raises
        what = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise UsageError(f"scipy is there but does not load ({what}); install it anew {install_hint('tune')}") from None


def require_writable(folder: Path) -> None:
    from plumb.files import whole_files

    for name in FILES:
        whole_files.require_writable(folder / name, "choose another folder with --out")


def tune_noise(arguments: argparse.Namespace) -> bool:
    """Whether the board can hold what was found."""
    from plumb import systems
    from plumb.analyses.identification import noise, noise_page, rest

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
    document = noise_page.to_json(used, found, settings)
    tables = [*noise_page.noise_tables(found), *noise_page.settings_tables(settings)]
    plots = noise_page.plots(used, found) if arguments.out else []
    give(arguments, "Noise of the sensors", noise_page.heading(used), tables, plots, document)
    return not settings.refusal


def tune_filter(arguments: argparse.Namespace) -> bool:
    """Whether the settings are of use."""
    from tqdm import tqdm

    from plumb import systems
    from plumb.analyses.identification import filter_inputs, filter_page, likelihood, rest

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
    tables, document = filter_page.tables(inputs, fit), filter_page.to_json(inputs, fit)
    give(arguments, "Filter, tuned by its innovations", lead, tables, plots, document)
    return filter_page.useful(inputs, fit)


def tune_pid(arguments: argparse.Namespace) -> bool:
    """Whether there are gains with the wanted margins."""
    from dataclasses import replace

    from plumb.analyses.identification import pid_page, pid_tuning
    from plumb.contract.parameters import quantise
    from plumb.errors import UsageError

    wanted = wanted_of(arguments)
    if arguments.recording is not None:
        return tune_flown(arguments, wanted)
    if arguments.board is None:
        raise UsageError(f"give --board native, {options.LINKED_BOARD}, or the log of a flight")
    simulated = arguments.board in ("native", "virtual")
    if not simulated:
        require_consent(arguments)
    with options.board_of(arguments) as board:
        run = simulated_test(arguments, board) if simulated else machine_test(arguments, board)
        tuning = pid_tuning.tune(run, wanted)
        again = None
        if simulated and not tuning.refusal():
            second = simulated_test(arguments, board, quantise(replace(tuning.tuned, exact_period_s=None)))
            again = pid_tuning.tune(second, wanted, design=False)
    for sentence in pid_page.warnings(tuning):
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    period_ms, held = 1e-3 * tuning.tuning.period_us, tuning.tested.held
    swing = f"{arguments.amplitude:g} {held.unit}, {arguments.periods} periods"
    lead = f"{tuning.tuning.system} on {arguments.board}, steps of {period_ms:g} ms; setpoint swung by {swing}."
    plots = pid_page.plots(tuning, again) if arguments.out else []
    give(
        arguments,
        "Loop, tested and tuned",
        lead,
        pid_page.tables(tuning, again),
        plots,
        pid_page.to_json(tuning, again),
    )
    return not tuning.refusal()


def tune_flown(arguments: argparse.Namespace, wanted: Wanted) -> bool:
    """Whether there are gains with the wanted margins for the loop in a log."""
    from plumb.analyses.identification import flown_loop, pid_page, pid_tuning
    from plumb.errors import UsageError

    own = (arguments.board, arguments.system, arguments.tuning, arguments.period_us, arguments.image)
    if any(one is not None for one in own) or arguments.live or arguments.arm_and_move:
        raise UsageError("a log has its board, parameters and period: with a LOG give --loop, margins and --out alone")
    run = flown_loop.of_log(arguments.recording, arguments.loop)
    tuning = pid_tuning.tune(run, wanted)
    for sentence in pid_page.warnings(tuning):
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    period_ms, used = 1e-3 * tuning.tuning.period_us, f"{len(run.windows)} windows of {flown_loop.WINDOW_S:g} s"
    lead = f"{tuning.tuning.system} in {arguments.recording.name}, steps of {period_ms:g} ms; {used}."
    plots, document = pid_page.plots(tuning, None) if arguments.out else [], pid_page.to_json(tuning, None)
    give(arguments, "Loop, flown and tuned", lead, pid_page.tables(tuning, None), plots, document)
    return not tuning.refusal()


def tune_flown_vehicle(arguments: argparse.Namespace) -> bool:
    """True; raises UsageError for a flight that determines too little."""
    settings, lead, tables, document = tune_vehicle.found(arguments)
    give(arguments, "Vehicle, from a flight", lead, tables, [], document)
    if arguments.write:
        tune_vehicle.write(arguments, settings)
    return True


def wanted_of(arguments: argparse.Namespace) -> Wanted:
    """The wanted margins; raises UsageError for numbers that make no sense."""
    from plumb.analyses.identification.pid_design import Wanted
    from plumb.errors import UsageError

    for name, low, high in (
        ("amplitude", 0.1, 20.0),
        ("periods", 3, 100),
        ("phase_deg", 5.0, 80.0),
        ("gain_db", 1.0, 20.0),
        ("delay_ms", 0.0, 500.0),
    ):
        value = getattr(arguments, name)
        if not low <= value <= high:
            raise UsageError(f"--{name.replace('_', '-')} {value:g}: give {low:g} to {high:g}")
    return Wanted(arguments.phase_deg, arguments.gain_db, 1e-3 * arguments.delay_ms)


def require_consent(arguments: argparse.Namespace) -> None:
    """Raises UsageError unless the user has said that a real machine may move."""
    from plumb.analyses.identification.loop_test import BOARD_SETTLE_S
    from plumb.analyses.identification.plant_fit import REPEAT_S
    from plumb.errors import UsageError

    if arguments.system or arguments.tuning or arguments.period_us or arguments.live or arguments.loop:
        raise UsageError(
            "--system, --tuning, --period-us, --live and --loop are for native and virtual; a board is tested as it is"
        )
    if not arguments.arm_and_move:
        seconds = BOARD_SETTLE_S + (arguments.periods + 1) * REPEAT_S
        raise UsageError(
            f"this arms the board and swings the machine by {arguments.amplitude:g} deg for {seconds:g} s: fix it so "
            "that it turns about its axis alone, hold the power switch, and say --arm-and-move"
        )


def simulated_test(arguments: argparse.Namespace, board: StepBoard, params: ControlParams | None = None) -> LoopRun:
    """The test on the system's plant. params: None for those of --tuning."""
    from dataclasses import replace

    from plumb import systems
    from plumb.analyses.identification import chosen_settings, loop_test, plant_fit, tested_loop
    from plumb.boards.link import LinkBoard
    from plumb.contract.parameters import quantise
    from plumb.contract.scenario import tuning_for
    from plumb.errors import UsageError

    if arguments.live and arguments.board != "virtual":
        raise UsageError("--live is for --board virtual: its plant is on the pins of the simulated chip")
    if params is None:
        system = arguments.system or systems.default_for("demo")
        named = arguments.tuning or tuning_for(systems.load(system), tested_loop.SCENARIO)
        tuning = chosen_settings.named_tuning(system, named)[1]
        if arguments.period_us is not None:
            tuning = replace(tuning, period_us=arguments.period_us)
        params = quantise(tuning)
    settings = tested_loop.loop_of(params, arguments.loop)
    excited = plant_fit.excitation(settings.tuning.period_s, arguments.amplitude, arguments.test)
    if not arguments.live:
        return loop_test.on_twin(board, params, excited, arguments.periods, arguments.seed, arguments.loop)
    assert isinstance(board, LinkBoard)
    loop_test.attach_plant(board, params, excited, arguments.periods, arguments.seed)
    return loop_test.on_link(board, params, excited, arguments.periods, settings.settle_s)


def machine_test(arguments: argparse.Namespace, board: StepBoard) -> LoopRun:
    """The test on a real board, with the parameters that it has."""
    from plumb.analyses.identification import loop_test, plant_fit
    from plumb.boards.link import LinkBoard
    from plumb.errors import UsageError
    from plumb.link import parameter_table
    from plumb.spec.parameter_file import by_name
    from plumb.tuning.quantities import control_of

    if not isinstance(board, LinkBoard):
        raise UsageError(f"{arguments.board} closes no loop: give native, {options.LINKED_BOARD}")
    params = control_of(by_name(parameter_table.read_table(board.session)))
    excited = plant_fit.excitation(loop_test.linked_loop(params).tuning.period_s, arguments.amplitude, arguments.test)
    return loop_test.on_link(board, params, excited, arguments.periods, loop_test.BOARD_SETTLE_S)


def give(
    arguments: argparse.Namespace,
    title: str,
    lead: str,
    tables: Sequence[Table],
    plots: Sequence[XyPlot | Plot],
    document: dict[str, object],
) -> None:
    """Print the tables or the JSON; with --out write report.html and tune.json."""
    from plumb.proof import report, table_text

    if arguments.out:
        html = report.page(title, "", lead, [*plots, *tables])
        report.write_whole(arguments.out, dict(zip(FILES, (html, json.dumps(document, indent=1) + "\n"), strict=True)))
    print(json.dumps(document) if arguments.json else f"{lead}\n\n{table_text.text(tables)}")
    if arguments.out and not arguments.json:
        print(f"\nreport: {arguments.out / FILES[0]}")
