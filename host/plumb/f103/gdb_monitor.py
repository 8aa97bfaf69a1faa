"""The commands of gdb's `monitor` on the simulated chip, each with an answer of a few lines."""

from __future__ import annotations

from collections.abc import Callable

from plumb.f103.debug_hold import Chip


def answer(machine: Chip, command: str) -> str:
    """What the command says; an unknown one names all."""
    known = COMMANDS.get(command.strip() or "help")
    return f"there is no '{command.strip()}'\n{_help(machine)}" if known is None else known(machine)


def _reset(machine: Chip) -> str:
    machine.reset()
    return f"reset pin pulled: pc 0x{machine.cpu.pc:08x}, sp 0x{machine.cpu.stack:08x}; flushregs makes gdb look"


def _halt(machine: Chip) -> str:
    return "it stands: " + _time(machine)


def _time(machine: Chip) -> str:
    return f"{machine.now_us:.3f} us, {machine.cpu.instructions} instructions, since power-up"


def _faults(machine: Chip) -> str:
    told = [str(fault) for fault in machine.program_faults[-5:]] or ["the program took no fault"]
    return "\n".join([*told, *(f"warning: {text}" for text in machine.warnings)])


def _pins(machine: Chip) -> str:
    """Levels port by port, the highest pin first, and the pulses."""
    lines = []
    for port in machine.ports:
        levels = ["-" if level is None else str(int(level)) for level in map(port.level, range(15, -1, -1))]
        lines.append(f"{port.name} 15..0  {' '.join(levels)}")
    return "\n".join([*lines, "-: floating, or an analog input"])


def _help(_machine: Chip) -> str:
    return "monitor " + "|".join(COMMANDS)


COMMANDS: dict[str, Callable[[Chip], str]] = {
    "reset": _reset, "halt": _halt, "time": _time, "faults": _faults, "pins": _pins, "help": _help,
}  # fmt: skip
