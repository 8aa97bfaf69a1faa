"""Tasks of a board other than steps with one set of parameters; plumb.systems.tasks lists the kinds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from plumb.boards.contract import Answer
from plumb.systems.tasks import Task


@runtime_checkable
class RunsTasks(Protocol):
    """A board that takes tasks."""

    task_kinds: Sequence[str]
    """The members of KINDS that the board supports."""

    def run_task(self, task: Task) -> Answer:
        """The digest of every step or table, with its words where the board has them."""

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        """Every word of one step or table by name; {} when the board gives none."""
