"""Setpoint and commands of a run in real time, in units."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.api import arguments
from plumb.errors import UsageError
from plumb.link.session import Session
from plumb.spec import declarations
from plumb.spec.signal_units import scale_of, setpoint_signal


def _require_run(live: bool) -> None:
    if not live:
        raise UsageError("there is no run to give a setpoint to: arm the board, or begin a stream first")


def set_setpoint(session: Session, value: float, *, live: bool) -> None:
    """Set the setpoint in the unit of its system. live: a run is on. Raises UsageError without one, for a value that
    its integer cannot hold, and for a system without a setpoint."""
    _require_run(live)
    system = session.system
    signal = setpoint_signal(system)
    if signal is None:
        raise UsageError(f"{system} has no setpoint")
    most = ((1 << 31) - 1) * signal.scale
    if value is None or not abs(value) <= most:
        raise UsageError(
            f"a setpoint of {arguments.shown(value)} {signal.unit}: give one of at most {most:g} {signal.unit}"
        )
    session.set_setpoint(round(value / signal.scale))


def set_commands(session: Session, values: Mapping[str, float], *, live: bool) -> None:
    """Set all commands at once, in the units of their declaration. live: a run is on. Raises UsageError without one,
    for an unknown name, and for a value that is no number or beyond its limits."""
    _require_run(live)
    arguments.require_mapping(values=values)
    declared = declarations.system(session.system)
    known = {command.name: command for command in declared.step_commands}
    integers = {}
    for name, value in values.items():
        command = known.get(name)
        if command is None:
            raise UsageError(f"{declared.name} has no command '{name}'; it has {', '.join(known) or 'none'}")
        arguments.require_number(**{name: value})
        unit, scale = scale_of(command.unit, command.format)
        low, high = command.low, command.high
        if value is None or not low * scale <= value <= high * scale:
            given = f"{name} = {arguments.shown(value)} {unit}".rstrip()
            raise UsageError(f"{given}: give {low * scale:g} to {high * scale:g} {unit}".rstrip())
        integers[name] = round(value / scale)
    session.set_commands(integers)
