"""Forward frames between a sensor board on one bus and the STM32 on another, and count and check them.

    plumb bridge tcp:127.0.0.1:4100 serial:/dev/ttyUSB0 --system quad --shadow
    plumb bridge can:socketcan:can0 tcp:127.0.0.1:4000 --system quad --arm --seconds 60
    plumb bridge can:socketcan:can0 can:socketcan:can0 --shadow   both on one bus: frames are watched, not forwarded
    plumb bridge can:socketcan:can0 serial:/dev/ttyUSB0 --direct  the sensor board is on the STM32's own CAN bus
    plumb bridge serial:/dev/pts/3 tcp:127.0.0.1:4000 --carry     forward frames only, both ways
    plumb bridge tcp:127.0.0.1:4100 serial:/dev/ttyUSB0 --serve socketcand:4003     and show all frames to other tools
    plumb bridge serial:/dev/ttyUSB0 --mavlink udp:127.0.0.1:14550     show one board to a ground station; --run live
                                                                       begins a run there, unarmed

The first BUS is that of the sensor board, the second that of the STM32. The bridge uploads the system's parameters,
begins a run on injected samples with the first sample, ends it (which disarms) when samples stop, and begins a new one
when either side is back. --arm arms the first run; after a disarm the bridge does not arm again. --shadow runs the
integer model in parallel with the board and stops at the first bit that differs.

With --direct, samples and setpoints reach the STM32 over its own CAN bus. The bridge owns the run over another link;
the run names CAN as their source, and the STM32 accepts them from CAN only.

--serve shows the frames of both sides to loggers and analysers: on slcan:pty or slcan:tcp:PORT to one, on
socketcand:PORT to several, or on any bus of python-can, INTERFACE:CHANNEL. They only listen: what they send is
discarded.

--mavlink sends what one board says as MAVLink 2 (extra `mavlink`): HEARTBEAT and SYS_STATUS once a second, ATTITUDE and
RC_CHANNELS ten times. The link is read-only, as that of `plumb monitor`, and what a ground station sends is never read.
The heading is that of the system's own estimate; a system without one sends 0. --tlog FILE keeps what was sent.

The summary has a histogram of the latency of each direction, from the arrival of a frame here to the end of its write
on the other side, by the clock of this computer; in --json the buckets, too.

--seconds counts from the begin of the first run, or from the start while there is none.

Exit codes: 1 a bit differed; 3 no run began, a bus never opened, or --shadow verified nothing; 130 Ctrl-C.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shutil
import signal
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NotRequired, TypedDict

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.bridge.bridge import Bridge
    from plumb.bridge.bus_end import End
    from plumb.bridge.bus_tap import BusTap
    from plumb.bridge.frame_counts import Flow
    from plumb.bridge.latency import LatencyHistogram, Percentiles
    from plumb.contract.parameters import ControlParams


Side = Literal["sensor", "board", "first", "second"]
SIDES: tuple[Side, ...] = ("sensor", "board", "first", "second")


class FlowCounts(TypedDict):
    """Counters of one side of the bridge. trouble: its last failure; board_...: increments of the STM32's counters."""

    frames: int
    lost: int
    rejected: int
    foreign: int
    opened: int
    trouble: NotRequired[str]
    board_rejected: NotRequired[int]
    board_lost: NotRequired[int]
    board_dropped: NotRequired[int]


class Summary(TypedDict, total=False):
    """The output of `bridge --json`. first, second: with --carry, instead of everything from runs to board."""

    runs: int
    steps: int
    starved: int
    skipped_samples: int
    unused_samples: int
    latency_ms: dict[str, float] | None
    latency: dict[str, Percentiles]
    sensor: FlowCounts
    board: FlowCounts
    first: FlowCounts
    second: FlowCounts
    verdict: str
    verified_steps: int
    unverified_runs: int
    first_divergence: dict[str, object]
    unverified_from_step: int
    unverified_why: str
    parameters_changed_at_steps: list[int]
    seconds: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sensor", metavar="BUS", help=f"bus of the sensor board: {options.BUS}")
    parser.add_argument("board", metavar="BUS", nargs="?", help="bus of the STM32: the same")
    options.add_system(parser, "system whose parameters are uploaded (default: the board's)")
    options.add_tuning(parser)
    parser.add_argument("--keep-parameters", action="store_true", help="run with the board's parameters")
    parser.add_argument("--arm", action="store_true", help="arm the first run: the outputs move")
    parser.add_argument("--shadow", action="store_true", help="compare every step with the model, stop at a difference")
    parser.add_argument(
        "--direct", action="store_true", help="the sensor board is on the STM32's CAN bus: samples are not forwarded"
    )
    parser.add_argument("--serve", metavar="BUS", help="show the frames of both sides on this bus")
    parser.add_argument("--carry", action="store_true", help="forward frames only: another host owns the run")
    parser.add_argument("--mavlink", metavar="udp:HOST:PORT", help="send what one board says to a ground station")
    parser.add_argument("--run", choices=("live",), help="with --mavlink: begin a run on its own sensors, unarmed")
    parser.add_argument("--tlog", type=Path, metavar="FILE", help="with --mavlink: also write what is sent to a file")
    options.add_duration(parser)
    options.add_json(parser, " at the end")


def main(arguments: argparse.Namespace) -> int:
    if arguments.mavlink is not None:
        from plumb.cli import bridge_mavlink

        return bridge_mavlink.main(arguments)
    from plumb.errors import ExitCode, UsageError, exit_code_of
    from plumb.link.endpoint_names import CanName, parse_bus, parse_can_end
    from plumb.process_signals import endings

    for option in ("run", "tlog"):
        if getattr(arguments, option) is not None:
            raise UsageError(f"--{option} is for --mavlink")
    if arguments.board is None:
        raise UsageError("name two buses: that of the sensor board, and that of the STM32")
    on_can = [isinstance(parse_bus(spec), CanName) for spec in (arguments.sensor, arguments.board)]
    options.check_duration(arguments.seconds)
    if arguments.carry and (arguments.shadow or arguments.arm):
        raise UsageError("--carry only forwards frames: leave out --shadow and --arm, or --carry")
    if arguments.direct and (arguments.carry or not on_can[0]):
        raise UsageError("--direct is for a sensor board on the STM32's CAN bus: name that bus first, without --carry")
    if arguments.sensor == arguments.board and (arguments.carry or not on_can[1]):
        raise UsageError(f"{arguments.board} is given twice: sensor board and STM32 can only share a CAN bus")
    if arguments.serve:
        parse_can_end(arguments.serve)
        if f"can:{arguments.serve}" in (arguments.sensor, arguments.board):
            raise UsageError(f"--serve {arguments.serve} is a bus of the bridge itself: name another one")
    with endings() as caught, tapped(arguments) as tap:
        ending = Ending(arguments.seconds, caught, tap)
        summary = (carried if arguments.carry else bridged)(arguments, ending, tap)
        summary["seconds"] = round(ending.passed_s, 3)
    print(json.dumps(summary) if arguments.json else describe(summary))
    if signal.SIGINT in caught:
        raise KeyboardInterrupt
    carried_by = [summary[side] for side in SIDES[2:] if side in summary]
    idle = summary.get("runs") == 0 or any(side["opened"] == 0 for side in carried_by)
    if summary.get("verdict") in ("fail", "unverified"):
        return exit_code_of(summary["verdict"])
    return ExitCode.LINK_TROUBLE if idle else ExitCode.GOOD


class Ending:
    """Whether the bridge is to end: signalled, or after --seconds. They count from the first call, because loading and
    quantising take a while, and anew from the first run of `bridge`: on a busy computer the way there may take as
    long as was asked for, and nothing would be verified."""

    def __init__(self, seconds: float | None, caught: Collection[int], tap: BusTap | None) -> None:
        self.bridge: Bridge | None = None
        self._seconds, self._caught, self._tap = seconds, caught, tap
        self._begin_s: float | None = None
        self._begun = False

    @property
    def passed_s(self) -> float:
        return 0.0 if self._begin_s is None else time.monotonic() - self._begin_s

    def __call__(self) -> bool:
        begins = self.bridge is not None and self.bridge.runs > 0 and not self._begun
        if self._begin_s is None or begins:
            self._begin_s, self._begun = time.monotonic(), begins
        if self._tap is not None:
            self._tap.serve()
        return bool(self._caught) or (self._seconds is not None and self.passed_s >= self._seconds)


def say(text: str) -> None:
    over = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{over}plumb: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def tapped(arguments: argparse.Namespace) -> Iterator[BusTap | None]:
    """The bus of --serve, and where it is printed."""
    if not arguments.serve:
        yield None
        return
    from plumb.boards.serve import address_of, open_can_end
    from plumb.bridge.bus_tap import BusTap

    with open_can_end(arguments.serve) as bus:
        say(f"serving the frames of both sides at {address_of(bus, arguments.serve)}")
        yield BusTap(bus, say)


def carried(arguments: argparse.Namespace, ending: Ending, tap: BusTap | None) -> Summary:
    from plumb.bridge.bus_end import End, carry
    from plumb.bridge.latency import LatencyHistogram

    ends = [End(arguments.sensor), End(arguments.board)]
    there, back = latencies = LatencyHistogram(), LatencyHistogram()
    stopped: Callable[[], bool] = ending
    if sys.stderr.isatty():
        stopped = watched(lambda: (ends[0].flow.frames, ends[1].flow.frames), {"there": there, "back": back}, stopped)
    for one in ends:
        one.start()
    try:
        carry(ends[0], ends[1], stopped, say, tap.send if tap else lambda frames: None, latencies)
    finally:
        for one in ends:
            one.stop()
    return {
        "first": flow(ends[0].flow, ends[0]),
        "second": flow(ends[1].flow, ends[1]),
        "latency": {"first to second": there.as_dict(), "second to first": back.as_dict()},
    }


def bridged(arguments: argparse.Namespace, ending: Ending, tap: BusTap | None) -> Summary:
    from plumb import systems
    from plumb.bridge.bridge import Bridge
    from plumb.contract.parameters import quantise
    from plumb.errors import UsageError

    def params_of(name: str) -> tuple[ControlParams, dict[str, int]]:
        system = systems.load(name)
        tuning = arguments.tuning or system.DEFAULT_TUNING
        if tuning not in system.TUNINGS:
            raise UsageError(f"{name} has no tuning '{tuning}'; it has {', '.join(system.TUNINGS)}")
        settings = system.TUNINGS[tuning]
        return quantise(settings), {"period_us": settings.period_us, **system.LINK}

    params, link = params_of(arguments.system) if arguments.system else (None, {})
    bridge = Bridge(
        arguments.sensor,
        arguments.board,
        None if arguments.keep_parameters else params,
        (),
        link,
        arm=arguments.arm,
        shadow=arguments.shadow,
        direct=arguments.direct,
        params_of=None if arguments.keep_parameters else params_of,
        say=say,
        tap=tap.send if tap else lambda frames: None,
    )
    ending.bridge = bridge
    stopped: Callable[[], bool] = ending
    if sys.stderr.isatty():
        latencies = {"down": bridge.down, "up": bridge.up, "to the step": bridge.sample_to_step}
        stopped = watched(lambda: (bridge.sensor.flow.frames, bridge.board.frames), latencies, stopped, bridge)
    bridge.run(stopped)
    return summary_of(bridge)


def watched(
    frames: Callable[[], tuple[int, int]],
    latencies: Mapping[str, LatencyHistogram],
    stopped: Callable[[], bool],
    bridge: Bridge | None = None,
) -> Callable[[], bool]:
    """`stopped` that also prints the counts and the latencies (median/99 %) once a second, over the previous line."""
    from plumb.bridge.latency import short

    shown_s = time.monotonic()
    before: tuple[int, ...] = (0, 0, 0)

    def asked() -> bool:
        nonlocal shown_s, before
        now_s = time.monotonic()
        if now_s - shown_s >= 1.0:
            count = (*frames(), bridge.steps if bridge else 0)
            rates = [(new - old) / (now_s - shown_s) for new, old in zip(count, before, strict=True)]
            text = f"{rates[0]:.0f} frames/s down, {rates[1]:.0f} up"
            if bridge is not None:
                verified = f", {bridge.shadow.steps} verified" if bridge.shadow else ""
                lost = bridge.sensor.flow.lost + bridge.board.lost
                rejected = bridge.sensor.flow.rejected + bridge.board.rejected
                text += f", {rates[2]:.0f} steps/s{verified}, lost {lost}, rejected {rejected}"
            took = ", ".join(f"{name} {short(one.as_dict())}" for name, one in latencies.items())
            columns = shutil.get_terminal_size().columns - 1
            print(f"\r{f'{text}; {took}'[:columns]}\x1b[K", end="", file=sys.stderr, flush=True)
            shown_s, before = now_s, count
        return stopped()

    return asked


def flow(flow: Flow, end: End | None = None) -> FlowCounts:
    said = FlowCounts(
        frames=flow.frames, lost=flow.lost, rejected=flow.rejected, foreign=flow.foreign, opened=flow.opened
    )
    return said if end is None else {**said, "trouble": end.trouble}


def summary_of(bridge: Bridge) -> Summary:
    """All counters of the bridge."""
    counted, took = bridge.counted, bridge.sample_to_step
    latency = {f"p{p}": round(1e3 * took.percentile_s(p), 3) for p in (50, 99, 100)} if took.count else None
    board: FlowCounts = {
        **flow(bridge.board),
        "board_rejected": counted.rejected,
        "board_lost": counted.lost,
        "board_dropped": counted.dropped,
    }
    summary: Summary = {
        "runs": bridge.runs,
        "steps": bridge.steps,
        "starved": counted.starved,
        "skipped_samples": bridge.skipped,
        "unused_samples": bridge.unused,
        "latency_ms": latency,
        "latency": {
            "sensor to board": bridge.down.as_dict(),
            "board to sensor": bridge.up.as_dict(),
            "sample to step": took.as_dict(),
        },
        "sensor": flow(bridge.sensor.flow, bridge.sensor),
        "board": board,
    }
    shadow = bridge.shadow
    if bridge.want_shadow:
        summary["verdict"] = shadow.verdict if shadow else "unverified"
        summary["verified_steps"] = shadow.steps if shadow else 0
        summary["unverified_runs"] = shadow.unverified_runs if shadow else 0
        if shadow is not None and shadow.divergence is not None:
            summary["first_divergence"] = shadow.divergence.as_dict()
        if shadow is not None and shadow.unverified_from is not None:
            summary["unverified_from_step"] = shadow.unverified_from
            summary["unverified_why"] = shadow.unverified_why
        if shadow is not None and shadow.changes:
            summary["parameters_changed_at_steps"] = [change.step for change in shadow.changes]
    return summary


def describe(summary: Summary) -> str:
    """The summary as text."""
    from plumb.bridge.latency import drawn
    from plumb.errors import counted

    seconds = summary["seconds"]
    lines = []
    for side in SIDES:
        if side in summary:
            s = summary[side]
            lines.append(
                f"{side:<8} {counted(s['frames'], 'frame')} ({s['frames'] / seconds:.0f}/s), lost {s['lost']}, "
                f"rejected {s['rejected']}, foreign {s['foreign']}, opened {counted(s['opened'], 'time')}"
            )
    if "runs" in summary:
        lines.append(
            f"runs     {summary['runs']}, {summary['steps']} steps, {summary['starved']} of them without a new "
            f"sample, {summary['skipped_samples']} samples skipped to keep the latency short, "
            f"{summary['unused_samples']} arrived outside a run"
        )
        b = summary["board"]
        lines.append(
            f"counted  by the board: rejected {b['board_rejected']}, dropped {b['board_dropped']}, lost "
            f"{b['board_lost']}, including samples skipped here or lost before"
        )
    for name, measured in summary.get("latency", {}).items():
        first, *bars = drawn(measured)
        lines += [f"latency  {name}: {first}", *bars]
    if "verdict" in summary:
        lines.append(f"shadow   {summary['verified_steps']} steps agree with the model in every bit")
        if "parameters_changed_at_steps" in summary:
            steps = ", ".join(map(str, summary["parameters_changed_at_steps"]))
            lines.append(f"         the parameters changed at step {steps}")
        if "unverified_from_step" in summary:
            lines.append(
                f"         unverified from step {summary['unverified_from_step']}: {summary['unverified_why']}"
            )
        if "first_divergence" in summary:
            lines.append(f"         first divergence: {summary['first_divergence']}")
        lines.append(str(summary["verdict"]))
    return "\n".join(lines)
