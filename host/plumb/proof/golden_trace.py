"""Trace a vector that a board fails to the step and signal at which they first differ.

The integer model runs again, and so does a board that gave only digests. When the model no longer agrees with the file,
but the C core does, the words of the C core are taken as right, so that a mismatch of `fixed` is traced to a signal,
too. When neither agrees, the file is wrong, and its recipe shows which number was changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.boards.contract import Answer, StepBoard
from plumb.boards.native import core as native_core
from plumb.boards.tasks import RunsTasks
from plumb.contract import run_fixed
from plumb.proof.compare import Divergence, divergence_at, first_digest_divergence, first_divergence
from plumb.proof.golden_file import Vector
from plumb.proof.golden_recipe import Entry
from plumb.spec.records import Words
from plumb.systems import run_tasks


def trace(board: StepBoard, entry: Entry, vector: Vector, answer: Answer) -> Divergence | None:
    """The first difference between a vector and a board's answer, None when there is none. entry: its recipe."""
    compared = slice(0, answer.unverified_from)
    step = first_digest_divergence(vector.digests[compared], answer.digests[compared])
    if step is None:
        return _first_in_words(vector, answer)
    model = _model(vector)
    right = model
    differs = first_digest_divergence(model.digests(), vector.digests)
    if differs is not None and differs <= step:
        core = _core(vector)
        if not np.array_equal(core.digests()[: step + 1], vector.digests[: step + 1]):
            return _first_in_file(entry, vector, model, differs)
        right = core

    def words_of_step(step: int) -> dict[str, int]:
        if answer.words is not None:
            return {name: int(values[step]) for name, values in answer.words.items()}
        if vector.task is not None and isinstance(board, RunsTasks):
            return board.words_of_task(vector.task, step)
        return board.words_of_step(vector.params, vector.raw, vector.setpoint, step)

    return _of(vector, first_divergence(Words(right.record[compared]), answer.digests[compared], words_of_step))


def _model(vector: Vector) -> Words:
    if vector.task is not None:
        return run_tasks.run_task(vector.task)
    return run_fixed.run_control(vector.params, vector.raw, vector.setpoint)


def _core(vector: Vector) -> Words:
    if vector.task is not None:
        return native_core.run_task(vector.task)
    return native_core.run_control(vector.params, vector.raw, vector.setpoint)


def _of(vector: Vector, found: Divergence | None, in_file: bool = False) -> Divergence | None:
    return None if found is None else replace(found, vector=vector.name, in_file=in_file)


def _first_in_words(vector: Vector, answer: Answer) -> Divergence | None:
    """Every digest is right: compare the words that came with them, and the final words of the file."""
    words: Words | None = answer.words
    if words is None:
        return None
    step = first_digest_divergence(answer.digests, words.digests())
    if step is not None:
        model = Words(_model(vector).record[: step + 1])
        found = first_divergence(model, Words(words.record[: step + 1]))
        if found is not None:
            return _of(vector, found)
    last = len(vector.raw) - 1
    if all(vector.final.get(name) == int(values[last]) for name, values in words.items()):
        return None
    return _of(vector, divergence_at(last, words, vector.final, None), in_file=True)


def _first_in_file(entry: Entry, vector: Vector, model: Words, step: int) -> Divergence | None:
    """The file disagrees with the model on its own inputs: the inputs from its recipe show which number was changed.

    Every record begins with the raw counts and the setpoint as given: an input that was changed is its first signal.
    """
    task = entry.task()
    fresh = run_fixed.run_control(*entry.inputs()) if task is None else run_tasks.run_task(task)
    changed = first_divergence(fresh, model)
    return _of(vector, changed or divergence_at(step, fresh, {}, int(vector.digests[step])), in_file=True)
