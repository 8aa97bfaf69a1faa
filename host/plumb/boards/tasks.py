"""What a board is asked beside the steps of one set of parameters: plumb.systems.tasks has the kinds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from plumb.boards.contract import Answer
from plumb.systems.tasks import Task


@runtime_checkable
class RunsTasks(Protocol):
    """A board that takes tasks."""

    task_kinds: Sequence[str]
    """Those of KINDS that it can."""

    def run_task(self, task: Task) -> Answer:
        """The digests of every step or table; with their words where the board has them."""

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        """Every word of one step or table by name; {} when the board gives none."""
