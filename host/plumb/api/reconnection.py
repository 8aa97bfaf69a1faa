"""Find a lost board again: wait until it answers, check that it is the same one, and say what is different on it.

Nothing here arms. A board disarms itself when its host is gone, and stays disarmed when the host is back.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from plumb.api.live import Gap, Sample
from plumb.boards.link import LinkBoard
from plumb.errors import LinkError, UsageError
from plumb.link import monitor, parameter_table
from plumb.link.identity import Identity
from plumb.link.session import Session
from plumb.spec import declarations, parameters
from plumb.spec.parameter_file import by_name
from plumb.tuning import quantities
from plumb.tuning.quantities import Value

RECONNECT_INTERVAL_S = 0.5
"""Pause between two attempts to open the board."""


class AnotherBoardError(LinkError):
    """Another board answers than the one that was lost: waiting does not mend that."""


@dataclass(frozen=True)
class Before:
    """State of a board when it was lost.

    table: its parameters, None if they were never read. run_tag: of the run that was begun here, None without one.
    step, armed: of the last sample of that run, None without one; received_s: when it came. lost_s: when the loss was
    noticed. Both by this computer's clock.
    """

    reason: str
    identity: Identity
    table: tuple[int, ...] | None
    run_tag: int | None
    step: int | None
    armed: bool
    received_s: float
    period_s: float
    lost_s: float = field(default_factory=time.monotonic)

    def near(self) -> int:
        """About the number of the step that the run is at, if it goes on."""
        return 0 if self.step is None else self.step + round((time.monotonic() - self.received_s) / self.period_s)

    def still(self, now: Before) -> Before:
        """The same loss, as the board was found and lost once more before a sample came."""
        return replace(self, run_tag=now.run_tag, step=now.step)


@dataclass(frozen=True)
class Found:
    """A board that is back. goes_on: whether the run that it was in is still on."""

    board: LinkBoard
    goes_on: bool
    changed: Mapping[str, tuple[Value | None, Value | None]]
    image_changed: bool

    def gap(self, before: Before, first: Sample) -> Gap:
        """The gap that ends with this sample."""
        steps = first.step - before.step - 1 if before.step is not None and self.goes_on else None
        seconds = time.monotonic() - before.received_s
        return Gap(before.reason, seconds, steps, before.armed, self.changed, self.image_changed)


class Reconnection:
    """How long a lost board is waited for, and how.

    open_: opens it again. patience_s: the longest wait, None for no limit. on_lost: called with the reason when the
    board is lost, before the wait. pause: waits between two attempts.
    """

    def __init__(
        self, open_: Callable[[], LinkBoard], patience_s: float | None, on_lost: Callable[[str], None] | None
    ) -> None:
        self._open, self._patience_s, self._on_lost = open_, patience_s, on_lost
        self.pause: Callable[[float], None] = time.sleep

    def find(self, name: str, before: Before, end_s: float | None = None) -> Found | None:
        """Wait for the board; None when end_s, by this computer's clock, comes first.

        Raises LinkError when patience_s has passed, or when what answers is another board or has another version.
        """
        if self._on_lost is not None:
            self._on_lost(before.reason)
        while end_s is None or time.monotonic() < end_s:
            self.pause(RECONNECT_INTERVAL_S)
            try:
                return self._look(name, before)
            except AnotherBoardError:
                raise
            except LinkError as error:
                if self._patience_s is not None and time.monotonic() - before.lost_s >= self._patience_s:
                    raise LinkError(f"{name} did not come back within {self._patience_s:g} s: {error}") from None
        return None

    def _look(self, name: str, before: Before) -> Found:
        board = self._open()
        try:
            identity = board.session.identity or board.session.connect()
            if identity.unique_id != before.identity.unique_id:
                raise AnotherBoardError(
                    f"another board answers at {name}: {identity.unique_id}, it was {before.identity.unique_id}; "
                    "connect anew if that is meant"
                )
            if identity.mismatch and not before.identity.mismatch:
                raise AnotherBoardError(identity.mismatch)
            goes_on = _goes_on(board.session, name, before.run_tag)
            changed = changes(board.session, before.table)
            return Found(board, goes_on, changed, identity.git_hash != before.identity.git_hash)
        except BaseException:
            with contextlib.suppress(LinkError):
                board.close()
            raise


def _goes_on(session: Session, name: str, run_tag: int | None) -> bool:
    """Whether the run with this tag is still on. Raises AnotherBoardError for a run of another program."""
    mode, tag = monitor.present_run(session)
    if run_tag is None or mode == "IDLE":
        return mode != "IDLE"
    if tag != run_tag:
        raise AnotherBoardError(f"{name} is back, but another program has begun a run on it: connect again to end that")
    return True


def changes(session: Session, before: tuple[int, ...] | None) -> dict[str, tuple[Value | None, Value | None]]:
    """The parameters that are not as in `before`, by whole name, with both values; None for one that the other table
    does not have, because the board runs another system. The CRC-32 of the board says whether any differs."""
    identity = session.identity or session.connect()
    if before is None or identity["PARAMETER_CRC"] == parameters.crc32(before):
        return {}
    old, new = by_name(before), by_name(parameter_table.read_table(session))
    if old["system"] != new["system"]:
        return {"system": (declarations.name_of(old["system"]), declarations.name_of(new["system"]))}
    try:
        here, there = quantities.values_of(old), quantities.values_of(new)
        return {name: (here[name], there[name]) for name in quantities.differing(old, new)}
    except UsageError:  # integers that no tuning has
        return {name: (old[name], new[name]) for name in old if old[name] != new[name]}
