"""The commands by name, one sentence each.

A command is the module of its name in this package. A system may have commands of its own: its system.toml declares
them, and their modules are in its folder `commands`.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    import argparse
    from types import ModuleType

COMMANDS = {
    "demo": "close the loop on the virtual board, then check the golden vectors; writes a report",
    "run": "run one system's scenario on a board and compare every step with the model",
    "campaign": "run thousands of runs of a study on all cores or a cluster: figures with intervals",
    "golden": "make the golden vectors, or check boards against them",
    "replay": "run a log, or a recording of real sensors, through a board, and compare every step with the model",
    "estimate": "roll, pitch, rate about the vertical and sigma of a recording, as CSV in degrees with a page",
    "check": "audit a recording by physics: units, axes, signs, clock, lags, limits, the reference",
    "compare": "tilt errors of VQF, Madgwick, Mahony and plumb's systems on recordings with a reference",
    "systems": "list the systems and their presets; compare their figures with the published ones",
    "virtual-board": "serve the simulated STM32F103: its UART on a pty or TCP port, its CAN on any bus",
    "monitor": "watch a running board: tilt, bias, pulses, mode, counters, losses",
    "cockpit": "open a live page of a board: plots, attitude, health, arming, recordings",
    "fly": "fly a simulated vehicle in the browser, by keyboard or gamepad",
    "ride": "ride a simulated vehicle in the browser, by keyboard or gamepad",
    "record": "record a running board, or a bus, to a log",
    "export": "write a log as CSV, blackbox CSV, Parquet, BLF, ASC, candump, TRC or MF4",
    "params": "read, change, save and restore a board's parameters",
    "tune": "find settings from measurements: sensor noise, Q and R of the filter, gains of the PID",
    "setup": "first steps with a board: find, flash, system, sensors, calibration, green light",
    "calibrate": "calibrate a board's sensors by poses and one turn: biases, scales, signs",
    "sensor-board": "simulate a sensor board: samples in real time as frames on a bus",
    "bridge": "forward frames between a sensor board and a board; show a board to a MAVLink ground station",
    "link-test": "test a link: losses, damaged frames, rates and latency",
    "flash": "write the flash image to a board over its ROM bootloader, and read it back",
    "faults": "inject faults into the armed flash image, and compare the reactions with their limits",
    "bench": "measure instructions, cycles, bytes, stack and error of the kernels against their budgets",
    "ports": "list serial ports, served boards and CAN interfaces, and which port answers as a board",
    "settings": "show or change what plumb remembers: the board, the port",
    "doctor": "check this machine: tools, libraries, image, permissions",
    "completion": "print a shell completion script",
}


def commands() -> dict[str, str]:
    """Name -> sentence of every command: those above, then those that the systems declare. Raises UsageError if two
    have the same name."""
    from plumb.errors import UsageError
    from plumb.spec import declarations

    found = dict(COMMANDS)
    for system in declarations.systems().values():
        for name, text in system.commands.items():
            if name in found:
                raise UsageError(f"{system.folder / 'system.toml'}: there is a command '{name}' already: {found[name]}")
            found[name] = f"{text} ({system.name})"
    return found


def command_module(name: str) -> ModuleType:
    """The module of a command; raises UsageError for an unknown name."""
    import importlib

    if name in COMMANDS:
        return importlib.import_module(f"plumb.cli.{name.replace('-', '_')}")
    from plumb.errors import UsageError
    from plumb.near_names import did_you_mean
    from plumb.spec import declarations

    for system in declarations.systems().values():
        if name in system.commands:
            return importlib.import_module(f"plumb.judging.{system.name}.commands.{name.replace('-', '_')}")
    raise UsageError(f"there is no command '{name}'{did_you_mean(name, commands())}; `plumb --help` lists them.")


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
