"""Serve the virtual board as a process of its own, in real time.

    plumb virtual-board --serial pty               prints the terminal's name; open it like a serial port
    plumb virtual-board --serial tcp:4000          then use serial:socket://127.0.0.1:4000 as the board
    plumb virtual-board --serial pty --system quad with the plant on its pins, for live runs
    plumb virtual-board --can slcan:pty            its CAN bus behind an SLCAN adapter: can:slcan:TERMINAL
    plumb virtual-board --can slcan:tcp:4001       the same over TCP: can:slcan:socket://127.0.0.1:4001
    plumb virtual-board --can socketcand:4002      as a socketcand server: can:socketcand:127.0.0.1:4002:can0, for
                                                   several clients: all receive what one has asked for
    plumb virtual-board --can socketcan:vcan0      or a node on any bus that python-can opens, INTERFACE:CHANNEL[@KBIT]

    plumb virtual-board --strap quadrotor --receiver pty       its radio receiver: write CRSF to that terminal

    plumb virtual-board --strap quadrotor --receiver tcp:4003 --ppm     its receiver has a pulse train, on PA8: it plays
                                                   the CRSF that is written to the port
    plumb virtual-board --strap quadrotor --battery 9.5        its battery has 9.5 V behind the divider at PB0

    plumb virtual-board --strap bridge             the strap (PB4, PB5) wired for these pins; default: as --system wants
    plumb virtual-board --port native              the same main loop on a board in memory: no image, no Unicorn
    plumb virtual-board --gdb 3333                 gdb stops the chip and its time, steps and looks into it
    plumb virtual-board --vcd board.vcd            record its pins and buses: gtkwave board.vcd
    plumb virtual-board --symlink board --keep board.flash     what `plumb params save` saves is there the next time
    plumb virtual-board --system attitude --hand -             you hold it: type a pose, `3` or `left side up`
    plumb virtual-board --system quad --hand hand.txt          the same from a file: echo upside down >> hand.txt

The board runs the flash image unmodified, or with --port native the same main loop built for this machine, until
Ctrl-C; starting it again is power off and on. With --system the board starts as that system, its tuning and its pin set
saved, as after `plumb params tuning SYSTEM --save` and a reset, unless --keep has parameters; without --system it
starts with factory parameters. The strap decides where UART and actuators are: while the saved parameter `pins`
disagrees with it, the board drives no actuator pin. With --hand a hand holds the body, whose sensors have the errors of
the seed, for `plumb calibrate` and `plumb setup` over its port. A line of the hand is a pose, and if wanted a share of
the way and a time: `left side up 50% 2s`. When this machine is too slow for real time, the board says so.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.cli.whole_numbers import flash_offset
from plumb.spec.pin_sets import PIN_SETS

if TYPE_CHECKING:
    from collections.abc import Callable

    from plumb.boards.flash_file import KeptSlots
    from plumb.boards.hand_orders import HandOrders
    from plumb.boards.serve import Join, Served
    from plumb.contract.scenario import Plant
    from plumb.f103.machine import Machine
    from plumb.f103.waveforms import VcdTrace

    Receive = Callable[[bytes], object]
    Attach = Callable[[Plant], object]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    straps = ", ".join(one.name for one in PIN_SETS)
    battery = ", ".join(f"{one.battery} of {one.name}" for one in PIN_SETS if one.battery)
    parser.add_argument(
        "--serial", default="pty", metavar="pty|tcp:PORT", help="where its UART is served (default pty)"
    )
    parser.add_argument(
        "--can", metavar="INTERFACE:CHANNEL", help="where its CAN bus is served or joined (default: nowhere)"
    )
    parser.add_argument(
        "--receiver", metavar="pty|tcp:PORT", help="where the line of its radio receiver is served (default: nowhere)"
    )
    parser.add_argument(
        "--ppm", action="store_true", help="its receiver gives pulses at PA8, by the CRSF of --receiver"
    )
    parser.add_argument(
        "--battery",
        type=float,
        metavar="V",
        help=f"volts of the battery, at {battery} (default: that of the plant, else 0)",
    )
    parser.add_argument("--symlink", type=Path, help="make this symbolic link to the terminal")
    options.add_system(parser, "start as this system, with its plant on the pins")
    options.add_scenario(parser)
    options.add_seed(parser, "the plant")
    parser.add_argument("--strap", help=f"{straps} (default: that of --system)")
    parser.add_argument("--port", choices=("f103", "native"), default="f103", help="the chip, or a board in memory")
    parser.add_argument("--part", help="stm32f103c8 (default), or another from -c4 to -ze")
    options.add_image(parser)
    parser.add_argument("--offset", type=flash_offset, metavar="BYTES", help="of an image behind a boot loader")
    parser.add_argument(
        "--hand", metavar="FILE|-", help="a hand holds the body, and follows poses in FILE, or on stdin"
    )
    options.add_gdb(parser, options.GDB_ANY_TIME)
    parser.add_argument("--vcd", type=Path, metavar="FILE", help="record pins and buses for GTKWave, PulseView, sigrok")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="store its flash parameters in this file")


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards.debugging import debugged
    from plumb.errors import UsageError
    from plumb.files.whole_files import require_different
    from plumb.link.endpoint_names import PtyName, parse_can_end, parse_endpoint
    from plumb.link.transports.server_endpoint import NO_TERMINAL

    if arguments.scenario and not arguments.system:
        raise UsageError("--scenario needs a plant: name its system with --system, or leave --scenario out")
    if arguments.battery is not None and arguments.battery < 0:
        raise UsageError(f"--battery {arguments.battery:g}: give 0 V or more")
    named = (arguments.vcd, arguments.keep, arguments.symlink, None if arguments.hand == "-" else arguments.hand)
    require_different((Path(path) for path in named if path), "give each of --vcd, --keep, --symlink, --hand its own")
    served = parse_endpoint(arguments.serial)
    if arguments.symlink and not isinstance(served, PtyName):
        raise UsageError(NO_TERMINAL)
    if arguments.can:
        parse_can_end(arguments.can)
    if arguments.ppm and not arguments.receiver:
        raise UsageError("--ppm plays the frames of --receiver: say where that is served, or leave --ppm out")
    if arguments.receiver:
        parse_endpoint(arguments.receiver)
    with debugged(arguments.gdb):
        return _serve(arguments)


def _serve(arguments: argparse.Namespace) -> int:
    from plumb.boards import debugging
    from plumb.boards.serve import Radio, serve
    from plumb.link.served_boards import Entry
    from plumb.process_signals import endings

    traces: list[VcdTrace] = []
    plant, orders = _plant(arguments)
    board, join, kept, receive, attach = (
        _native(arguments, plant) if arguments.port == "native" else _f103(arguments, plant, traces)
    )

    def set_up() -> None:
        if orders is None and (anew := _plant(arguments)[0]) is not None:
            attach(anew)

    def announce(address: str) -> None:
        name = address if address.startswith("can:") else f"serial:{arguments.symlink or address}"
        entry.add(address if address.startswith("can:") else f"serial:{address}")
        print(f"serving the virtual board at {address}; use it as {name}; Ctrl-C ends it", flush=True)

    with contextlib.ExitStack() as stack:
        trace = stack.enter_context(traces[0]) if traces else None
        caught = stack.enter_context(endings())
        entry = stack.enter_context(Entry(arguments.system or ""))
        debugging.ends(lambda: bool(caught))
        serve(
            board,
            arguments.serial,
            lambda: bool(caught),
            join=join,
            link=arguments.symlink,
            can_spec=arguments.can,
            kept=kept,
            announce=announce,
            say=say,
            trace=trace,
            orders=orders,
            radio=Radio(arguments.receiver, receive) if arguments.receiver else None,
            announce_radio=lambda address: print(f"its radio receiver listens at {address}", flush=True),
            set_up=set_up,
        )
    if caught[:1] == [signal.SIGINT]:
        raise KeyboardInterrupt
    return 0


def say(text: str) -> None:
    print(f"plumb: {text}", file=sys.stderr, flush=True)


def _plant(arguments: argparse.Namespace) -> tuple[Plant | None, HandOrders | None]:
    """The plant of --system, and the orders for the hand of --hand."""
    from plumb import systems
    from plumb.boards import hand_orders
    from plumb.errors import UsageError
    from plumb.systems.contracts import PINS, POSES

    if not arguments.hand:
        if not arguments.system:
            return None, None
        system = systems.load(arguments.system)
        name = arguments.scenario or systems.load(arguments.system, PINS).SCENARIO
        return system.plant(system.scenario(name, arguments.seed)), None
    if not arguments.system or arguments.scenario:
        raise UsageError("--hand holds the body of a system: name it with --system, and leave --scenario out")
    plant, hand = systems.load(arguments.system, POSES).held(arguments.seed)
    poses = ", ".join(f"{number} {pose}" for number, pose in enumerate(hand.poses, 1))
    orders = hand_orders.HandOrders(hand, hand_orders.lines_of(arguments.hand), say)
    say(f"the hand holds it: {hand.poses[0]}; poses: {poses}")
    return plant, orders


def _strap(arguments: argparse.Namespace) -> str:
    """The strap setting of --strap, else that of the system."""
    from plumb import systems
    from plumb.boards.strap import BY_PIN_SET

    pins = systems.load(arguments.system).LINK.get("pins", 0) if arguments.system else 0
    return arguments.strap or BY_PIN_SET[pins]


def _f103(
    arguments: argparse.Namespace, plant: Plant | None, traces: list[VcdTrace]
) -> tuple[Served, Join, KeptSlots | None, Receive, Attach]:
    """The simulated chip with the flash image; the recording of --vcd, which begins with power-up, is put on traces."""
    from plumb.boards import plant_on_pins
    from plumb.boards.flash_file import MachineSlots, read_slots
    from plumb.boards.pulse_train import on_pin
    from plumb.boards.strap import BATTERY_PINS
    from plumb.boards.virtual_can import Joint
    from plumb.boards.virtual_machine import open_machine
    from plumb.f103.waveforms import VcdTrace
    from plumb.physics.battery import BATTERY_PIN, Battery
    from plumb.spec import images

    slots = read_slots(arguments.keep) if arguments.keep else b""
    couple = plant_on_pins.coupler(arguments.system, plant) if plant is not None else None
    strap = _strap(arguments)
    part = arguments.part or "stm32f103c8"

    def attach(machine: Machine) -> None:
        if arguments.battery is not None:
            machine.adc[BATTERY_PINS.get(strap, BATTERY_PIN)] = Battery(arguments.battery).input_v()
        if couple is not None:
            couple(machine)
        if arguments.vcd is not None:
            traces.append(VcdTrace(machine, arguments.vcd))

    image = arguments.image or images.running(arguments.system)
    machine = open_machine(image, part, slots=slots, strap=strap, couple=attach, offset=arguments.offset)
    if arguments.system and not slots:
        plant_on_pins.boot_configured_as(machine, arguments.system, strap, calibrated=not arguments.hand)
    kept = MachineSlots(machine, arguments.keep) if arguments.keep else None
    receive = on_pin(machine).receive if arguments.ppm else machine.usart3.receive

    def attach_anew(anew: Plant) -> None:
        plant_on_pins.coupler(arguments.system, anew)(machine)

    return machine, functools.partial(Joint, machine), kept, receive, attach_anew


def _native(
    arguments: argparse.Namespace, plant: Plant | None
) -> tuple[Served, Join, KeptSlots | None, Receive, Attach]:
    """The main loop on a board in memory."""
    from plumb.boards.flash_file import read_slots
    from plumb.boards.native.served import NativeJoint, NativeSlots, open_native
    from plumb.boards.pulse_train import on_native
    from plumb.boards.strap import BY_PIN_SET
    from plumb.errors import UsageError
    from plumb.physics.battery import Battery

    if arguments.image or arguments.part or arguments.vcd or arguments.offset or arguments.gdb is not None:
        only = "--image, --offset, --part, --gdb and --vcd are for --port f103"
        raise UsageError(f"{only}: leave them or --port native out")
    slots = read_slots(arguments.keep) if arguments.keep else b""
    strap = _strap(arguments)
    if strap not in BY_PIN_SET:
        raise UsageError(f"there is no strap setting '{strap}'; use one of {', '.join(BY_PIN_SET)}")
    board = open_native(BY_PIN_SET.index(strap), slots, arguments.system, plant, calibrated=not arguments.hand)
    if arguments.battery is not None or plant is not None:
        board.mcu.wires.battery_voltage = (
            Battery() if arguments.battery is None else Battery(arguments.battery)
        ).counts()
    kept = NativeSlots(board.mcu, arguments.keep) if arguments.keep else None
    receive = on_native(board.mcu).receive if arguments.ppm else board.mcu.receiver_send
    return board, functools.partial(NativeJoint, board.mcu), kept, receive, board.attach
