"""Golden vectors: files with inputs and the expected digests, which the integer model makes from a written recipe.

plumb.proof.golden_recipe reads the recipe, plumb.proof.golden_file is the container, plumb.proof.golden_manifest lists
the vectors that a full check must run. A check starts only when recipe, manifest and files agree and the C library
finds the parameters valid.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from plumb.boards import Answer, Board, native_core
from plumb.checkout import CHECKOUT
from plumb.errors import UsageError
from plumb.proof import golden_manifest, golden_recipe
from plumb.proof.compare import (
    Divergence,
    count_mismatches,
    divergence_at,
    first_digest_divergence,
    first_divergence,
)
from plumb.proof.golden_file import FORMAT, MAX_FILE_BYTES, SUFFIX, Vector, read_bounded
from plumb.spec.records import Words
from plumb.systems import run_fixed

__all__ = ["FORMAT", "SUFFIX", "Case", "Divergence", "Result", "Vector", "build", "cases", "check", "load", "make"]

RECIPE = "recipe.toml"
WHOLE_BOARDS = ("fixed", "native", "qemu")
"""Boards that run every vector; the others run those marked `on_link`."""


def vectors_folder(folder: Path | None = None) -> Path:
    """`folder`, or the checkout's tests/vectors; raises UsageError when it has no recipe."""
    candidates = [folder] if folder else [Path.cwd() / "tests/vectors", CHECKOUT / "tests/vectors"]
    for candidate in candidates:
        if (candidate / RECIPE).is_file():
            return candidate
    raise UsageError(f"{candidates[0]} holds no {RECIPE}; run from a checkout of plumb, or name the folder: --vectors")


def build(entry: golden_recipe.Entry) -> Vector:
    """The vector that a recipe entry describes, from the integer model."""
    params, raw, setpoint = entry.inputs()
    words = run_fixed.run_control(params, raw, setpoint)
    final = {name: int(values[-1]) for name, values in words.items()}
    return Vector(entry.name, entry.system, entry.on_link, params, raw, setpoint, words.digests(), final)


def make(folder: Path, systems: Sequence[str] | None = None) -> list[str]:
    """Write every vector of the recipe and the manifest; the same bytes every time. Returns a line for each vector."""
    lines, rows = [], {}
    for entry in tqdm(golden_recipe.read(folder / RECIPE, systems), disable=None, leave=False, unit="vector"):
        vector = build(entry)
        path = folder / (vector.name + SUFFIX)
        data = vector.encode()
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(data)
        unfinished.replace(path)
        rows[entry.name] = _row(entry, data)
        lines.append(f"{path.name}: {len(vector.raw)} steps, {len(data)} bytes")
    if systems and (folder / golden_manifest.MANIFEST).exists():
        rows = {row.name: row for row in golden_manifest.read(folder)} | rows
    names = [entry.name for entry in golden_recipe.read(folder / RECIPE)]
    golden_manifest.write(folder, [rows[name] for name in names if name in rows])
    return lines


def _row(entry: golden_recipe.Entry, data: bytes) -> golden_manifest.Row:
    digest = hashlib.sha256(data).hexdigest()
    return golden_manifest.Row(entry.name, entry.system, entry.steps, entry.on_link, digest)


@dataclass(frozen=True)
class Case:
    """A vector of a check, and its recipe entry."""

    entry: golden_recipe.Entry
    vector: Vector


def cases(folder: Path, systems: Sequence[str] | None = None) -> list[Case]:
    """The cases of a check, in the recipe's order; raises UsageError unless recipe, manifest and files agree."""
    entries = golden_recipe.read(folder / RECIPE, systems)
    rows = golden_manifest.require(folder, entries, systems)
    return [_case(folder, entry, rows[entry.name]) for entry in entries]


def _case(folder: Path, entry: golden_recipe.Entry, row: golden_manifest.Row) -> Case:
    path = folder / (entry.name + SUFFIX)
    data = read_bounded(path, MAX_FILE_BYTES)
    vector = Vector.decode(data, path)
    again = "make it again with: plumb golden make"
    for what, found, wanted in (
        ("name", vector.name, entry.name),
        ("system", vector.system, entry.system),
        ("steps", len(vector.raw), entry.steps),
        ("on_link", vector.on_link, entry.on_link),
    ):
        if found != wanted:
            raise UsageError(f"{path} says {what} {found}, its recipe {wanted}; {again}")
    expected = entry.params().own()
    for name, value in vector.params.own().items():
        if value != expected[name]:
            raise UsageError(f"{path} says {name} {value}, its recipe's tuning gives {expected[name]}; {again}")
    if not native_core.params_valid(vector.params):
        raise UsageError(f"{path} holds parameters that the core refuses; correct the recipe, then: plumb golden make")
    if hashlib.sha256(data).hexdigest() != row.sha256:
        raise UsageError(f"{path} is not the file that {golden_manifest.MANIFEST} lists; {again}")
    return Case(entry, vector)


def load(folder: Path, systems: Sequence[str] | None = None) -> list[Vector]:
    """The vectors of the recipe, in its order."""
    return [case.vector for case in cases(folder, systems)]


@dataclass
class Result:
    """Result of the vectors on one board."""

    vectors: int = 0
    steps: int = 0
    mismatches: int = 0
    first_divergence: Divergence | None = None
    unverified_from: tuple[str, int] | None = None

    @property
    def verdict(self) -> str:
        if self.mismatches or self.first_divergence:
            return "fail"
        return "pass" if self.unverified_from is None and self.vectors else "unverified"

    def to_json(self) -> dict[str, object]:
        first = self.first_divergence
        return {
            "vectors": self.vectors,
            "steps": self.steps,
            "mismatches": self.mismatches,
            "first_divergence": None if first is None else first.as_dict(),
        }

    def describe(self) -> str:
        text = f"{self.vectors} vectors, {self.steps} steps, {self.mismatches} mismatches"
        if self.first_divergence:
            text += f"; first: {self.first_divergence}"
        if self.unverified_from:
            text += "; unverified from {} step {}: answers were lost".format(*self.unverified_from)
        return text


def verdict_of(results: Iterable[Result]) -> str:
    """The worst verdict of all results."""
    return worst_of([result.verdict for result in results])


def worst_of(verdicts: Sequence[str]) -> str:
    """fail, else unverified, else pass."""
    return next((verdict for verdict in ("fail", "unverified") if verdict in verdicts), "pass")


def check(
    board: Board, folder: Path, systems: Sequence[str] | None = None, chosen: Sequence[Case] | None = None
) -> Result:
    """Run the vectors on a board and compare every step's digest with the one in the file.

    chosen: the cases, when they were loaded before; else those of the folder and the systems.
    """
    result = Result()
    every = cases(folder, systems) if chosen is None else chosen
    meant = [case for case in every if case.entry.on_link or board.name in WHOLE_BOARDS]
    for case in tqdm(meant, disable=None, leave=False, unit="vector", desc=board.name):
        vector = case.vector
        answer = board.run_injected(vector.params, vector.raw, vector.setpoint)
        result.vectors += 1
        result.steps += len(vector.raw)
        if answer.unverified_from is not None and result.unverified_from is None:
            result.unverified_from = (vector.name, answer.unverified_from)
        compared = slice(0, answer.unverified_from)
        wrong = count_mismatches(vector.digests[compared], answer.digests[compared])
        result.mismatches += wrong
        if result.first_divergence is None:
            result.first_divergence = _trace(board, case.entry, vector, answer)
            if result.first_divergence and not wrong:
                result.mismatches += 1  # the words differ although their digest does not
    return result


def _trace(board: Board, entry: golden_recipe.Entry, vector: Vector, answer: Answer) -> Divergence | None:
    """The first difference, down to its signal: runs the model again, and also the board if it gave no words."""
    compared = slice(0, answer.unverified_from)
    step = first_digest_divergence(vector.digests[compared], answer.digests[compared])
    if step is None:
        return _first_in_words(vector, answer)
    model = run_fixed.run_control(vector.params, vector.raw, vector.setpoint)
    in_file = first_digest_divergence(model.digests(), vector.digests)
    if in_file is not None and in_file <= step:
        return _first_in_file(entry, vector, model, in_file)

    def words_of_step(step: int) -> dict[str, int]:
        if answer.words is not None:
            return {name: int(values[step]) for name, values in answer.words.items()}
        return board.words_of_step(vector.params, vector.raw, vector.setpoint, step)

    return _of(vector, first_divergence(Words(model.record[compared]), answer.digests[compared], words_of_step))


def _of(vector: Vector, found: Divergence | None, in_file: bool = False) -> Divergence | None:
    return None if found is None else replace(found, vector=vector.name, in_file=in_file)


def _first_in_words(vector: Vector, answer: Answer) -> Divergence | None:
    """All digests are right: compare the board's words, if it gave them, and the final words of the file."""
    words: Words | None = answer.words
    if words is None:
        return None
    step = first_digest_divergence(answer.digests, words.digests())
    if step is not None:
        model = run_fixed.run_control(vector.params, vector.raw[: step + 1], vector.setpoint[: step + 1])
        found = first_divergence(model, Words(words.record[: step + 1]))
        if found is not None:
            return _of(vector, found)
    last = len(vector.raw) - 1
    if all(vector.final.get(name) == int(values[last]) for name, values in words.items()):
        return None
    return _of(vector, divergence_at(last, words, vector.final, None), in_file=True)


def _first_in_file(entry: golden_recipe.Entry, vector: Vector, model: Words, step: int) -> Divergence | None:
    """The first difference in a file that disagrees with the model on its own inputs: a comparison with the vector of
    the recipe shows which number was changed.

    Every record begins with raw counts and setpoint, so a changed input is the first signal that differs.
    """
    fresh = run_fixed.run_control(*entry.inputs())
    changed = first_divergence(fresh, model)
    return _of(vector, changed or divergence_at(step, fresh, {}, int(vector.digests[step])), in_file=True)
