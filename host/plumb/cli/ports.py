"""List where boards may be: serial ports, boards that other processes serve, CAN interfaces.

    plumb ports
    plumb ports --probe        and ask each serial port with a known adapter whether a board answers there

The first column is what --board and BUS take. A port is only opened with --probe: opening a port toggles DTR on some
adapters, which resets some boards, and disarms a board that a host armed. No CAN bus is asked. Boards that `plumb
virtual-board` serves enter themselves, under all their names.
"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.link.can_interfaces import CanInterface
    from plumb.link.discovery import Answer, SerialPort
    from plumb.link.served_boards import ServedBoard


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--probe", action="store_true", help="open each known adapter at 921600 baud and read the board's identity"
    )
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.link.can_interfaces import can_interfaces
    from plumb.link.discovery import serial_ports
    from plumb.link.served_boards import served_boards

    ports, boards, buses = serial_ports(), served_boards(), can_interfaces()
    answers = probe(ports) if arguments.probe else {}
    if arguments.json:
        rows = [as_json(port, answers.get(port.name)) for port in ports]
        served = [{"board": board.names[0], **vars(board)} for board in boards]
        print(json.dumps({"ports": rows, "served": served, "can": [vars(bus) for bus in buses]}))
        return 0
    lines = [[port.name, *about_port(port, answers.get(port.name))] for port in ports]
    lines += [row for board in boards for row in about_served(board)]
    lines += [[bus.name, about_bus(bus)] for bus in buses]
    width = max((len(row[0]) for row in lines), default=0)
    for name, *about in lines:
        print(f"{name:<{width}}  {'; '.join(filter(None, about))}".rstrip())
    if not lines:
        print(
            "no serial ports, no served boards, no CAN interfaces; a USB-serial adapter appears as /dev/ttyUSB0, "
            "/dev/ttyACM0 or COM3 when it is plugged in"
        )
    return 0


def probe(ports: list[SerialPort]) -> dict[str, Answer]:
    """The answers of the ports with a known adapter, by the port's name."""
    from plumb.link.discovery import Candidate, ask_all

    asked = [Candidate(port.name, port.description) for port in ports if port.may_have_board]
    return {answer.candidate.name: answer for answer in ask_all(asked)}


def about_answer(answer: Answer | None) -> str:
    """One sentence about the board that answered, or why there is none."""
    if answer is None:
        return ""
    if answer.identity is None:
        return f"no plumb board: {answer.trouble}"
    about = f"plumb board {answer.identity.unique_id}, {answer.identity.image_text}"
    return f"{about}; {answer.identity.mismatch}" if answer.identity.mismatch else about


def about_port(port: SerialPort, answer: Answer | None) -> list[str]:
    name = port.adapter.name if port.adapter else ""
    shown = "" if port.description in ("", name) else port.description
    return [name, shown, port.usb, about_answer(answer)]


def about_served(board: ServedBoard) -> list[list[str]]:
    from plumb.link.discovery import served_text

    about = f"{served_text(board.system)}, served by process {board.process}"
    return [[name, about] for name in board.names]


def about_bus(bus: CanInterface) -> str:
    if bus.state == "down":
        device = bus.name.rpartition(":")[2]
        return f"CAN interface, down: sudo ip link set {device} up type can bitrate 500000"
    rate = f", {bus.kbit} kbit/s" if bus.kbit else ""
    return f"CAN interface, {bus.state}{rate}"


def as_json(port: SerialPort, answer: Answer | None) -> dict[str, object]:
    row: dict[str, object] = {
        "port": port.device,
        "name": port.name,
        "adapter": port.adapter.name if port.adapter else None,
        "description": port.description,
        "usb": port.usb,
    }
    return row if answer is None else {**row, "board": about_answer(answer)}
