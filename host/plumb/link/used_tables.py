"""The parameter tables that the steps of a run used: the first one, and those that were committed while it went on.

A board that takes another table during a run sends PARAM_USED on every link: the first step that used the table, and
its CRC-32. The words themselves are seen on the link of the host that wrote them (PARAM_SET, PARAM_STAGED); every other
host reads the table from the board (PARAM_VALUE). However the words came, a table counts as known only when its CRC-32
is the one of PARAM_USED. A log, the bridge's shadow and the light of the cockpit follow a run with this class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.spec.protocol import Protocol
from plumb.tuning.quantise import ControlParams

ALL_PARAMETERS = 0xFFFF
"""Index of PARAM_GET that asks for the whole table."""
ASK_EVERY_S = 1.0
"""Pause between two requests for the table: the board sends it in the gaps between its telemetry."""
ASKED_MOST = 5
"""Requests before the table counts as lost."""
TABLE_MESSAGES = ("PARAM_SET", "PARAM_STAGED", "PARAM_VALUE", "PARAM_USED", "ACK", "HELLO", "IDENTITY")
"""Messages that tell what a board's table is, and since when."""


@dataclass
class TableChange:
    """Another table from `step` on. crc32: as the board said; words: None while they are not known; announced: the
    board named the step, else `step` is the first one that may have used the table."""

    step: int
    crc32: int | None
    words: tuple[int, ...] | None = None
    announced: bool = True

    def params(self, before: ControlParams) -> ControlParams | None:
        """The parameters for a step of the run that had those of `before`; None when they are not known, or not of the
        same system."""
        if not self.announced or self.words is None or len(self.words) != len(parameters.table()):
            return None
        try:
            params = ControlParams.from_words(parameters.control_part(self.words), before.lsb_deg2)
        except UsageError:
            return None
        return params if params.system == before.system else None

    @property
    def why_unknown(self) -> str:
        """Why the steps from this one on cannot be verified, when `params` gives none."""
        if not self.announced:
            return f"another table was committed about step {self.step}, and the frame that tells the step is missing"
        if self.step < 0:
            return "the frame that tells the first step of other parameters names one before the run"
        return f"the parameters changed at step {self.step}, and nothing tells the new ones"


class UsedTables:
    """Follows the table of a run. words: the table at its beginning, None where it is not known. changes: of this run,
    in the order of their steps."""

    def __init__(self, messages: Protocol, words: Sequence[int] | None = None) -> None:
        self.changes: list[TableChange] = []
        self._messages = messages
        self._names = {messages[name].identifier: name for name in TABLE_MESSAGES if name in messages.messages}
        self._commit, self._begin = (messages[name].identifier for name in ("PARAM_COMMIT", "RUN_BEGIN"))
        self._count = len(parameters.table())
        self._words = None if words is None else _unsigned(words)
        self._staged: dict[int, int] = {}
        self._read: dict[int, int] = {}
        self._asked, self._asked_s = 0, 0.0

    @property
    def identifiers(self) -> frozenset[int]:
        """Of the messages that `feed` wants."""
        return frozenset(self._names)

    def feed(self, identifier: int, data: bytes, next_step: int) -> None:
        """A frame of the link with a right CRC. next_step: the one after the last step that was received."""
        name = self._names.get(identifier)
        if name is None:
            return
        said = self._messages[name].decode(data)
        if name in ("PARAM_SET", "PARAM_STAGED"):
            self._staged[said["index"]] = said["value"] & 0xFFFFFFFF
        elif name in ("HELLO", "IDENTITY"):  # a greeting discards what the same link has staged
            self._staged = {}
        elif name == "PARAM_VALUE":
            self._read[said["index"]] = said["value"] & 0xFFFFFFFF
            self._resolve()
        elif name == "PARAM_USED":
            ahead = (said["step"] - next_step + 0x8000 & 0xFFFF) - 0x8000
            self._change(TableChange(next_step + ahead, said["crc"]))
        elif said["request"] == self._begin:
            self._words = None if self._pending else self._words
            self.changes = []
        elif said["request"] == self._commit:
            last = self.changes[-1].crc32 if self.changes else self._crc32()
            if last != said["detail"]:  # PARAM_USED came before, and was lost
                self._change(TableChange(next_step, said["detail"], announced=False))

    def table_said(self, values: Mapping[str, int], next_step: int) -> None:
        """A block of a log: parameters by name that are in use from its place on."""
        for index, row in enumerate(parameters.table()):
            if row.name in values:
                self._read[index] = values[row.name] & 0xFFFFFFFF
        self._resolve()
        known = dict(enumerate(self._words or ()))
        if not self._pending and any(known.get(index, word) != word for index, word in self._read.items()):
            self._change(TableChange(next_step, None, announced=False))

    @property
    def _pending(self) -> bool:
        """Whether the table of the last change is not known."""
        return bool(self.changes) and self.changes[-1].words is None

    def ask(self, now_s: float) -> bool:
        """Whether to ask the board for its table now, because that of the last change has not been seen."""
        if not self._pending or self._asked > ASKED_MOST or (self._asked and now_s - self._asked_s < ASK_EVERY_S):
            return False
        self._asked, self._asked_s = self._asked + 1, now_s
        return self._asked <= ASKED_MOST

    def lost(self, change: TableChange) -> bool:
        """Whether the parameters of a change will not be known any more: the board does not send its table, has another
        by now, or did not say the step."""
        given_up = change is not self.changes[-1] or self._asked > ASKED_MOST
        return not change.announced or (change.words is None and given_up)

    def _change(self, change: TableChange) -> None:
        self.changes.append(change)
        self._asked = 0
        if change.crc32 is not None:
            self._read = {}
        self._resolve()

    def _resolve(self) -> None:
        """Find the words of the last change among what was staged and what was read."""
        if not self.changes:
            if self._words is None and len(self._read) >= self._count:
                self._words = tuple(self._read[index] for index in range(len(self._read)) if index in self._read)
            return
        if not self._pending:
            return
        change = self.changes[-1]
        for seen in (self._read,) if change.crc32 is None else (self._staged, self._read):
            known = dict(enumerate(self._words or ())) | seen
            words = tuple(known[index] for index in range(len(known)) if index in known)
            whole = len(words) == len(known) == max(self._count, len(self._words or ()))
            if whole and change.crc32 in (None, parameters.crc32(words)):
                change.words = self._words = words
                self._staged, self._read = {}, {}
                return

    def _crc32(self) -> int | None:
        return None if self._words is None else parameters.crc32(self._words)


def _unsigned(words: Sequence[int]) -> tuple[int, ...]:
    return tuple(word & 0xFFFFFFFF for word in words)
