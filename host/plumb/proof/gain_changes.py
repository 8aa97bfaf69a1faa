"""Changes of gains at given times of a live run: SECONDS:NAME=VALUE, in the units of `plumb params`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plumb.contract.parameters import Change, Changes, ControlParams
from plumb.errors import UsageError
from plumb.link import parameter_table
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec.parameter_file import by_name
from plumb.tuning import quantities
from plumb.tuning.quantities import Value


@dataclass(frozen=True)
class GainChange:
    """One change. at_s: from the first step of the run on; name: as the user wrote it."""

    at_s: float
    name: str
    value: str


def parse(text: str) -> GainChange:
    """A change of the command line; raises UsageError."""
    at, colon, assignment = text.partition(":")
    name, equals, value = assignment.partition("=")
    try:
        at_s = float(at)
    except ValueError:
        at_s = math.nan
    if not (colon and equals and name.strip() and 0.0 <= at_s < math.inf):
        raise UsageError(f"'{text:.80}' is no change: write SECONDS:NAME=VALUE, for example 3:pid.kp=0.06")
    return GainChange(at_s, name.strip(), value.strip())


class GainChanges:
    """Commits the changes of a run at their times. Raises UsageError at once for an unknown name, an invalid value, or
    a time after the run."""

    def __init__(self, session: Session, wanted: Sequence[GainChange], period_s: float, steps: int) -> None:
        table = by_name(session.read_parameters()) if wanted else {}
        self._session = session
        self._waiting: list[tuple[int, Mapping[str, Value]]] = []
        for one in sorted(wanted, key=lambda one: one.at_s):
            values = quantities.assignments([f"{one.name}={one.value}"], table)
            quantities.changed(table, values)
            step = math.ceil(one.at_s / period_s)
            if step >= steps:
                raise UsageError(f"the change of {one.name} at {one.at_s:g} s comes after the run of {steps} steps")
            self._waiting.append((step, values))

    def commit(self, step: int) -> None:
        """Commit the changes that are due at this step. Raises UsageError when the board refuses one."""
        while self._waiting and self._waiting[0][0] <= step:
            _, values = self._waiting.pop(0)
            table = by_name(self._session.read_parameters())
            parameter_table.commit(self._session, quantities.changed(table, values), table)


def changes_of(capture: Capture, params: ControlParams, steps: int) -> tuple[Changes, int | None]:
    """The changes that the board announced in a run of `steps` steps, and the first step whose parameters are unknown;
    None where all are known."""
    found: list[Change] = []
    for change in capture.tables.changes:
        if change.step >= steps:
            break
        known = change.params(params)
        if known is None:
            return found, change.step
        found.append(Change(change.step, known))
    return found, None
