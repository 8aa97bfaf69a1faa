"""Receive a phone's sensors over UDP, run them through a board, show pitch and roll, compare every step with the model.

    plumb phone --board native                             datagrams from this machine, port 50000
    plumb phone --board serial:/dev/ttyUSB0 --listen all   from a phone in the same network
    plumb phone --board virtual --listen all --seconds 30 --out walk

`qemu` runs whole vectors: the native core follows the phone, then QEMU runs the longest run.

Apps: SensaGram (JSON), Sensorstream IMU+GPS and Wireless IMU (CSV). SensorUDP is parsed, too, but sends no gyroscope.
Enable gyroscope and accelerometer at about 100 Hz, and enter this machine's address and the port in the app. Ends after
--seconds of the phone's time, when no datagram arrives for 5 s, or with Ctrl-C; the summary is always printed. To run a
file of --save again: plumb replay FILE --system phone.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.boards.contract import StepBoard
    from plumb.contract.parameters import ControlParams
    from plumb.judging.phone.inputs.live_run import Outcome
    from plumb.judging.phone.inputs.resampler import Step
    from plumb.proof.report import Table

DEFAULT_PORT = 50_000
LOOK_STEPS = 10
"""Steps between two updates of the terminal."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser)
    options.add_link_and_image(parser)
    parser.add_argument(
        "--udp", type=whole_number, default=DEFAULT_PORT, metavar="PORT", help=f"port (default {DEFAULT_PORT})"
    )
    parser.add_argument("--listen", default="loopback", metavar="WHERE", help="loopback (default), all, or an address")
    parser.add_argument("--tuning", default="euler", help="euler (default) or printed")
    parser.add_argument("--period-us", type=whole_number, default=10_000, help="control period (default 10000)")
    options.add_seconds(parser, "how long, by the phone's clock (default: until it stops)")
    parser.add_argument(
        "--wait", type=float, default=30.0, metavar="S", help="longest wait for the first step (default 30)"
    )
    parser.add_argument("--save", type=Path, metavar="FILE", help="write every datagram, one a line")
    options.add_out(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards import open_board
    from plumb.cli.run_summary import require_out
    from plumb.errors import ExitCode, LinkError, UsageError
    from plumb.judging.phone.inputs import live_run, udp
    from plumb.process_signals import endings, raise_ending

    options.check_duration(arguments.seconds)
    if not arguments.wait > 0:
        raise UsageError(f"--wait {arguments.wait:g}: give a number greater than 0")
    params = live_run.params_of(arguments.tuning, arguments.period_us)
    where = udp.address_of(arguments.listen)
    require_out(arguments)  # checked first: a phone's motion cannot be repeated
    screen = Screen(show=not arguments.json)
    with (
        udp.Listener(arguments.udp, where) as listener,
        contextlib.nullcontext() if arguments.save is None else udp.Saved(arguments.save) as saved,
        options.board_of(arguments) as board,
        open_board("native") as native,
        endings() as stop,
    ):
        print(f"listening on {listener.address}:{listener.port}", file=sys.stderr, flush=True)
        intake = udp.Intake(arguments.period_us, saved)
        follower = live_run.Follower(native if arguments.board.partition(":")[0] == "qemu" else board, params)
        outcome, lost = follower.outcome, False
        try:
            cut_short = live_run.follow(
                listener, intake, follower, seconds=arguments.seconds, wait_s=arguments.wait, stop=stop, saw=screen.saw
            )
        except LinkError as error:
            if not outcome.steps:
                raise
            cut_short, lost = str(error), True
        finally:
            screen.leave()
        if not outcome.steps:
            raise_ending(stop)  # anything else would have been an error
        summary = {
            "system": "phone",
            "source": f"udp:{listener.port}",
            "tuning": arguments.tuning,
            "board": arguments.board,
            "link": options.link_of(arguments),
            "steps": outcome.steps,
            "verdict": outcome.verdict,
            "mismatches": outcome.mismatches,
            "cut_short": cut_short or None,
            "received": intake.to_json(),
            **screen.last,
        }
        if outcome.divergence is not None:
            summary["first_divergence"] = outcome.divergence.as_dict()
        look_back(arguments, None if lost else board, params, outcome, summary)
    print(json.dumps(summary) if arguments.json else describe(summary))
    if summary["verdict"] == "fail":
        return ExitCode.BAD_VERDICT
    if lost or (cut_short and arguments.seconds is not None):
        raise LinkError(cut_short)
    if stop:
        raise_ending(stop)
    return 0


def look_back(
    arguments: argparse.Namespace,
    board: StepBoard | None,
    params: ControlParams,
    outcome: Outcome,
    summary: dict[str, Any],
) -> None:
    """Check the longest run on QEMU, and write the report of --out. board: None when it is gone."""
    from plumb.cli.run_summary import write
    from plumb.judging.phone.inputs.live_run import inputs_of
    from plumb.proof import runs

    on_qemu = arguments.board.partition(":")[0] == "qemu"
    if on_qemu and board is not None:
        whole = runs.open_loop(board, inputs_of(outcome.longest.steps, params), params)
    elif arguments.out:
        whole = outcome.longest.run(board, params)
    else:
        return
    heading = {"system": "phone", "scenario": summary["source"], "tuning": arguments.tuning, "loop": "open"}
    longest = whole.summary(**heading, board=arguments.board, seed=None)
    if on_qemu:
        longest["mismatches"] = whole.mismatches
        judged = ("steps", "verdict", "mismatches", "first_divergence")
        summary |= {key: longest[key] for key in judged if key in longest}
    if arguments.out:
        received = summary["received"]
        write(arguments, whole, {**longest, "received": received}, [arrived(received)])


def arrived(received: dict[str, Any]) -> Table:
    """Datagrams and samples of all runs, as a table of the report; the rest of the report is of the longest run."""
    from plumb.proof.report import Table

    rows = [[f"datagrams of {app}", str(count)] for app, count in received["apps"].items()]
    rows += [
        ["malformed", str(received["malformed"])],
        ["from another host, left out", str(received["strangers"])],
        ["of other sensors only", str(received["other"])],
        ["samples of the gyroscope, of the accelerometer", "{gyro}, {accel}".format(**received["samples"])],
        ["samples out of order, twice, too late", "{reordered}, {duplicate}, {late}".format(**received)],
        ["longest gap, bridged", f"{received['longest_gap_s']:.3f} s"],
        ["runs; the longest is shown", str(received["runs"])],
    ]
    return Table("What arrived", ["what", "how many"], rows)


class Screen:
    """Show pitch and roll: one line that is overwritten on a terminal, one line a second elsewhere."""

    def __init__(self, *, show: bool) -> None:
        self.last: dict[str, float] = {}
        self._show, self._terminal = show, sys.stdout.isatty()
        self._second = -1

    def saw(self, step: Step, words: dict[str, int]) -> None:
        turn, rate = 360.0 / 2**32, 360.0 / 2**28
        self.last = {
            "pitch_deg": round(words["pitch_turn_q32"] * turn, 4),
            "roll_deg": round(words["roll_turn_q32"] * turn, 4),
            "pitch_bias_dps": round(words["pitch_bias_turnps_q28"] * rate, 4),
            "roll_bias_dps": round(words["roll_bias_turnps_q28"] * rate, 4),
        }
        second = int(step.time_s + 1e-6)
        if not self._show or (words["step"] % LOOK_STEPS if self._terminal else second == self._second):
            return
        self._second = second
        angles = "  ".join(f"{axis} {self.last[f'{axis}_deg']:+z8.2f} deg" for axis in ("pitch", "roll"))
        biases = ", ".join(f"{self.last[f'{axis}_bias_dps']:+z.3f}" for axis in ("pitch", "roll"))
        line = f"{step.time_s:8.2f} s  {angles}  bias {biases} deg/s"
        line += "  too steep to determine roll" if words["flags"] & 4 else ""
        print(f"\r{line}\x1b[K" if self._terminal else line, end="" if self._terminal else "\n", flush=True)

    def leave(self) -> None:
        """End the line on the terminal, so that further output begins a new one."""
        if self._show and self._terminal and self.last:
            print()


def describe(summary: dict[str, Any]) -> str:
    """The summary as text."""
    received = summary["received"]
    samples = received["samples"]
    apps = ", ".join(f"{count} of {app}" for app, count in received["apps"].items())
    lines = [
        f"phone at {summary['source']}: {summary['steps']} steps on {summary['board']}, runs {received['runs']}",
        f"  datagrams {received['datagrams']}: {apps or 'none known'}; malformed {received['malformed']}, "
        f"from elsewhere {received['strangers']}",
        f"  samples: gyro {samples['gyro']}, accelerometer {samples['accel']}; reordered {received['reordered']}, "
        f"doubled {received['duplicate']}, too late {received['late']}; longest gap {received['longest_gap_s']:.3f} s",
    ]
    if "first_divergence" in summary:
        lines.append(f"  first divergence: {summary['first_divergence']}")
    if summary["cut_short"]:
        lines.append(f"  {summary['cut_short']}")
    return "\n".join([*lines, str(summary["verdict"])])
