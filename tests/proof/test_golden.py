"""The golden vectors are what their recipe says, every board agrees with them, and one wrong bit is found and named."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb import systems
from plumb.boards import open_board
from plumb.boards.contract import Answer, StepBoard
from plumb.errors import PlumbError, UsageError
from plumb.proof import golden, golden_manifest, golden_recipe
from plumb.proof.golden import Vector
from plumb.proof.golden_file import sealed
from plumb.spec.records import Words
from support.campaigns import campaign
from support.golden_folder import folder_of

FOLDER = Path(__file__).parents[1] / "vectors"
ENTRIES = golden_recipe.read(FOLDER)
KINDS = {"native": {"step", "retune", "plausibility", "refusal"}, "qemu": {"step", "retune"}}
"""What each board can be asked; others steps alone."""
SMALL = """
[[vector]]
name = "small"
system = "quad"
tuning = "adaptive"
wild = "steps"
seed = 5
steps = 60
on_link = true

[[vector]]
name = "second"
system = "quad"
tuning = "paper_arcsine"
scenario = "motion"
seed = 5
steps = 50
on_link = true
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(SMALL, tmp_path_factory)


@pytest.fixture
def small(made: Path, tmp_path: Path) -> Path:
    """A folder of two small vectors that a test may spoil."""
    return Path(shutil.copytree(made, tmp_path / "vectors"))


@pytest.fixture(params=["native", "qemu", "virtual"])
def board(request: pytest.FixtureRequest) -> Iterator[StepBoard]:
    try:
        opened = open_board(request.param)
    except (PlumbError, ImportError) as error:
        pytest.skip(str(error))
    with opened:
        yield opened


class Spoiled:
    """A board whose answers have one bit changed in one word of one step."""

    def __init__(self, board: StepBoard, step: int, signal: str, bit: int, with_words: bool = True) -> None:
        self.name = board.name
        self._board, self._at, self._with_words = board, (step, signal, bit), with_words

    def run_injected(self, params: Any, raw: Any, setpoint: Any) -> Answer:
        answer = self._board.run_injected(params, raw, setpoint)
        step, signal, bit = self._at
        if answer.words is None or not self._with_words:
            digests = answer.digests.copy()
            digests[step:] ^= 1 << 7  # a wrong state stays wrong
            return Answer(digests)
        record = answer.words.record.copy()
        record[signal][step] ^= record[signal].dtype.type(1 << bit)
        words = Words(record)
        return Answer(words.digests(), words)

    def words_of_step(self, params: Any, raw: Any, setpoint: Any, step: int) -> dict[str, int]:
        words = self._board.words_of_step(params, raw, setpoint, step)
        at, signal, bit = self._at
        return {**words, signal: words[signal] ^ (1 << bit)} if step >= at else words


def test_the_recipe_is_large_enough_and_the_files_small_enough() -> None:
    sizes = [(FOLDER / (entry.name + golden.SUFFIX)).stat().st_size for entry in ENTRIES]
    assert len(ENTRIES) >= 20
    assert sum(entry.steps for entry in ENTRIES) >= 100_000
    assert sum(entry.steps for entry in ENTRIES if entry.on_link) >= 10_000
    assert len({entry.name for entry in ENTRIES}) == len(ENTRIES)
    assert max(sizes) < 2**20 / 2
    assert sum(sizes) < 4 * 2**20, "what a clone and the package may take for them"


@pytest.mark.slow
@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_recipe_and_model_still_give_the_file(entry: golden_recipe.Entry) -> None:
    stored = (FOLDER / (entry.name + golden.SUFFIX)).read_bytes()
    assert golden.build(entry).encode() == stored, "make the vectors again: plumb golden make"


def test_no_file_is_without_a_recipe() -> None:
    assert {path.stem for path in FOLDER.glob("*" + golden.SUFFIX)} == {entry.name for entry in ENTRIES}


def test_making_twice_gives_the_same_bytes(small: Path) -> None:
    before = {path.name: path.read_bytes() for path in small.glob("*" + golden.SUFFIX)}
    golden.make(small)
    assert {path.name: path.read_bytes() for path in small.glob("*" + golden.SUFFIX)} == before
    assert not list(small.glob("*.part"))


@pytest.mark.slow
def test_every_board_passes_every_vector_meant_for_it(board: StepBoard) -> None:
    result = golden.check(board, FOLDER)
    kinds = KINDS.get(board.name, {"step"})
    whole = board.name in golden.WHOLE_BOARDS
    meant = [entry for entry in ENTRIES if entry.kind in kinds and (entry.on_link or whole)]
    assert result.verdict == "pass", result.describe()
    assert (result.vectors, result.steps) == (len(meant), sum(entry.steps for entry in meant))
    assert result.to_json()["first_divergence"] is None


@pytest.mark.slow
def test_over_can_every_system_answers_the_same() -> None:
    """The beginning of the first vectors of each, PLUMB_LONG=1 of all; `plumb golden check --board virtual --link can`
    runs them whole. Which code a step takes on the image is the matter of the vectors over the UART."""
    pytest.importorskip("unicorn")
    short, of_each = campaign(60, 200), campaign(2, 1000)
    linked = [vector for vector in golden.load(FOLDER) if vector.on_link]
    with open_board("virtual", link="can") as board:
        vectors = [one for name in systems.SYSTEMS for one in [v for v in linked if v.system == name][:of_each]]
        for vector in vectors:
            answer = board.run_injected(vector.params, vector.raw[:short], vector.setpoint[:short])
            assert (answer.digests == vector.digests[:short]).all() and answer.unverified_from is None, vector.name
    assert {vector.system for vector in vectors} == set(systems.SYSTEMS)


@pytest.mark.slow
@pytest.mark.parametrize("bit", [0, 30])
@pytest.mark.parametrize("signal", ["raw_0", "tilt_turn_q32", "pulse_halfus_1"])
def test_one_wrong_bit_of_a_board_is_named(board: StepBoard, small: Path, signal: str, bit: int) -> None:
    result = golden.check(Spoiled(board, 37, signal, bit), small)  # type: ignore[arg-type]
    first = result.first_divergence
    assert first is not None
    assert (first.vector, first.step, first.signal, first.in_file) == ("small", 37, signal, False)
    assert first.expected is not None and first.actual == first.expected ^ (1 << bit)
    assert result.verdict == "fail" and result.mismatches >= 1
    assert golden.verdict_of([golden.Result(1, 1), result]) == "fail"
    assert "step 37" in result.describe()


def test_a_board_that_gives_digests_only_is_asked_for_the_step(small: Path) -> None:
    with open_board("native") as native:
        spoiled = Spoiled(native, 21, "bias_turn_q61", 3, with_words=False)
        result = golden.check(spoiled, small)  # type: ignore[arg-type]
    assert result.first_divergence is not None
    assert (result.first_divergence.step, result.first_divergence.signal) == (21, "bias_turn_q61")
    assert result.mismatches == (60 - 21) + (50 - 21)


def change(folder: Path, **fields: Any) -> None:
    """Another file that its manifest knows, as if it had been made so."""
    vector = Vector.read(folder / "small.golden")
    data = dataclasses.replace(vector, **fields).encode()
    (folder / "small.golden").write_bytes(data)
    rows = golden_manifest.read(folder)
    digest = hashlib.sha256(data).hexdigest()
    golden_manifest.write(folder, [dataclasses.replace(r, sha256=digest) if r.name == "small" else r for r in rows])


@pytest.mark.parametrize("what", ["raw", "setpoint", "digest", "final"])
def test_one_wrong_bit_of_a_file_is_named(small: Path, what: str) -> None:
    vector = Vector.read(small / "small.golden")
    raw, setpoint, digests = vector.raw.copy(), vector.setpoint.copy(), vector.digests.copy()
    raw[11, 2] ^= 4
    setpoint[12] ^= 1 << 9
    digests[13] ^= np.uint32(1 << 31)
    name = "pulse_halfus_0"
    if what == "raw":
        change(small, raw=raw)
    elif what == "setpoint":
        change(small, setpoint=setpoint)
    elif what == "digest":
        change(small, digests=digests)
    else:
        change(small, final={**vector.final, name: vector.final[name] ^ 1})
    with open_board("native") as native:
        result = golden.check(native, small)
    first = result.first_divergence
    assert first is not None and first.in_file and result.verdict == "fail" and result.mismatches >= 1
    expected = {
        "raw": (11, "raw_2"),
        "setpoint": (12, "setpoint_turn_q32"),
        "digest": (13, "digest"),
        "final": (59, name),
    }
    assert (first.step, first.signal) == expected[what]


def test_a_model_that_differs_is_reported_by_its_signal(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file has digests alone: the C core, which repeats them, says which word the model has wrong."""
    module = importlib.import_module("plumb.systems.quad.fixed")
    pulses = module.pulses
    monkeypatch.setattr(module, "pulses", lambda p, command: (pulses(p, command)[0], pulses(p, command)[1] + 1))
    with open_board("fixed") as fixed, open_board("native") as native:
        result = golden.check(fixed, small)
        assert golden.check(native, small).verdict == "pass"
    first = result.first_divergence
    assert first is not None and result.verdict == "fail"
    assert (first.step, first.signal, first.in_file) == (0, "pulse_halfus_1", False)
    assert first.expected is not None and first.actual == first.expected + 1


@pytest.mark.parametrize("spell", [
    lambda data: data.replace(b'{"format"', b'{ "format"'), lambda data: data.replace(b'"small"', rb'"\u0073mall"'),
    lambda data: data.replace(b'"steps": 60, "columns"', b'"steps":60, "columns"'),
    lambda data: data.replace(b'"gyro.gain": ', b'"gyro.gain":  '),
])  # fmt: skip
def test_a_file_that_is_spelled_in_another_way_is_refused(small: Path, spell: Any) -> None:
    """It means the same, and its check value is right: but a vector has one form."""
    path = small / "small.golden"
    data = path.read_bytes()
    assert Vector.decode(sealed(data[:-4]), path).name == "small" and spell(data) != data
    with pytest.raises(UsageError, match="other bytes than plumb writes"):
        Vector.decode(sealed(spell(data[:-4])), path)


def test_lost_answers_make_the_verdict_unverified(small: Path) -> None:
    class Lossy(Spoiled):
        def run_injected(self, params: Any, raw: Any, setpoint: Any) -> Answer:
            digests = self._board.run_injected(params, raw, setpoint).digests.copy()
            digests[30:] = 0
            return Answer(digests, None, 30)

    with open_board("native") as native:
        result = golden.check(Lossy(native, 0, "", 0), small)  # type: ignore[arg-type]
    assert result.verdict == "unverified"
    assert result.mismatches == 0
    assert result.unverified_from == ("small", 30)


@pytest.mark.parametrize("spoil", [lambda data: data[:-1], lambda data: data + b"x", lambda data: data[40:],
                                   lambda _: b"", lambda data: data.replace(b"golden 3", b"golden 9")])  # fmt: skip
def test_a_damaged_file_is_refused_in_a_sentence(small: Path, spoil: Any) -> None:
    path = small / "small.golden"
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(UsageError, match="plumb golden make"):
        Vector.read(path)


@pytest.mark.parametrize("text", ["", "[[vector]]\nname = 'x'", SMALL.replace('wild = "steps"', 'wild = "mild"'),
                                  SMALL.replace('wild = "steps"', "")])  # fmt: skip
def test_a_wrong_recipe_is_refused_in_a_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / golden_recipe.RECIPE).write_text(text)
    with pytest.raises(UsageError):
        golden.make(tmp_path)
