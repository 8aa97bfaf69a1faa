"""Golden vectors: files with inputs and the expected digests, which the integer model makes from a written recipe.

plumb.proof.golden_recipe reads the recipe, plumb.proof.golden_file is the container, plumb.proof.golden_manifest lists
the vectors that a full check must run. A check starts only when recipe, manifest and files agree and the C library
finds the parameters valid.
"""

from __future__ import annotations

import difflib
import fnmatch
import hashlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from plumb.boards.contract import StepBoard
from plumb.boards.native import core as native_core
from plumb.boards.tasks import RunsTasks
from plumb.checkout import CHECKOUT, PACKAGE
from plumb.contract import run_fixed
from plumb.errors import UsageError
from plumb.link.endpoint_names import BoardName, LocalBoard, ProgramName
from plumb.proof import golden_manifest, golden_recipe
from plumb.proof.compare import Divergence, count_mismatches
from plumb.proof.golden_file import FORMAT, MAX_FILE_BYTES, SUFFIX, Vector, read_bounded
from plumb.proof.golden_result import Result, VectorResult, bit_exact, verdict_of, worst_of
from plumb.proof.golden_trace import trace
from plumb.systems import run_tasks

__all__ = [
    "FORMAT", "SUFFIX", "Case", "Divergence", "Result", "Vector", "VectorResult", "bit_exact", "build", "cases",
    "cases_for", "check", "check_each", "check_vector", "load", "make", "takes", "vectors_folder",
    "verdict_of", "worst_of",
]  # fmt: skip

WHOLE_BOARDS = ("fixed", "native", "qemu", "program")
"""Boards that run every vector of steps; the others run those marked `on_link`."""
ASKED_BOARDS = ("fixed", "native", "program")
"""Boards that also run vectors of other kinds than steps."""


TASK_BOARDS = {"retune": WHOLE_BOARDS, "plausibility": ASKED_BOARDS, "refusal": ASKED_BOARDS}


def vectors_folder(folder: Path | None = None) -> Path:
    """`folder`, or the checkout's tests/vectors, or the package's; raises UsageError when it has no recipe."""
    own = [Path.cwd() / "tests/vectors", CHECKOUT / "tests/vectors", PACKAGE / "vectors"]
    candidates = [folder] if folder else own
    for candidate in candidates:
        if golden_recipe.files(candidate):
            return candidate
    raise UsageError(
        f"{candidates[0]} holds no {golden_recipe.RECIPE}; run from a checkout of plumb, or name the folder: --vectors"
    )


def build(entry: golden_recipe.Entry) -> Vector:
    """The vector that a recipe entry describes, from the integer model."""
    params, raw, setpoint = entry.inputs()
    task = entry.task()
    if task is not None:
        raw, setpoint = task.raw, task.setpoint
    words = run_fixed.run_control(params, raw, setpoint) if task is None else run_tasks.run_task(task)
    final = {name: int(values[-1]) for name, values in words.items()}
    return Vector(entry.name, entry.system, entry.on_link, params, raw, setpoint, words.digests(), final, task)


def make(folder: Path, systems: Sequence[str] | None = None) -> list[str]:
    """Write every vector of the recipe and the manifest; the same bytes every time. Returns a line for each vector."""
    lines, rows = [], {}
    for entry in tqdm(golden_recipe.read(folder, systems), disable=None, leave=False, unit="vector"):
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
    names = [entry.name for entry in golden_recipe.read(folder)]
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


def cases(folder: Path, systems: Sequence[str] | None = None, patterns: Sequence[str] | None = None) -> list[Case]:
    """The cases of a check, in the recipe's order; raises UsageError unless recipe, manifest and files agree.

    patterns: only the vectors whose name fits one (* and ? as in file names), and their files; all without patterns.
    Raises UsageError for a pattern that fits none.
    """
    entries = golden_recipe.read(folder, systems)
    rows = golden_manifest.require(folder, entries, systems)
    return [_case(folder, entry, rows[entry.name]) for entry in _named(entries, patterns)]


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
        ("kind", vector.kind, entry.kind),
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


def _named(entries: Sequence[golden_recipe.Entry], patterns: Sequence[str] | None) -> list[golden_recipe.Entry]:
    """Those whose name fits one of the patterns; raises UsageError for a pattern that fits none."""
    if not patterns:
        return list(entries)
    names = [entry.name for entry in entries]
    for pattern in patterns:
        if not fnmatch.filter(names, pattern):
            near = difflib.get_close_matches(pattern, names, 3, 0.4)
            instead = f"did you mean {' or '.join(near)}?" if near else f"they begin with {names[0]}"
            raise UsageError(f"no vector is named '{pattern}'; {instead}")
    return [entry for entry in entries if any(fnmatch.fnmatchcase(entry.name, pattern) for pattern in patterns)]


def cases_for(board: str, every: Sequence[Case]) -> list[Case]:
    """The cases that a board runs, by its name: over a link only those marked for one, and of kinds other than steps
    only those that it supports."""
    kind = board.partition(":")[0]
    return [case for case in every if case.entry.on_link or kind in TASK_BOARDS.get(case.entry.kind, WHOLE_BOARDS)]


def takes(name: BoardName, case: Case) -> bool:
    """As `cases_for`, for one case and a board that is not open yet."""
    kind = "program" if isinstance(name, ProgramName) else name.kind if isinstance(name, LocalBoard) else ""
    return bool(cases_for(kind, [case]))


def check(
    board: StepBoard, folder: Path, systems: Sequence[str] | None = None, chosen: Sequence[Case] | None = None
) -> Result:
    """Runs the vectors on a board and compares every step's digest with the one in the file.

    chosen: the cases, when they were loaded before; else those of the folder and the systems.
    """
    result = Result()
    for row in check_each(board, board.name, cases(folder, systems) if chosen is None else chosen):
        result.add(row)
    return result


def check_each(board: StepBoard, board_name: str, every: Sequence[Case]) -> Iterator[VectorResult]:
    """The result of each vector that the board runs, as soon as it is ready. board_name: as the user named the
    board."""
    for case in tqdm(cases_for(board.name, every), disable=None, leave=False, unit="vector", desc=board.name):
        yield check_vector(board, board_name, case)


def check_vector(board: StepBoard, board_name: str, case: Case) -> VectorResult:
    """Runs one vector on a board, and traces the first difference down to its signal."""
    vector, start_s = case.vector, time.monotonic()
    if vector.task is None:
        answer = board.run_injected(vector.params, vector.raw, vector.setpoint)
    else:
        assert isinstance(board, RunsTasks)  # cases_for
        answer = board.run_task(vector.task)
    compared = slice(0, answer.unverified_from)
    wrong = count_mismatches(vector.digests[compared], answer.digests[compared])
    found = trace(board, case.entry, vector, answer)
    if found and not wrong:
        wrong = 1  # the words differ although their digest does not
    seconds, lost = time.monotonic() - start_s, answer.unverified_from
    return VectorResult(vector.name, vector.system, len(vector.raw), wrong, found, lost, seconds, board_name)
