"""The `plumb` command: find the verb, import only its module, run it, turn errors into exit codes.

Exit codes: 0 good, 1 the verdict is bad, 2 wrong use or a bad input file or a missing tool, 3 device or link trouble
(or a verdict that could not be verified), 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from plumb import __version__
from plumb.errors import PlumbError

COMMANDS = {
    "demo": "closed loop on the virtual board, then the golden comparison; writes a report",
    "run": "run one system's scenario on a board and compare every step with the model",
    "golden": "make the golden vectors, or check boards against them",
    "replay": "run a recording of real sensors through a board, one axis; or a phone's, both",
    "phone": "take a phone's sensors over UDP, feed them to a board, show pitch and roll",
    "systems": "the systems' published figures, and what the integers reach",
    "virtual-board": "serve the simulated STM32F103: its UART on a pty or TCP port, its CAN on any bus",
    "monitor": "watch a running board: tilt, bias, pulses, mode, counters, losses",
    "record": "record a running board, or a bus, into files",
    "params": "read, change, keep and restore a board's parameters",
    "sensor-board": "the simulated sensor board: samples in real time as frames on a bus",
    "bridge": "carry frames between a sensor board and a board, with the model beside",
    "link-test": "try a link: losses, damage, rates and delays",
    "bandwidth": "the low-pass of an accelerometer for a motion, and its noise",
    "flash": "write the flash image to a board over its ROM bootloader, and read it back",
    "bench": "instructions, cycles, bytes, stack and error of the kernels, against budget",
    "ports": "list serial ports, and which one answers as a plumb board",
    "doctor": "check this machine: tools, libraries, image, permissions",
    "completion": "print a shell completion script",
}


def command_module(name: str) -> ModuleType:
    return importlib.import_module(f"plumb.commands.{name.replace('-', '_')}")


def top_level_help() -> str:
    width = max(map(len, COMMANDS))
    lines = [
        "usage: plumb COMMAND [options]      plumb COMMAND --help tells the rest",
        "",
        "Attitude estimation and control in integers for the STM32F103,",
        "and the proof that board and model agree to the bit.",
        "",
        "commands:",
        *(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()),
        "",
        "systems:  quad | balancer | turntable | phone",
        "boards:   native | qemu | virtual | serial:PORT[@BAUD] | can:INTERFACE:CHANNEL[@KBIT]",
        "exit:     0 good, 1 bad verdict, 2 wrong use, bad file or missing tool, 3 link trouble, 130 interrupted",
    ]
    return "\n".join(lines)


def command_parser(name: str) -> argparse.ArgumentParser:
    module = command_module(name)
    parser = argparse.ArgumentParser(
        prog=f"plumb {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add_arguments(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(top_level_help())
        return 0 if arguments else 2
    name, rest = arguments[0], arguments[1:]
    if name in ("-V", "--version"):
        print(f"plumb {__version__}")
        return 0
    if name not in COMMANDS:
        print(f"plumb: there is no command '{name}'; `plumb --help` lists them.", file=sys.stderr)
        return 2
    try:
        parsed = command_parser(name).parse_args(rest)
        return int(command_module(name).main(parsed))
    except PlumbError as error:
        print(f"plumb: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("plumb: interrupted.", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of our output left (`plumb run | head`): nothing more to say, and no traceback at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def entry() -> None:
    sys.exit(main())


if __name__ == "__main__":
    entry()
