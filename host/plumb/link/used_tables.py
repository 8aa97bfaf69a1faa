"""The parameter tables that the steps of a run used: the first one, and those that were committed while it went on.

A board that takes another table during a run sends PARAM_USED on every link: the first step that used the table, and
its CRC-32. The words themselves are seen on the link of the host that wrote them (PARAM_SET, PARAM_STAGED); every other
host reads the table from the board (PARAM_VALUE). However the words came, a table counts as known only when its CRC-32
is the one of PARAM_USED. A log, the bridge's shadow and the light of the cockpit follow a run with this class.

What is known of the table in use is a `TableState`; `NEXT` has every way from one to another. The words that it is made
of are `SeenWords`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.link.seen_words import SeenWords, unsigned, whole
from plumb.spec import parameters
from plumb.spec.protocol import Protocol

ALL_PARAMETERS = 0xFFFF
"""Index of PARAM_GET that asks for the whole table."""
ASK_EVERY_S = 1.0
"""Pause between two requests for the table: the board sends it in the gaps between its telemetry."""
ASKED_MOST = 5
"""Requests before the table counts as lost."""
TABLE_MESSAGES = ("PARAM_SET", "PARAM_STAGED", "PARAM_VALUE", "PARAM_USED", "ACK", "HELLO", "IDENTITY")
"""Messages that report a board's table, and the first step that used it."""


class TableState(Enum):
    """Knowledge of the table in use."""

    UNREAD = auto()
    """No word of it is known, or not all, and no table has followed it since the run began."""
    KNOWN = auto()
    """All of its words."""
    PENDING = auto()
    """It has followed another one, and its words are not known: the board is asked for them."""
    LOST = auto()
    """The board was asked as often as makes sense. The words are still accepted if another host reads them."""


class TableEvent(Enum):
    """Frames that change the state."""

    FOUND = auto()
    """The words that were seen are those of the table in use."""
    CHANGED = auto()
    """The board uses another table."""
    BEGUN = auto()
    """A run began: with the table in use, and before any change."""
    GIVEN_UP = auto()
    """The last request for the table was not answered."""


NEXT = {
    (TableState.UNREAD, TableEvent.FOUND): TableState.KNOWN,
    (TableState.UNREAD, TableEvent.CHANGED): TableState.PENDING,
    (TableState.UNREAD, TableEvent.BEGUN): TableState.UNREAD,
    (TableState.KNOWN, TableEvent.CHANGED): TableState.PENDING,
    (TableState.KNOWN, TableEvent.BEGUN): TableState.KNOWN,
    (TableState.PENDING, TableEvent.FOUND): TableState.KNOWN,
    (TableState.PENDING, TableEvent.CHANGED): TableState.PENDING,
    (TableState.PENDING, TableEvent.BEGUN): TableState.UNREAD,
    (TableState.PENDING, TableEvent.GIVEN_UP): TableState.LOST,
    (TableState.LOST, TableEvent.FOUND): TableState.KNOWN,
    (TableState.LOST, TableEvent.CHANGED): TableState.PENDING,
    (TableState.LOST, TableEvent.BEGUN): TableState.UNREAD,
}
"""State and event -> the next state. No other event occurs in a state."""


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
            params = ControlParams.from_words(parameters.control_part(self.words), before.context)
        except UsageError:
            return None
        return params if params.system == before.system else None

    @property
    def why_unknown(self) -> str:
        """Why the steps from this one on cannot be verified, when `params` gives none."""
        if not self.announced:
            return f"another table was committed about step {self.step}, and the frame with the step is missing"
        if self.step < 0:
            return "the frame with the first step of other parameters names one before the run"
        return f"the parameters changed at step {self.step}, and no frame has the new ones"


class UsedTables:
    """Follows the table of a run. words: the table at its beginning, None where it is not known. changes: of this run,
    in the order of their steps. state: what is known of the table in use; seen: the words that may be of it."""

    def __init__(self, messages: Protocol, words: Sequence[int] | None = None) -> None:
        self.changes: list[TableChange] = []
        self.state = TableState.UNREAD if words is None else TableState.KNOWN
        self.seen = SeenWords()
        self._messages = messages
        self._names = {messages[name].identifier: name for name in TABLE_MESSAGES if name in messages.messages}
        self._commit, self._begin = (messages[name].identifier for name in ("PARAM_COMMIT", "RUN_BEGIN"))
        self._words = None if words is None else tuple(unsigned(word) for word in words)  # of the last known table
        self._asked, self._asked_s = 0, 0.0

    @property
    def identifiers(self) -> frozenset[int]:
        """Identifiers of the messages that `feed` takes."""
        return frozenset(self._names)

    def feed(self, identifier: int, data: bytes, next_step: int) -> None:
        """A frame of the link with a right CRC. next_step: the one after the last step that was received."""
        name = self._names.get(identifier)
        if name is None:
            return
        said = self._messages[name].decode(data)
        if name in ("PARAM_SET", "PARAM_STAGED"):
            self.seen.staged[said["index"]] = unsigned(said["value"])
        elif name in ("HELLO", "IDENTITY"):  # a greeting discards what the same link has staged
            self.seen.staged = {}
        elif name == "PARAM_VALUE":
            self.seen.read[said["index"]] = unsigned(said["value"])
            self._find()
        elif name == "PARAM_USED":
            ahead = (said["step"] - next_step + 0x8000 & 0xFFFF) - 0x8000
            self._change(TableChange(next_step + ahead, said["crc"]))
        elif said["request"] == self._begin:
            self._begin_run()
        elif said["request"] == self._commit:
            last = self.changes[-1].crc32 if self.changes else self._crc32()
            if last != said["detail"]:  # PARAM_USED came before, and was lost
                self._change(TableChange(next_step, said["detail"], announced=False))

    def table_said(self, values: Mapping[str, int], next_step: int) -> None:
        """A block of a log: parameters by name that are in use from its place on."""
        for index, row in enumerate(parameters.table()):
            if row.name in values:
                self.seen.read[index] = unsigned(values[row.name])
        self._find()
        known = dict(enumerate(self._words or ()))
        if not self._sought and any(known.get(index, word) != word for index, word in self.seen.read.items()):
            self._change(TableChange(next_step, None, announced=False))

    def ask(self, now_s: float) -> bool:
        """Whether to ask the board for its table now, because that of the last change has not been seen."""
        if self.state is not TableState.PENDING or (self._asked and now_s - self._asked_s < ASK_EVERY_S):
            return False
        if self._asked == ASKED_MOST:
            self._follow(TableEvent.GIVEN_UP)
            return False
        self._asked, self._asked_s = self._asked + 1, now_s
        return True

    def lost(self, change: TableChange) -> bool:
        """Whether the parameters of a change will not be known any more: the board does not send its table, has another
        by now, or did not say the step."""
        over = change is not self.changes[-1] or self.state is TableState.LOST
        return not change.announced or (change.words is None and over)

    @property
    def _sought(self) -> bool:
        """Whether the words of the last change are not known."""
        return self.state in (TableState.PENDING, TableState.LOST)

    def _follow(self, event: TableEvent) -> None:
        self.state = NEXT[self.state, event]

    def _begin_run(self) -> None:
        self._follow(TableEvent.BEGUN)
        if self.state is TableState.UNREAD:
            self._words = None
        self.changes = []

    def _change(self, change: TableChange) -> None:
        self._follow(TableEvent.CHANGED)
        self.changes.append(change)
        self._asked = 0
        if change.crc32 is not None:
            self.seen.read = {}  # of the table before
        self._find()

    def _find(self) -> None:
        """Look for the table in use among the words that were seen."""
        if self.state is TableState.UNREAD:
            self._words = whole(self.seen.read)
            if self._words is not None:
                self._follow(TableEvent.FOUND)
        elif self._sought:
            words = self.seen.table(self.changes[-1].crc32, self._words)
            if words is not None:
                self._follow(TableEvent.FOUND)
                self.changes[-1].words = self._words = words
                self.seen.clear()

    def _crc32(self) -> int | None:
        return None if self._words is None else parameters.crc32(self._words)
