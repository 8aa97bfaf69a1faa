"""List the serial ports of this machine, and with --probe which of them answer as a plumb board.

A port is only opened with --probe: opening a port toggles DTR on some adapters, which resets some boards.
"""

from __future__ import annotations

import argparse
import json

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--probe", action="store_true", help="open each port at 921600 baud and read the identity of the board"
    )
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from serial.tools import list_ports

    rows = []
    for port in sorted(list_ports.comports(), key=lambda entry: entry.device):
        row = {"port": port.device, "description": port.description, "usb": port.hwid}
        if arguments.probe:
            row["board"] = probe(port.device)
        rows.append(row)
    if arguments.json:
        print(json.dumps({"ports": rows}))
        return 0
    if not rows:
        print("no serial ports; a USB-serial adapter appears as /dev/ttyUSB0 or /dev/ttyACM0 when it is plugged in")
    for row in rows:
        print("  ".join(str(value) for value in row.values()))
    return 0


def probe(device: str) -> str:
    """One sentence about the board at `device`, or why there is none."""
    from plumb.errors import LinkError
    from plumb.link.session import Session

    try:
        with Session.open(device) as session:
            identity = session.connect()
    except LinkError as error:
        return f"no plumb board: {error}"
    about = f"plumb board {identity.unique_id}, image {identity.git_hash or 'of no known commit'}"
    return f"{about}; {identity.mismatch}" if identity.mismatch else about
