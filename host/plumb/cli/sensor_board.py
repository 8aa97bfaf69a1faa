"""Simulate a sensor board in a process of its own: a system's plant in real time, its samples as frames on a bus.

    plumb sensor-board quad --bus serial:pty             prints the terminal's name, for a bridge to open
    plumb sensor-board quad --bus tcp:127.0.0.1:4100     waits for a bridge there
    plumb sensor-board quad --bus can:socketcan:can0     as a second board on a CAN bus
    plumb sensor-board quadrotor --bus serial:pty --sticks serial:/dev/ttyUSB1      with a pilot, by CRSF

The outputs of the STM32 move the plant while it is armed. Until then the plant stays at rest, because a board can only
be armed at rest; a few seconds after a disarm it is reset. With --open-loop the motion is prescribed and begins at
once. With --sticks the pilot's sticks go to the board's radio receiver instead, in CRSF at 420000 baud: the board needs
the parameter receiver = 1 for that, and the scenario begins at once, since it is the pilot's switch that arms. Runs
until Ctrl-C, or for --seconds. When this machine is too slow for real time, the board says so.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path

from plumb.cli import options

REST_S = 2.0
"""Rest at the beginning of the scenarios of systems with an actuator; each of these scenarios has more."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_system_argument(parser)
    parser.add_argument(
        "--bus", required=True, metavar="BUS", help="serial:pty, serial:PORT, tcp:HOST:PORT, udp:PORT or can:..."
    )
    parser.add_argument("--symlink", type=Path, help="make this symbolic link to the terminal of serial:pty")
    parser.add_argument(
        "--sticks", metavar="PORT", help="where the board's radio receiver listens: serial:PORT or tcp:HOST:PORT"
    )
    options.add_scenario(parser)
    options.add_seed(parser)
    options.add_duration(parser)
    options.add_open_loop(parser)
    options.add_json(parser, " at the end")


def main(arguments: argparse.Namespace) -> int:
    import contextlib

    from plumb import systems
    from plumb.bridge.sensor_board import SensorBoard
    from plumb.contract.scenario import Plant
    from plumb.errors import UsageError, counted
    from plumb.link.endpoint_names import CanName, parse_bus
    from plumb.link.sample_codec import layout_of
    from plumb.link.transports.byte_stream import open_stream
    from plumb.link.transports.open_bus import serve_bus
    from plumb.process_signals import endings
    from plumb.spec import crsf, declarations
    from plumb.spec.system import RECEIVER

    options.check_duration(arguments.seconds)
    system = systems.load(arguments.system)
    if arguments.sticks and RECEIVER not in declarations.system(arguments.system).parts:
        raise UsageError(f"{arguments.system} takes no sticks from a receiver: leave --sticks out")
    name = arguments.scenario or system.DEFAULT_SCENARIO
    scenario = system.scenario(name, arguments.seed, period_us=system.PERIOD_US)  # that of the bridge's default tuning

    def say(text: str) -> None:
        print(f"plumb: {text}", file=sys.stderr, flush=True)

    def plant() -> Plant:
        return system.plant(scenario, open_loop=arguments.open_loop)

    with contextlib.ExitStack() as stack:
        caught, bus = stack.enter_context(endings()), stack.enter_context(serve_bus(arguments.bus, arguments.symlink))
        line = open_stream(arguments.sticks.removeprefix("serial:"), crsf.BAUD) if arguments.sticks else None
        if line is not None:
            stack.callback(line.close)
        print(f"{arguments.system} sends samples on {bus.channel_info}; Ctrl-C ends it", flush=True)
        # A pilot's sticks begin at once, and arm: a receiver does not fall silent, and wait for the board.
        waits = system.OUTPUT_FRAMES and not arguments.open_loop and not arguments.sticks
        rest_s = REST_S if waits else 0.0
        greet = isinstance(parse_bus(arguments.bus), CanName)
        layout = layout_of(arguments.system)
        board = SensorBoard(
            bus, plant, scenario.period_us, system.OUTPUT_FRAMES, greet=greet, rest_s=rest_s, layout=layout, say=say,
            sticks=line.write if line else None,
        )  # fmt: skip
        board.run(lambda: bool(caught), arguments.seconds)
    summary = {"system": arguments.system, "samples": board.sent, "late": board.late}
    if arguments.json:
        print(json.dumps(summary))
    else:
        late = counted(board.late, "period")
        print(f"{counted(board.sent, 'sample')} sent; {late} skipped because this machine was late")
    if signal.SIGINT in caught:
        raise KeyboardInterrupt
    return 0
