"""The steps around a first divergence: the signal that diverged, from the model and from the board."""

from __future__ import annotations

from dataclasses import dataclass

from plumb.boards.contract import GivesWordsOfSteps, StepBoard
from plumb.contract import run_fixed
from plumb.proof.golden_file import Vector
from plumb.proof.golden_result import VectorResult
from plumb.spec import declarations
from plumb.spec.records import Words

AROUND_STEPS = 50
"""Steps shown before and after the step that differs first."""


@dataclass(frozen=True)
class Window:
    """Steps `first` to `first + len(expected) - 1` of one vector on one board.

    board: as the command line names it. signal: the word of the record, or "digest" where no word is known. unit: of
    the integers, empty for a digest. actual: None for a step that the board did not answer.
    """

    board: str
    result: VectorResult
    signal: str
    unit: str
    first: int
    expected: list[int]
    actual: list[int | None]

    @property
    def end(self) -> int:
        """The step after the last one."""
        return self.first + len(self.expected)


def window(board: StepBoard, board_name: str, vector: Vector, result: VectorResult) -> Window | None:
    """Runs the board again up to a little after the difference. None when the board does not differ: its answers
    were lost, the vector's file is wrong, or it is not a vector of steps."""
    found = result.first_divergence
    if found is None or found.in_file or vector.task is not None:
        return None
    first, end = max(0, found.step - AROUND_STEPS), min(len(vector.raw), found.step + AROUND_STEPS + 1)
    model = run_fixed.run_control(vector.params, vector.raw[:end], vector.setpoint[:end])
    signal, unit = found.signal, ""
    actual: list[int | None]
    words = None if signal in ("digest", "steps") else _words_between(board, vector, first, end)
    if words is None:
        signal, expected = "digest", [int(digest) for digest in model.digests()[first:end]]
        answer = board.run_injected(vector.params, vector.raw[:end], vector.setpoint[:end]).digests[first:end]
        actual = [int(digest) for digest in answer]
    else:
        unit = unit_of(vector.system, signal)
        expected, actual = model[signal][first:end].tolist(), list(words[signal].tolist())
    return Window(board_name, result, signal, unit, first, expected, actual + [None] * (end - first - len(actual)))


def _words_between(board: StepBoard, vector: Vector, first: int, end: int) -> Words | None:
    if isinstance(board, GivesWordsOfSteps):
        return board.words_of_steps(vector.params, vector.raw, vector.setpoint, first, end)
    words = board.run_injected(vector.params, vector.raw[:end], vector.setpoint[:end]).words
    return None if words is None else Words(words.record[first:end])


def unit_of(system: str, signal: str) -> str:
    """Unit and format of a word's integers as its declaration has them, for example `turn Q32`, or `count`."""
    word = next(word for word in declarations.system(system).words if word.name == signal)
    return " ".join(part for part in (word.unit, word.format) if part and part != "integer")
