"""The parameters of a recorded run: from the blocks of a log, and from the frames that read or committed a table."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plumb.contract.parameters import Change, Changes, ControlParams, groups_of
from plumb.errors import UsageError
from plumb.link.used_tables import TableChange, UsedTables
from plumb.readers.log_file import Frames, ParameterSet
from plumb.readers.logged_runs import LoggedRun
from plumb.spec import declarations, parameters
from plumb.spec.protocol import Protocol, check
from plumb.spec.system import group_of
from plumb.tuning.variances import from_turn2_q56

MOST_CHANGES = 10_000
"""Most changes of parameters in one run: two a second, for more than an hour."""
_NEEDED = ("PARAM_VALUE", "PARAM_STAGED", "PARAM_SET", "PARAM_COMMIT", "ACK", "HELLO")


@dataclass(frozen=True)
class UsedParameters:
    """The parameters of one run. params: what the step reads; table: every known value by name."""

    params: ControlParams
    table: dict[str, int]

    @property
    def system(self) -> str:
        return self.params.system


def received_sets(blocks: Iterable[Frames], messages: Protocol) -> list[ParameterSet]:
    """The tables in a recording's own frames: read with PARAM_GET, or staged and committed. A table is known once all
    its parameters were received; the sets after the first hold the changes."""
    ids = {messages[name].identifier: name for name in _NEEDED}
    rows = parameters.table()
    used: dict[int, int] = {}
    staged: dict[int, int] = {}
    found: list[ParameterSet] = []
    for at, identifier, data in _frames_with(list(ids), blocks):
        name, said = ids[identifier], messages[ids[identifier]].decode(data)
        if name == "PARAM_VALUE":
            complete = len(used) == len(rows)
            changed = used.get(said["index"]) != said["value"]
            used[said["index"]] = said["value"]
            if changed and len(used) == len(rows):
                found.append(_set(int(at) + 1, {said["index"]: said["value"]} if complete else used))
        elif name in ("PARAM_SET", "PARAM_STAGED"):
            staged[said["index"]] = said["value"]
        elif name == "HELLO":
            staged = {}
        elif name == "ACK" and said["request"] == messages["PARAM_COMMIT"].identifier:
            complete, fresh = len(used) == len(rows), staged
            used, staged = {**used, **staged}, {}
            if len(used) == len(rows):
                found.append(_set(int(at) + 1, fresh if complete else used))
    return found


def of_another_version(blocks: Iterable[Frames], messages: Protocol) -> str:
    """That a recording's frames carry a whole table of another number of parameters, as a sentence; "" when not."""
    message = messages["PARAM_VALUE"]
    heard = {message.decode(data)["index"] for _, _, data in _frames_with([message.identifier], blocks)}
    rows = len(parameters.table())
    if len(heard) < 2 or len(heard) == rows or heard != set(range(len(heard))):
        return ""
    return (
        f"its frames carry {len(heard)} parameters, this version of plumb has {rows}: replay it by the version "
        "that was recorded"
    )


def _frames_with(identifiers: Sequence[int], blocks: Iterable[Frames]) -> Iterator[tuple[int, int, bytes]]:
    """Place, identifier and data of the frames that have one of the identifiers and are whole."""
    begin = 0
    for frames in blocks:
        for at in np.flatnonzero(np.isin(frames["can_id"], identifiers)).tolist():
            identifier, data = int(frames["can_id"][at]), frames["data"][at].tobytes()
            if int(frames["length"][at]) == 8 and check(identifier, data):
                yield begin + at, identifier, data
        begin += len(frames)


def changes_of_run(
    run: LoggedRun, used: UsedParameters, blocks: Sequence[ParameterSet], messages: Protocol
) -> tuple[Changes, TableChange | None]:
    """The changes of the parameters in the middle of a run up to the first one that is not known, and that one. blocks:
    the parameters that the log holds in addition to its frames."""
    rows = parameters.table()
    whole = all(row.name in used.table for row in rows)
    tables = UsedTables(messages, [used.table[row.name] for row in rows] if whole else None)
    own = used.params.own()
    later = [one for one in blocks if one.at in run.marks]
    for frame in (*run.table_frames, None):
        while later and (frame is None or later[0].at <= frame.at):
            block = later.pop(0)
            values = {name: value for name, value in block.values.items() if name in own}
            tables.table_said(values, run.marks[block.at])
        if frame is not None:
            tables.feed(frame.identifier, frame.data, frame.next_step)
    changes: list[Change] = []
    for change in tables.changes:
        if change.step >= run.first + run.steps:
            break
        params = change.params(used.params)
        if params is None or change.step < 0 or (changes and change.step < changes[-1].step):
            return changes, change
        if len(changes) == MOST_CHANGES:
            raise UsageError(f"a run of this recording has more than {MOST_CHANGES} changes of parameters")
        changes.append(Change(change.step, params))
    return changes, None


def _set(at: int, words: dict[int, int]) -> ParameterSet:
    rows = parameters.table()
    return ParameterSet(at, {row.name: row.from_word(words[i]) for i, row in enumerate(rows) if i in words})


class ParametersInUse:
    """The parameters in use at places in the frames. where: the file, for the error text.

    Places are asked for in their order as a rule; then each set is looked at once, however many runs there are.
    """

    def __init__(self, sets: Sequence[ParameterSet], where: str) -> None:
        self._sets, self._where = sorted(sets, key=lambda one: one.at), where
        self._values: dict[str, int] = {}
        self._taken = 0
        self._used: UsedParameters | None = None

    def at(self, place: int) -> UsedParameters:
        """Those at a place. Raises UsageError when there are none, or when this version reads others."""
        taken = bisect_right(self._sets, place, key=lambda one: one.at)
        if taken < self._taken:
            self._values, self._taken, self._used = {}, 0, None
        if taken > self._taken or self._used is None:
            for one in self._sets[self._taken : taken]:
                self._values |= one.values
            self._taken, self._used = taken, None
            self._used = _used_parameters(dict(self._values), self._where)
        return self._used


def _used_parameters(values: dict[str, int], where: str) -> UsedParameters:
    """Raises UsageError for values without a system, or that this version does not read."""
    if "system" not in values:
        raise UsageError(
            f"{where} holds no parameters of that run: give them as a file of `plumb params dump` with --params"
        )
    known = {system.number: system.name for system in declarations.systems().values()}
    if values["system"] not in known:
        raise UsageError(f"{where} is of system {values['system']}, which this plumb does not have; update it")
    system = known[values["system"]]
    groups = groups_of(system)
    own = {name: value for name, value in values.items() if group_of(name) in groups}
    context = from_turn2_q56(values.get(parameters.UNIT, 0))
    try:
        return UsedParameters(ControlParams.of(system, own, context), values)
    except UsageError as error:
        raise UsageError(f"the parameters in {where} do not fit this version of plumb: {error}") from None
