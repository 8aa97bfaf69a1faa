"""The pytest plugin, as a user's project sees it: pytest runs in a folder of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
VECTORS = ("--plumb-vector", "quad_hold", "--plumb-vector", "wild_walk")


def run(folder: Path, *arguments: str) -> tuple[int, str]:
    """Exit code and output of pytest with the plugin, whether or not its entry point is installed by now."""
    environment = {**os.environ, "PYTEST_ADDOPTS": "", "COLUMNS": "200"}
    command = [sys.executable, "-m", "pytest", "-p", "plumb.pytest_plugin", "-p", "no:cacheprovider", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240)
    return done.returncode, done.stdout + done.stderr


def test_the_entry_point_is_the_plugin() -> None:
    """Its name is the module's, so that `-p plumb.pytest_plugin` in addition is no second plugin."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["pytest11"] == {"plumb.pytest_plugin": "plumb.pytest_plugin"}


def test_it_costs_nothing_unless_asked(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text(
        "import sys\n"
        "def test_modules():\n"
        "    loaded = [name for name in sys.modules if name.split('.')[0] in ('numpy', 'plumb', 'can')]\n"
        "    assert sorted(loaded) == ['plumb', 'plumb.pytest_plugin']\n"
    )
    code, said = run(tmp_path, "-q")
    assert code == 0 and "1 passed" in said, said


def test_every_vector_is_a_test_that_can_be_chosen(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text("def test_own():\n    pass\n")
    code, said = run(tmp_path, "--plumb-golden", *VECTORS, "-v", "--junitxml", "out.xml")
    assert code == 0 and "3 passed" in said, said
    assert "plumb-golden::wild_walk[native] PASSED" in said
    cases = ElementTree.parse(tmp_path / "out.xml").getroot().iter("testcase")
    assert {case.attrib["name"] for case in cases} == {"test_own", "wild_walk[native]", "quad_hold[native]"}
    code, said = run(tmp_path, "--plumb-golden", *VECTORS, "-m", "plumb_golden", "--strict-markers", "-k", "hold")
    assert code == 0 and "1 passed, 2 deselected" in said, said


def test_a_difference_is_one_sentence_and_a_link_takes_its_vectors_alone(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import sys\nfor line in sys.stdin:\n    if line.count(' ') == 6: print('00000000')\n")
    board = f"program:{sys.executable} {wrong}"
    code, said = run(tmp_path, "--plumb-golden", *VECTORS, "--plumb-board", board, "--plumb-board", "virtual", "-v")
    assert code == 1 and "2 failed, 1 passed" in said, said
    assert "Traceback" not in said
    assert re.search(r"fail quad_hold: 1500 steps, 1500 mismatches; first: .* step 0: digest is 0", said)
    assert "quad_hold[virtual] PASSED" in said and "wild_walk[virtual]" not in said


def test_the_fixture_is_the_board_that_was_asked_for(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text(
        "import plumb\n"
        "def test_name(plumb_board):\n"
        "    assert type(plumb_board) is plumb.Board\n"
        "    print('board', plumb_board.name)\n"
        "def test_again(plumb_board):\n    print('board', plumb_board.name)\n"
    )
    code, said = run(tmp_path, "-s", "-q")
    assert code == 0 and said.count("board native") == 2, said
    code, said = run(tmp_path, "-s", "-q", "--plumb-board", "virtual", "--plumb-board", "fixed")
    assert code == 0 and said.count("board virtual") == 2 and said.count("board fixed") == 2, said


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--plumb-board", "toaster"], "'toaster' is not a board"),
        (["--plumb-vector", "no_such"], "no vector is named 'no_such'"),
        (["--plumb-vectors", "."], "holds no recipe.toml"),
    ],
)
def test_wrong_use_is_one_sentence_and_pytests_exit_code_for_it(
    tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    code, said = run(tmp_path, "--plumb-golden", *arguments)
    assert code == 4 and "Traceback" not in said, said
    assert [line for line in said.splitlines() if line.startswith("ERROR: ") and sentence in line]


def test_a_board_that_cannot_be_opened_fails_its_vectors_in_a_sentence(tmp_path: Path) -> None:
    code, said = run(
        tmp_path, "--plumb-golden", "--plumb-vector", "*hold*", "--plumb-vector", "*disturb_adaptive",
        "--plumb-board", "virtual", "--plumb-image", "none.bin",
    )  # fmt: skip
    assert code == 1 and "2 failed" in said and said.count("there is no file none.bin") >= 2, said
    assert "Traceback" not in said
