"""Golden vectors: inputs and the digests they must give, as data files made by the integer model from a written recipe.

A vector file, NAME.golden, is one line of JSON and then binary, little endian, without compression:

    {"format", "name", "system", "on_link", "steps", "columns", "setpoint", "params", "final"} and a newline
    int16  raw      (steps, columns)   the columns of the raw counts that are not all zero
    int32  setpoint (steps,)           left out when the header's "setpoint" is a number: constant
    uint32 digest   (steps,)           CRC-32 of every step's words

"params" are the parameter words that the system reads, "final" the words of the last step, by name. "on_link" marks the
vectors that are also run over a link, where a step costs a frame.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from plumb import fixed, recipe
from plumb.boards import Answer, Board, RawCounts, Setpoints
from plumb.compare import first_digest_divergence
from plumb.errors import UsageError
from plumb.quantise import ControlParams
from plumb.words import Words, names_of

FORMAT = "plumb golden 2"
SUFFIX = ".golden"
RECIPE = "recipe.toml"
WHOLE_BOARDS = ("native", "qemu")
"""Boards that take every vector; the others take those marked for a link."""


@dataclass(frozen=True)
class Vector:
    """One golden vector. raw: (steps, 6) int16; setpoint: (steps,) int32; digests: (steps,) uint32."""

    name: str
    system: str
    on_link: bool
    params: ControlParams
    raw: RawCounts
    setpoint: Setpoints
    digests: npt.NDArray[np.uint32]
    final: dict[str, int]

    def encode(self) -> bytes:
        columns = [i for i in range(self.raw.shape[1]) if self.raw[:, i].any()]
        constant = bool((self.setpoint == self.setpoint[0]).all())
        header = {
            "format": FORMAT,
            "name": self.name,
            "system": self.system,
            "on_link": self.on_link,
            "steps": len(self.raw),
            "columns": columns,
            "setpoint": int(self.setpoint[0]) if constant else None,
            "params": self.params.own(),
            "final": self.final,
        }
        binary = self.raw[:, columns].astype("<i2").tobytes()
        binary += b"" if constant else self.setpoint.astype("<i4").tobytes()
        return json.dumps(header).encode() + b"\n" + binary + self.digests.astype("<u4").tobytes()

    @classmethod
    def read(cls, path: Path) -> Vector:
        """Raises UsageError for a file that is none, or that ends early."""
        try:
            line, _, binary = path.read_bytes().partition(b"\n")
            header = json.loads(line)
            if header["format"] != FORMAT:
                raise ValueError(header["format"])
            return cls._decode(header, binary)
        except (OSError, ValueError, KeyError, TypeError, IndexError, UsageError):
            raise UsageError(f"{path} is not a whole golden vector; make it again with: plumb golden make") from None

    @classmethod
    def _decode(cls, header: dict[str, Any], binary: bytes) -> Vector:
        steps, columns = int(header["steps"]), list(header["columns"])
        raw = np.zeros((steps, 6), np.int16)
        counts, at = steps * len(columns), 2 * steps * len(columns)
        raw[:, columns] = np.frombuffer(binary, "<i2", counts).reshape(steps, len(columns))
        if header["setpoint"] is None:
            setpoint = np.frombuffer(binary, "<i4", steps, at).astype(np.int32)
            at += 4 * steps
        else:
            setpoint = np.full(steps, header["setpoint"], np.int32)
        digests = np.frombuffer(binary, "<u4", steps, at).astype(np.uint32)
        if len(binary) != at + 4 * steps:
            raise ValueError("length")
        params = ControlParams.of(header["system"], header["params"])
        final = {str(name): int(value) for name, value in header["final"].items()}
        return cls(header["name"], header["system"], bool(header["on_link"]), params, raw, setpoint, digests, final)


def vectors_folder(folder: Path | None = None) -> Path:
    """The folder asked for, else the checkout's tests/vectors; raises UsageError where there is no recipe."""
    candidates = [folder] if folder else [Path.cwd() / "tests/vectors", Path(__file__).parents[2] / "tests/vectors"]
    for candidate in candidates:
        if (candidate / RECIPE).is_file():
            return candidate
    raise UsageError(f"{candidates[0]} holds no {RECIPE}; run from a checkout of plumb, or name the folder: --vectors")


def build(entry: recipe.Entry) -> Vector:
    """The vector that a recipe entry describes, from the integer model."""
    params, raw, setpoint = entry.inputs()
    words = fixed.run_control(params, raw, setpoint)
    final = {name: int(values[-1]) for name, values in words.items()}
    return Vector(entry.name, entry.system, entry.on_link, params, raw, setpoint, words.digests(), final)


def make(folder: Path, systems: Sequence[str] | None = None) -> list[str]:
    """Writes every vector of the recipe; a second time gives the same bytes. Returns a line for each."""
    lines = []
    entries = recipe.read(folder / RECIPE, systems)
    for entry in tqdm(entries, disable=None, leave=False, unit="vector"):
        vector = build(entry)
        path = folder / (vector.name + SUFFIX)
        data = vector.encode()
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(data)
        unfinished.replace(path)
        lines.append(f"{path.name}: {len(vector.raw)} steps, {len(data)} bytes")
    return lines


def load(folder: Path, systems: Sequence[str] | None = None) -> list[Vector]:
    """The vectors of the recipe, in its order."""
    return [Vector.read(folder / (entry.name + SUFFIX)) for entry in recipe.read(folder / RECIPE, systems)]


@dataclass(frozen=True)
class Divergence:
    """Where a board, or the vector file itself (in_file), first leaves the model. signal is a word of the step, or
    `params[NAME]`, or `digest`; actual is None where the board gave nothing."""

    vector: str
    step: int
    signal: str
    expected: int
    actual: int | None
    in_file: bool = False

    def __str__(self) -> str:
        where = "its file" if self.in_file else "the board"
        return f"{self.vector} step {self.step}: {self.signal} is {self.actual} in {where}, expected {self.expected}"


@dataclass
class Result:
    """What a board made of the vectors."""

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

    def to_json(self) -> dict[str, Any]:
        first = self.first_divergence
        return {
            "vectors": self.vectors,
            "steps": self.steps,
            "mismatches": self.mismatches,
            "first_divergence": None if first is None else vars(first),
        }

    def describe(self) -> str:
        text = f"{self.vectors} vectors, {self.steps} steps, {self.mismatches} mismatches"
        if self.first_divergence:
            text += f"; first: {self.first_divergence}"
        if self.unverified_from:
            text += "; unverified from {} step {}: answers were lost".format(*self.unverified_from)
        return text


def verdict_of(results: Iterable[Result]) -> str:
    """The worst of all verdicts: fail, then unverified, then pass."""
    verdicts = {result.verdict for result in results}
    return next((v for v in ("fail", "unverified") if v in verdicts), "pass")


def check(board: Board, folder: Path, systems: Sequence[str] | None = None) -> Result:
    """Runs the vectors on a board and compares every step's digest with the one in the file."""
    entries = recipe.read(folder / RECIPE, systems)
    result = Result()
    chosen = [(e, Vector.read(folder / (e.name + SUFFIX))) for e in entries if e.on_link or board.name in WHOLE_BOARDS]
    for entry, vector in tqdm(chosen, disable=None, leave=False, unit="vector", desc=board.name):
        answer = board.run_injected(vector.params, vector.raw, vector.setpoint)
        result.vectors += 1
        result.steps += len(vector.raw)
        if answer.unverified_from is not None and result.unverified_from is None:
            result.unverified_from = (vector.name, answer.unverified_from)
        compared = slice(0, answer.unverified_from)
        wrong = int(np.count_nonzero(answer.digests[compared] != vector.digests[compared]))
        result.mismatches += wrong
        if result.first_divergence is None:
            result.first_divergence = _trace(board, entry, vector, answer)
            if result.first_divergence and not wrong:
                result.mismatches += 1  # the words differ although their digest does not
    return result


def _trace(board: Board, entry: recipe.Entry, vector: Vector, answer: Answer) -> Divergence | None:
    """The first difference, down to its signal: the model runs again, and the board where it gave no words."""
    step = first_digest_divergence(vector.digests[: answer.unverified_from], answer.digests[: answer.unverified_from])
    if step is None:
        return _first_in_words(vector, answer)
    step = min(step, len(vector.raw) - 1)
    model = fixed.run_control(vector.params, vector.raw, vector.setpoint)
    in_file = first_digest_divergence(model.digests(), vector.digests)
    if in_file is not None and in_file <= step:
        return _first_in_file(entry, vector, in_file)
    if answer.words is not None:
        actual = {name: int(values[step]) for name, values in answer.words.items()}
    else:
        actual = board.words_of_step(vector.params, vector.raw, vector.setpoint, step)
    for name, values in model.items():
        if int(values[step]) != actual.get(name):
            return Divergence(vector.name, step, name, int(values[step]), actual.get(name))
    return Divergence(vector.name, step, "digest", int(vector.digests[step]), int(answer.digests[step]))


def _first_in_words(vector: Vector, answer: Answer) -> Divergence | None:
    """Every digest is right: so must be the words that came with them, and the final words of the file."""
    words: Words | None = answer.words
    if words is None:
        return None
    step = first_digest_divergence(answer.digests, words.digests())
    last = len(vector.raw) - 1
    if step is not None:
        model = fixed.run_control(vector.params, vector.raw[: step + 1], vector.setpoint[: step + 1])
        for name, values in model.items():
            if int(values[step]) != int(words[name][step]):
                return Divergence(vector.name, step, name, int(values[step]), int(words[name][step]))
    for name, values in words.items():
        if vector.final.get(name) != int(values[last]):
            return Divergence(vector.name, last, name, int(values[last]), vector.final.get(name), in_file=True)
    return None


def _first_in_file(entry: recipe.Entry, vector: Vector, step: int) -> Divergence:
    """The file disagrees with the model on its own inputs: what its recipe gives shows which number was changed."""
    fresh = build(entry)
    for name, expected in fresh.params.own().items():
        if expected != vector.params[name]:
            return Divergence(vector.name, 0, f"params[{name}]", expected, vector.params[name], in_file=True)
    steps = min(len(fresh.raw), len(vector.raw))
    for at in range(steps):
        if (fresh.raw[at] != vector.raw[at]).any():
            column = int(np.flatnonzero(fresh.raw[at] != vector.raw[at])[0])
            expected, actual = int(fresh.raw[at, column]), int(vector.raw[at, column])
            return Divergence(vector.name, at, f"raw_{column}", expected, actual, in_file=True)
        if fresh.setpoint[at] != vector.setpoint[at]:
            expected, actual = int(fresh.setpoint[at]), int(vector.setpoint[at])
            return Divergence(vector.name, at, names_of(vector.system)[6], expected, actual, in_file=True)
    return Divergence(vector.name, step, "digest", int(fresh.digests[step]), int(vector.digests[step]), in_file=True)
