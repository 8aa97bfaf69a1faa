"""The commands by name, one sentence each; a command is the module of its name in this package."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    import argparse
    from types import ModuleType

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
    "faults": "the fault table: injections on the armed flash image, against limits",
    "bench": "instructions, cycles, bytes, stack and error of the kernels, against budget",
    "ports": "list serial ports, and which one answers as a plumb board",
    "doctor": "check this machine: tools, libraries, image, permissions",
    "completion": "print a shell completion script",
}


def command_module(name: str) -> ModuleType:
    import importlib

    return importlib.import_module(f"plumb.cli.{name.replace('-', '_')}")


def command_parser(name: str) -> argparse.ArgumentParser:
    import argparse

    module = command_module(name)
    parser = argparse.ArgumentParser(
        prog=f"plumb {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add_arguments(parser)
    return parser
