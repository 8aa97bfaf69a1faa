"""Watch a running board: tilt, bias, rates, pulses, mode, what blocks arming, counters and losses.

    plumb monitor --board serial:/dev/ttyUSB0                 whatever is running there, read-only
    plumb monitor --board serial:/dev/ttyUSB0 --run live      begin a run on its own sensors, unarmed
    plumb monitor --board virtual --run live --seconds 20     the system of the image in motion, on the simulated board
    plumb monitor --board virtual --run live --system balancer       or another system's plant, on its own sensors

The display is updated ten times a second: a block on a terminal, one line a second elsewhere, one line of JSON for each
update with --json. Ends after --seconds, or with Ctrl-C. Without --run the link is read-only and a run in progress goes
on; the host that began it selected the signals that it sends. A serial port has one client at a time, and opening it
disarms a board that a host armed: watch such a run in the program that armed it. A board that the arm switch armed
stays armed. --run live ends a run in progress, and its own run at the end.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import textwrap
import time
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.boards.link import LinkBoard
    from plumb.link.identity import Identity
    from plumb.link.monitor import Snapshot

LOOKS_PER_LINE = 10
SHOWN = {
    "tilt_deg", "tilt_measured_deg", "rate_dps", "bias_dps", "command", "pulse_0_us", "pulse_1_us", "duty", "flags",
    "velocity_mps", "roll_deg", "roll_bias_dps", "w", "x", "y", "z", "rate_x_dps", "rate_y_dps", "rate_z_dps",
}  # fmt: skip
"""Columns with a place of their own in the view; the others are listed by name."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    parser.add_argument("--run", choices=("live",), help="begin a run on the board's own sensors, unarmed")
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    options.add_json(parser, ", one object a line")


def main(arguments: argparse.Namespace) -> int:
    from plumb.link import monitor
    from plumb.process_signals import endings, raise_ending

    options.check_duration(arguments.seconds)
    on_terminal = sys.stdout.isatty() and not arguments.json
    with options.linked_board_of(arguments) as board:
        paced = attach_plant(board, arguments.system, arguments.scenario, arguments.seed) and on_terminal
        session = board.session
        identity = session.identity or session.connect()
        if identity.mismatch:
            print(f"plumb: warning: {identity.mismatch}", file=sys.stderr)
        if arguments.run:
            monitor.begin_live(session)
        else:
            monitor.read_only(session)
        begin_s, begin_wall_s = session.clock(), time.monotonic()
        with endings() as caught:
            shown = 0
            for look, snapshot in enumerate(monitor.watch(session, arguments.seconds)):
                if caught:
                    break
                if arguments.json:
                    print(json.dumps(snapshot), flush=True)
                elif on_terminal:
                    shown = show(block(identity, snapshot), over=shown)
                elif look % LOOKS_PER_LINE == LOOKS_PER_LINE - 1:
                    print(line(snapshot), flush=True)
                if paced:
                    time.sleep(max(0.0, session.clock() - begin_s - (time.monotonic() - begin_wall_s)))
        if arguments.run:
            session.end()
    if caught:
        raise_ending(caught)
    return 0


def attach_plant(board: LinkBoard, system: str | None, scenario: str | None, seed: int) -> bool:
    """Put a plant with prescribed motion on the pins of a board simulated in this process; False for another board."""
    from plumb.errors import UsageError

    if board.name != "virtual":
        if system or scenario:
            remedy = "`plumb params tuning SYSTEM` makes another board that system"
            raise UsageError(f"--system and --scenario are for --board virtual, whose pins a plant drives; {remedy}")
        return False
    from plumb.boards import SimulatedBoard, plant_on_pins

    assert isinstance(board, SimulatedBoard)
    plant_on_pins.show(board, system or board.session.system, scenario, seed)
    return True


def number(value: float | None, unit: str, width: int = 9, places: int = 3) -> str:
    text = "-" if value is None else f"{value:+.{places}f}"
    return f"{text:>{width}} {unit}"


def count(value: int | None) -> str:
    return "-" if value is None else str(value)


def state(snapshot: Snapshot) -> str:
    """IDLE, LOCKSTEP, REALTIME live, and whether it is armed."""
    words = [snapshot["mode"] or "-", "live" if snapshot["live"] else "", "ARMED" if snapshot["armed"] else "disarmed"]
    return " ".join(filter(None, words))


def block(identity: Identity, s: Snapshot) -> list[str]:
    """The lines of the display on a terminal."""
    from plumb.link.identity import PINS

    rate = "-" if s["steps_per_s"] is None else f"{s['steps_per_s']:.1f}/s"
    lost = f"steps {s['host_lost_steps']}, other frames {s['host_lost']}, rejected {s['host_rejected']}"
    board = (
        f"frames {count(s['board_lost'])}, rejected {count(s['board_rejected'])}, dropped {count(s['board_dropped'])}"
    )
    errors = f"errors sent {count(s['can_transmit_errors'])}, received {count(s['can_receive_errors'])}"
    can = f"{'off the bus' if s['can_off_bus'] else 'on the bus'}, {errors}, times off {count(s['can_bus_offs'])}"
    blocked = "; ".join(s["blocked"]) or "nothing blocks arming"
    armed = "yes" if s["armed"] else f"no, the pins stay neutral; {blocked}"
    idle = "no run is on: --run live begins one" if s["mode"] == "IDLE" else ""
    return [
        f"plumb board {identity.unique_id}, image {identity.git_hash or 'of no known commit'}, "
        f"pins {PINS.get(identity['PINS'], '?')}",
        f"time      {s['time_s']:10.2f} s    {state(s)}    step {count(s['step'])}, {rate}    {idle}".rstrip(),
        f"tilt      {number(s['tilt_deg'], 'deg')}      measured {number(s['tilt_measured_deg'], 'deg')}",
        f"rate      {number(s['rate_dps'], 'deg/s')}    bias     {number(s['bias_dps'], 'deg/s')}",
        f"command   {number(s['command'], '')}         pulses   {pulses(s)}",
        *drive_and_roll(s),
        *attitude(s),
        *others(s),
        f"raw       {' '.join(map(str, s['raw'])) if s['raw'] else '-'}",
        f"armed     {armed}",
        f"faults    {'; '.join(s['faults']) or 'none'}",
        f"last disarmed by  {'; '.join(s['disarm_cause']) or 'nothing'}",
        f"events    saturated {count(s['saturated_steps'])}, starved {count(s['starved_steps'])}",
        f"can       {can}",
        f"lost here     {lost}",
        f"by the board  {board}",
    ]


def drive_and_roll(s: Snapshot) -> list[str]:
    """Lines of duty and velocity, and of roll, for systems that have these signals."""
    lines = []
    if s["duty"] is not None:
        lines.append(f"duty      {number(s['duty'], '')}         velocity {number(s['velocity_mps'], 'm/s')}")
    if s["roll_deg"] is not None:
        lines.append(f"roll      {number(s['roll_deg'], 'deg')}      bias     {number(s['roll_bias_dps'], 'deg/s')}")
    return lines


def others(s: Snapshot) -> list[str]:
    """A line for each column that no other line shows."""
    return [f"{name:<9} {number(s[name], '')}" for name in other_columns() if s[name] is not None]


def other_columns() -> list[str]:
    """The columns without a place of their own in the view."""
    from plumb.link.monitor import columns

    return [name for name in columns() if name not in SHOWN]


def attitude(s: Snapshot) -> list[str]:
    """Lines of a system with a quaternion: Euler angles and body rates."""
    if s["attitude"] is None or s["rates_dps"] is None:
        return []
    yaw, pitch, roll = angles_deg(s["attitude"])
    rates = " ".join(number(rate, "", 8, 2) for rate in s["rates_dps"])
    return [
        f"attitude  {number(yaw, 'deg yaw')}  {number(pitch, 'deg pitch')}  {number(roll, 'deg roll')}",
        f"turning   {rates} deg/s about x, y, z",
    ]


def angles_deg(quaternion: list[float]) -> tuple[float, float, float]:
    """Yaw, pitch and roll in deg (rotation order z, y, x) of a quaternion w, x, y, z."""
    w, x, y, z = quaternion
    yaw = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    pitch = math.degrees(math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0)))
    roll = math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    return yaw, pitch, roll


def pulses(s: Snapshot) -> str:
    return " ".join("-" if s[f"pulse_{i}_us"] is None else f"{s[f'pulse_{i}_us']:.1f}" for i in (0, 1)) + " us"


def show(lines: list[str], *, over: int) -> int:
    """Write the block over the previous one. over: rows that the previous one took; returns the rows of this one."""
    width = max(shutil.get_terminal_size().columns - 1, 40)
    rows = [row for text in lines for row in textwrap.wrap(text, width, subsequent_indent=" " * 10)]
    back = f"\x1b[{over}A" if over else ""
    print(back + "".join(f"{row}\x1b[K\n" for row in rows) + "\x1b[J", end="", flush=True)
    return len(rows)


def line(s: Snapshot) -> str:
    """The display as one line, for a file or a pipe."""
    lost = s["host_lost"] + s["host_lost_steps"]
    trouble = [f"lost {lost}"] if lost else []
    trouble += [f"rejected {s['host_rejected']}"] if s["host_rejected"] else []
    trouble += [f"dropped {s['board_dropped']}"] if s["board_dropped"] else []
    trouble += [f"saturated {s['saturated_steps']}"] if s["saturated_steps"] else []
    trouble += s["faults"]
    yaw, pitch, roll = angles_deg(s["attitude"]) if s["attitude"] else (None, None, s["roll_deg"])
    values = [
        ("tilt", s["tilt_deg"], "deg"),
        ("yaw", yaw, "deg"),
        ("pitch", pitch, "deg"),
        ("roll", roll, "deg"),
        ("rate", s["rate_dps"], "deg/s"),
        ("bias", s["bias_dps"], "deg/s"),
        ("duty", s["duty"], ""),
        ("velocity", s["velocity_mps"], "m/s"),
        *((name, s[name], "") for name in other_columns()),
    ]
    words = [f"{s['time_s']:.2f} s", state(s)]
    words += [f"{name} {number(value, unit, 0)}".rstrip() for name, value, unit in values if value is not None]
    if s["pulse_0_us"] is not None and s["duty"] is None:
        words.append(f"pulses {pulses(s)}")
    if s["step"] is not None:
        words.append(f"step {s['step']}")
    return "  ".join(words + trouble)
