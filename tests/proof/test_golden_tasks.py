"""Vectors that are more than steps: retune, plausibility, refusal. What they check, and that a wrong port is seen."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

import plumb.__main__ as front
from plumb.boards import open_board
from plumb.boards.contract import Answer
from plumb.boards.native import core as native_core
from plumb.errors import UsageError
from plumb.link.endpoint_names import parse_board
from plumb.proof import golden, golden_recipe
from plumb.proof.golden_file import SUFFIX, Vector, sealed
from plumb.systems import run_tasks
from plumb.systems.tasks import KINDS, Task

FOLDER = Path(__file__).parents[1] / "vectors"
ENTRIES = [entry for entry in golden_recipe.read(FOLDER) if entry.kind != "step"]
PORT = f"program:{sys.executable} {FOLDER.parents[1] / 'examples/golden/library.py'} {native_core.core_path()}"
RECIPE = "".join(
    f'[[vector]]\nname = "{kind}"\nsystem = "quad"\ntuning = "adaptive"\nkind = "{kind}"\nwild = "steps"\nseed = 3\n'
    f"steps = {steps}\n"
    for kind, steps in (("retune", 60), ("plausibility", 80), ("refusal", 150))
)


def read(name: str) -> Vector:
    return Vector.read(FOLDER / (name + SUFFIX))


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_recipe_file_model_and_core_agree(entry: golden_recipe.Entry) -> None:
    stored = (FOLDER / (entry.name + SUFFIX)).read_bytes()
    vector = Vector.decode(stored, FOLDER)
    assert vector.task is not None and vector.encode() == stored == golden.build(entry).encode()
    assert (native_core.run_task(vector.task).digests() == vector.digests).all()


def test_every_bit_of_plausibility_and_both_verdicts_are_met() -> None:
    for system in ("quad", "balancer"):
        tasks = [read(entry.name).task for entry in ENTRIES if (entry.kind, entry.system) == ("plausibility", system)]
        found = [run_tasks.run_task(task) for task in tasks if task]
        for word, bits in (("failed", 7), ("missing", 31)):
            values = [int(value) for words in found for value in words[word]]
            met = [sum(1 for value in values if value >> bit & 1) for bit in range(bits.bit_length())]
            assert all(0 < count < len(values) for count in met), (system, word, met)
    for entry in ENTRIES:
        if entry.kind == "refusal":
            verdicts = read(entry.name).digests.tolist()
            assert min(verdicts.count(verdict) for verdict in set(verdicts)) > 40, entry.name


@pytest.mark.parametrize("board", ["native", "qemu", PORT])
def test_boards_take_what_they_can(board: str, folder: Path) -> None:
    if board == "qemu" and shutil.which("qemu-system-arm") is None:
        pytest.skip("qemu-system-arm is missing: apt install qemu-system-arm")
    with open_board(board) as opened:
        result = golden.check(opened, folder)
        meant = [case.entry.name for case in golden.cases(folder) if golden.takes(parse_board(board), case)]
    assert [row.vector for row in result.rows] == meant and result.verdict == "pass"
    assert len(meant) == (1 if board == "qemu" else 3)


@pytest.mark.parametrize(
    ("kind", "signal"), [("retune", "integral_q54"), ("plausibility", "failed"), ("refusal", "valid")]
)
@pytest.mark.parametrize("with_words", [True, False])
def test_a_wrong_answer_is_traced_to_its_signal(folder: Path, kind: str, signal: str, with_words: bool) -> None:
    class Wrong:
        name, task_kinds = "native", KINDS

        def run_task(self, task: Task) -> Answer:
            words = native_core.run_task(task)
            words.record[signal][40:] ^= words.record[signal].dtype.type(1)
            return Answer(words.digests(), words if with_words else None)

        def words_of_task(self, task: Task, step: int) -> dict[str, int]:
            answer = dataclasses.replace(self.run_task(task))
            words = native_core.run_task(task)
            words.record[signal][40:] ^= words.record[signal].dtype.type(1)
            return {name: int(values[step]) for name, values in words.items()} if len(answer.digests) else {}

    case = next(case for case in golden.cases(folder) if case.entry.kind == kind)
    found: Any = golden.check_vector(Wrong(), "wrong", case).first_divergence  # type: ignore[arg-type]
    assert (found.step, found.signal, found.in_file) == (40, signal, False)


@pytest.mark.parametrize(("field", "value"), [
    ("kind", "retunes"), ("kind", "refusal"), ("changes", []), ("changes", {}), ("changes", [[70, {"pid.kp_q22": 1}]]),
    ("changes", [[5, {"pid.kp_q22": 1}], [4, {"pid.kp_q22": 2}]]), ("changes", [[5, {"speed.kp_q22": 1}]]),
    ("changes", [[5, {"pid.kp_q22": 1 << 31}]]), ("changes", [[5]]), ("tables", [{}]), ("unit_turn2_q56", -1),
])  # fmt: skip
def test_a_header_that_lies_is_refused(folder: Path, field: str, value: Any) -> None:
    path = folder / "retune.golden"
    line, _, rest = path.read_bytes().partition(b"\n")
    data = sealed(json.dumps({**json.loads(line), field: value}).encode() + b"\n" + rest[:-4])
    with pytest.raises(UsageError, match="plumb golden make"):
        Vector.decode(data, path)


def test_a_program_of_the_first_version_is_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = tmp_path / "old.py"
    old.write_text("import sys\nsys.exit('plumb-program 1 only') if input() != 'plumb-program 1' else 0\n")
    board = f"program:{sys.executable} {old}"
    assert front.main(["golden", "check", "--board", board, "--vectors", str(folder)]) == 3
    assert "plumb-program 1 only" in capsys.readouterr().err
