"""Serve the virtual board as a process of its own, at the pace of the wall clock.

    plumb virtual-board --serial pty               prints the terminal's name; open it like a serial port
    plumb virtual-board --serial tcp:4000          then use serial:socket://127.0.0.1:4000 as the board
    plumb virtual-board --serial pty --system quad with the plant on its pins, for live runs
    plumb virtual-board --can slcan:pty            its CAN bus behind an SLCAN adapter: can:slcan:TERMINAL
    plumb virtual-board --can slcan:tcp:4001       the same over TCP: can:slcan:socket://127.0.0.1:4001
    plumb virtual-board --can socketcand:4002      as a socketcand server: can:socketcand:127.0.0.1:4002:can0
    plumb virtual-board --can socketcan:vcan0      or a node on any bus that python-can opens, INTERFACE:CHANNEL[@KBIT]

    plumb virtual-board --strap bridge             the strap (PB4, PB5) wired for these pins; default: as --system wants
    plumb virtual-board --symlink board --keep board.flash     what `plumb params save` saves is there the next time

It runs the very image that is flashed, until Ctrl-C; starting it again is power off and on. With --system the board
comes up as that system, its tuning and its pin set saved, as `plumb params tuning SYSTEM --save` and a reset leave
them, unless --keep has parameters; without it, as a blank one. The strap decides where UART and actuators are: while
the saved parameter pins disagrees with it, no actuator pin is driven.
"""

from __future__ import annotations

import argparse
import signal
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--serial", default="pty", metavar="pty|tcp:PORT", help="where its UART appears (default pty)")
    parser.add_argument("--can", metavar="INTERFACE:CHANNEL", help="where its CAN bus appears (default: nowhere)")
    parser.add_argument("--symlink", type=Path, help="also make this name point to the terminal")
    parser.add_argument("--system", help="begin as this system, its plant on the pins")
    parser.add_argument("--scenario", help="of the plant; a wrong name prints the system's list")
    parser.add_argument("--seed", type=int, default=1000, help="of the plant (default 1000)")
    parser.add_argument("--strap", help="standard, bridge, quadrotor or both (default: as --system wants it)")
    parser.add_argument("--part", default="stm32f103c8", help="stm32f103c8 (default), -cb, -rct6, -ret6 or -zet6")
    parser.add_argument("--image", type=Path, help="flash image (default: the checkout's build)")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep its saved parameters here")


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems
    from plumb.boards.flash_file import KeptSlots, read_slots
    from plumb.f103 import open_machine
    from plumb.f103.attached.strap import BY_PIN_SET

    slots = read_slots(arguments.keep) if arguments.keep else b""
    couple = None
    if arguments.system:
        from plumb.boards import plant_on_pins

        system = systems.load(arguments.system)
        name = arguments.scenario or systems.load(arguments.system, "pins").SCENARIO
        couple = plant_on_pins.coupler(arguments.system, system.scenario(name, arguments.seed))
    wanted = BY_PIN_SET[system.LINK.get("pins", 0)] if arguments.system else "standard"
    strap = arguments.strap or wanted
    machine = open_machine(arguments.image, arguments.part, slots=slots, strap=strap, couple=couple)
    if arguments.system and not slots:
        plant_on_pins.boot_configured_as(machine, arguments.system, strap)
    kept = KeptSlots(machine, arguments.keep) if arguments.keep else None
    from plumb.boards.serve import serve
    from plumb.process_signals import endings

    def announce(address: str) -> None:
        name = address if address.startswith("can:") else f"serial:{arguments.symlink or address}"
        print(f"serving the virtual board at {address}; use it as {name}; Ctrl-C ends it", flush=True)

    with endings() as caught:
        serve(
            machine,
            arguments.serial,
            lambda: bool(caught),
            link=arguments.symlink,
            can_spec=arguments.can,
            kept=kept,
            announce=announce,
        )
    if caught[:1] == [signal.SIGINT]:
        raise KeyboardInterrupt
    return 0
