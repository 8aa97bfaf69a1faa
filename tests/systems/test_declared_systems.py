"""A system is one folder and one C pair: nothing else names it.

A toy system of tests/toy_systems is built into an image and a native core, and runs, without an edit of any file; an
image has the systems that it is asked for; and without the folder and the C pair of a shipped system the rest builds
and runs.
"""

from __future__ import annotations

import ast
import csv
import json
import os
import re
import shutil
import site
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from plumb.spec import declarations, images
from support.built_systems import Plumb, build

ROOT = Path(__file__).resolve().parents[2]
TOYS = ROOT / "tests" / "toy_systems"


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """An image and a core of `balancer` and the toy."""
    options = ("-DPLUMB_SYSTEMS=balancer;toy", f"-DPLUMB_SYSTEM_PATH={TOYS}")
    python = Path(sys.executable)
    core, image = build(ROOT, tmp_path_factory.mktemp("toy"), python, *options)
    return Plumb(python, core, image, {"PLUMB_SYSTEM_PATH": str(TOYS)})


TOWER = """
#include "tower.h"

void plumb_tower_init(plumb_tower_t *c, const plumb_params_t *p) {
    *c = (plumb_tower_t){0};
    plumb_toy_init(&c->toy, p);
}

void plumb_tower_step(plumb_tower_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX], int32_t setpoint) {
    plumb_toy_step(&c->toy, p, raw, setpoint);
    c->words.filtered_counts_q16 = c->toy.words.filtered_counts_q16 + p->tower.height_q16;
    c->words.step++;
}

bool plumb_tower_params_valid(const plumb_params_t *p) {
    return plumb_toy_params_valid(p);
}
"""
TOWER_H = """
#ifndef TOWER_H
#define TOWER_H

#include "toy.h"

typedef struct {
    plumb_tower_words_t words;
    plumb_toy_t toy;
} plumb_tower_t;

void plumb_tower_init(plumb_tower_t *c, const plumb_params_t *p);
bool plumb_tower_params_valid(const plumb_params_t *p);
void plumb_tower_step(plumb_tower_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX], int32_t setpoint);

#endif
"""


@pytest.fixture(scope="module")
def tower(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """An image of a system alone whose step calls that of the toy; a core has its sources by the same list."""
    systems = tmp_path_factory.mktemp("systems")
    shutil.copytree(TOYS, systems, dirs_exist_ok=True)
    declared = (TOYS / "toy" / "system.toml").read_text(encoding="utf-8")
    stands_on = 'groups = []\nstands_on = ["toy"]'
    declared = declared.replace("number = 17", "number = 16").replace("groups = []", stands_on)
    before, _, last = declared.partition("[[parameter]]")
    own = "[[parameter]]" + last.rpartition("[[parameter]]")[2].partition("[commands]")[0]
    (systems / "tower").mkdir()
    (systems / "tower" / "system.toml").write_text(before + own.replace("toy.share", "tower.height"), encoding="utf-8")
    (systems / "tower" / "tower.c").write_text(TOWER, encoding="utf-8")
    (systems / "tower" / "tower.h").write_text(TOWER_H, encoding="utf-8")
    options = ("-DPLUMB_SYSTEMS=tower", f"-DPLUMB_SYSTEM_PATH={systems}")
    python = Path(sys.executable)
    core, image = build(ROOT, tmp_path_factory.mktemp("tower"), python, *options, core=False)
    return Plumb(python, core, image, {"PLUMB_SYSTEM_PATH": str(systems)})


def copied(folder: Path) -> tuple[Path, Path]:
    """A copy of the sources, and a Python that knows this copy alone."""
    copy, python = folder / "plumb", folder / "python"
    shutil.copytree(
        ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "build", "out", "__pycache__", ".*_cache")
    )
    found = os.pathsep.join([str(copy / "host"), *site.getsitepackages()])
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{found}" exec "{sys.executable}" -S "$@"\n')
    python.chmod(0o755)
    return copy, python


@pytest.fixture(scope="module")
def without_quad(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """A copy of the sources from which `quad` was deleted."""
    folder = tmp_path_factory.mktemp("without")
    copy, python = copied(folder)
    for place in ("systems", "judging"):
        shutil.rmtree(copy / "host" / "plumb" / place / "quad")
    for path in [path for name in ("quad", "quad_tunings") for path in (copy / "firmware").rglob(f"{name}.[ch]")]:
        path.unlink()
    core, image = build(copy, folder / "build", python, image="balancer")
    return Plumb(python, core, image, {})


@pytest.fixture(scope="module")
def with_toy(tmp_path_factory: pytest.TempPathFactory) -> Plumb:
    """A copy of the sources to which the toy was added as CONTRIBUTING.md says, and its image of all systems."""
    folder = tmp_path_factory.mktemp("with")
    copy, python = copied(folder)
    shutil.copytree(TOYS / "toy", copy / "host/plumb/systems/toy", ignore=shutil.ignore_patterns("*.[ch]"))
    shutil.copytree(TOYS / "judging/toy", copy / "host/plumb/judging/toy")
    shutil.copy(TOYS / "toy/toy.h", copy / "firmware/include/plumb")
    step = (TOYS / "toy/toy.c").read_text(encoding="utf-8").replace('"toy.h"', '"plumb/toy.h"')
    (copy / "firmware/systems/toy.c").write_text(step, encoding="utf-8")
    Plumb(python, copy, copy, {}).run(python, copy / "tools/generate.py")
    core, image = build(copy, folder / "build", python, core=False)
    return Plumb(python, core, image, {})


def sources() -> list[Path]:
    """What is of no system: code and declarations outside the folders and the C pairs of the systems."""
    folders = {"host/plumb": (".py", ".toml"), "firmware": (".c", ".h", ".cmake"), "tools": (".py", ".sh")}
    found = [ROOT / "CMakeLists.txt", ROOT / "tests/c/CMakeLists.txt"]
    for folder, suffixes in folders.items():
        found += [path for path in sorted((ROOT / folder).rglob("*")) if path.suffix in suffixes]
    own = [folder for declared in declarations.systems().values() for folder in (declared.folder, declared.judging)]
    for name in declarations.names():
        own += [*(ROOT / "firmware").rglob(f"{name}.[ch]"), *(ROOT / "firmware").rglob(f"{name}_*.[ch]")]
    # README, its picture, the page of the commands and the first header of the C library show a system as their example
    own += [ROOT / "tools" / f"gen_{what}.py" for what in ("readme", "screenshot", "commands")]
    own += [ROOT / "firmware/include/plumb/plumb.h"]
    left = [path for path in found if not {path, *path.parents} & set(own)]
    return [path for path in left if "GENERATED" not in path.read_text(encoding="utf-8").partition("\n")[0]]


def terms() -> set[str]:
    """Words that the sources use whatever the systems are called: the glossary's, and those in names of kernels."""
    glossary = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    kernels = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "host/plumb/kernels").rglob("*.py"))
    functions = re.findall(r"^def (\w+)\(", kernels, re.MULTILINE)
    words = {word for function in functions for word in function.split("_")}
    return words | set(re.findall(r"^### (.+)$", glossary, re.MULTILINE))


def named(names: Iterable[str]) -> re.Pattern[str]:
    """Finds the names of systems. One that is also a term is sought where it cannot be that word: in the path of a
    folder or header, and in what the C calls the system's own."""
    known = terms()
    plain, words = ("|".join(name for name in names if (name in known) == term) or "$^" for term in (False, True))
    own = rf"(systems[./]|judging[./]|plumb/|plumb_)({words})(?![a-z])|(systems import .*\b)({words})\b"
    return re.compile(rf"(?<![a-z])({plain})(?![a-z])|{own}", re.IGNORECASE)


def without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = [*node.body[1:], ast.Pass()]
    return tree


def test_a_system_may_be_called_by_a_term() -> None:
    """The sources say `complementary` of a filter; of a system of that name they must not know."""
    found = named(["complementary", "toy"])
    for line in (
        "from plumb.systems.complementary import plant",
        "plumb_complementary_t",
    ):
        assert found.search(line), line
    for line in ("def complementary(state):", "# a complementary filter", "Complementary filter and average"):
        assert not found.search(line), line
    assert found.search("# the toy")


@pytest.mark.parametrize("path", sources(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nothing_outside_its_folder_names_a_system(path: Path) -> None:
    """But for examples: lines `    plumb ...` of the help of a command, and docstrings of what users import or run."""
    names = named(declarations.names())
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py" and path.parent in (ROOT / "host/plumb", ROOT / "host/plumb/api", ROOT / "tools"):
        text = ast.unparse(without_docstrings(ast.parse(text)))
    lines = text.splitlines()
    if path.parent.name == "cli":
        lines = [line for line in lines if not line.startswith("    plumb ")]
    assert [line for line in [path.stem, *lines] if names.search(line)] == []


GENERIC = ("contract", "spec", "tuning", "link", "boards", "proof", "campaign", "cli", "cockpit")
"""Folders of code for any system."""
VEHICLES = re.compile(r"quadrotor|balancer|turntable", re.IGNORECASE)


@pytest.mark.parametrize("folder", GENERIC)
def test_generic_code_asks_the_declared_system_for_what_is_a_vehicles(folder: str) -> None:
    """Names that are also words of the field stay out of code as well; help and docstrings have them as examples."""
    naming = []
    for path in sorted((ROOT / "host/plumb" / folder).rglob("*.py")):
        code = ast.unparse(without_docstrings(ast.parse(path.read_text(encoding="utf-8"))))
        lines = [line for line in code.splitlines() if not line.lstrip().startswith(("'", '"')) and "help=" not in line]
        naming += [f"{path.name}: {line}" for line in lines if VEHICLES.search(line)]
    assert naming == []


def test_golden_vectors_of_a_toy_system_hold_on_every_board(toy: Plumb, tmp_path: Path) -> None:
    shutil.copy(TOYS / "recipe.toml", tmp_path)
    toy("golden", "make", "--vectors", str(tmp_path))
    boards = ("--board", "native", "--board", "virtual", "--vectors", str(tmp_path), "--json")
    for link in ("serial", "can"):
        report = json.loads(toy("golden", "check", *boards, "--link", link).stdout)
        assert report["verdict"] == "pass"
        assert {name: row["steps"] for name, row in report["boards"].items()} == dict.fromkeys(
            ("fixed", "native", "virtual"), 1000
        )


@pytest.mark.parametrize("options", [("native",), ("virtual",), ("virtual", "--live")], ids=" ".join)
def test_a_toy_system_runs(toy: Plumb, options: tuple[str, ...]) -> None:
    report = json.loads(toy("run", "toy", "--seconds", "3", "--json", "--board", *options).stdout)
    assert (report["verdict"], report["steps"], report["metrics"]["target_vs_fixed_mismatches"]) == ("pass", 300, 0)


def test_parameters_of_a_toy_system_are_rows_of_the_table(toy: Plumb) -> None:
    said = toy("params", "tuning", "toy", "--board", "virtual").stdout
    assert "system: 1 -> 17 (toy)" in said and "3 changed" not in said.splitlines()[0]
    listed = toy("params", "list", "--raw", "--board", "virtual").stdout
    assert "toy.share_q16" in listed


def test_a_toy_system_is_listed_with_what_it_can_be_asked_for(toy: Plumb) -> None:
    assert "toy: a low-pass of one count, for tests" in toy("systems").stdout
    assert "toy" in toy("--help").stdout
    presets = toy("systems", "--system", "toy").stdout
    assert "jumps" in presets and "no target figures are declared" in presets and "noise and how" not in presets
    assert toy("systems", "--table", "--system", "toy").stdout.startswith("no target figures are declared for toy ")


def test_a_command_of_a_toy_system_is_one_of_plumbs(toy: Plumb) -> None:
    assert "  toy-time       the time constant of a share (toy)" in toy("--help").stdout
    assert "usage: plumb toy-time" in toy("toy-time", "--help").stdout
    assert toy("toy-time", "0.1").stdout == "0.095 s\n"


def test_what_a_toy_system_sends_is_recorded_and_shown(toy: Plumb, tmp_path: Path) -> None:
    live = ("--board", "virtual", "--run", "live", "--seconds", "1", "--system", "toy")
    toy("record", *live, "--out", str(tmp_path / "run"), "--format", "csv")
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 90 and all(800 < float(row["filtered"]) < 1100 for row in rows[20:80])
    shown = json.loads(toy("monitor", *live, "--json").stdout.splitlines()[-1])
    assert 800 < shown["filtered"] < 3100 and shown["tilt_deg"] is None
    assert shown["commands"] == {"gain": 1, "heading": 0, "trim": 0, "hold": 0, "mode": 2}
    assert len(shown["raw"]) == 15
    assert {(row["command_gain"], row["raw_battery_counts"]) for row in rows} == {("1", "0")}


def test_commands_act_as_a_set_within_their_limits_or_not_at_all(toy: Plumb, tmp_path: Path) -> None:
    """In a live run; its recording replays to the bit, and its export has the commands that each step used."""
    log = tmp_path / "run.plog"
    said = json.loads(toy.run(toy.python, TOYS / "commands_on_board.py", toy.image, log).stdout)
    assert said["at_start"] == said["after_refusals"] == [1, 0, 0, 0, 0, 2]
    refusals = ("elsewhere", "alone", "incomplete", "out_of_order", "beyond", "mixed")
    assert [said[name] for name in refusals] == ["UNSUPPORTED", "SEQUENCE", "SEQUENCE", "SEQUENCE", "RANGE", "SEQUENCE"]
    assert said["set"] == [-3, 5, -(1 << 14), -100, 0, 1]
    assert (said["different_sets"], said["with_setpoint"], said["mismatches"]) == (2, True, 0)
    for board in ("native", "virtual"):
        assert json.loads(toy("replay", str(log), "--board", board, "--json").stdout)["recorded"]["mismatches"] == 0
    toy("export", str(log), str(tmp_path / "run.csv"))
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["command_gain"], row["command_heading"]) for row in rows} == {("1", "0"), ("-3", str(-(1 << 30) + 5))}


COMMANDS_IN_UNITS = """
import sys, plumb
with plumb.connect("virtual", image=sys.argv[1]) as board:
    board.run("toy", seconds=0.1)
    for sample in board.stream(1.0):
        board.set_commands({"heading": 45.0, "trim": -0.5})
    print(round(sample.signals["heading_deg"], 2))
    for wrong in ({"heading": 91.0}, {"nothing": 1}, {"trim": "x"}):
        try:
            board.set_commands(wrong)
        except plumb.UsageError as error:
            print(error)
"""


def test_commands_are_given_in_units(toy: Plumb) -> None:
    said = toy.run(toy.python, "-c", COMMANDS_IN_UNITS, toy.image).stdout.splitlines()
    assert said == [
        "44.5",
        "heading = 91.0 deg: give -90 to 90 deg",
        "toy has no command 'nothing'; it has gain, heading, trim, hold, mode",
        "trim = 'x': give a number",
    ]


def test_commands_end_with_silence_and_with_arming(toy: Plumb, tmp_path: Path) -> None:
    native, firmware = toy.core.parent, ROOT / "firmware"
    folders = (native / "systems", native / "systems" / "include", firmware, firmware / "include", TOYS / "toy")
    program = tmp_path / "commands"
    libraries = [native / f"libplumb_{name}.a" for name in ("link", "core")]
    warnings = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror")
    toy.run("cc", *warnings, *(f"-I{one}" for one in folders), TOYS / "commands.c", *libraries, "-o", program)
    assert toy.run(program).stdout == ""


def test_an_image_says_which_systems_it_has(toy: Plumb) -> None:
    said = toy("run", "quad", "--board", "virtual", "--open-loop", "--seconds", "1", code=2).stderr
    assert (
        "the board's image has no quad, only balancer, toy: plumb flash --image all has it, and keeps balancer and toy"
        in said
    )
    said = toy("run", "quad", "--board", "native", "--open-loop", "--seconds", "1", code=2).stderr
    assert "the native core was built without quad" in said
    assert (
        json.loads(toy("run", "balancer", "--board", "virtual", "--seconds", "1", "--json").stdout)["verdict"] == "pass"
    )


def test_the_rest_builds_and_runs_without_a_shipped_system(without_quad: Plumb) -> None:
    left = [name for name in declarations.names() if name != "quad"]
    assert [line.split(":")[0] for line in without_quad("systems").stdout.splitlines()] == left
    for board in ("native", "virtual"):
        report = json.loads(without_quad("run", "balancer", "--board", board, "--seconds", "1", "--json").stdout)
        assert report["verdict"] == "pass"
    assert "there is no system 'quad'" in without_quad("run", "quad", "--board", "native", code=2).stderr
    assert "there is no command 'bandwidth'" in without_quad("bandwidth", "2.5", code=2).stderr
    assert "no system here has a demo" in without_quad("demo", code=2).stderr


SYSTEMS = """
import sys
from pathlib import Path
from plumb.boards.virtual import VirtualBoard

with VirtualBoard(Path(sys.argv[1])) as board:
    print(*board.session.require_match().systems)
"""


def test_a_toy_system_is_added_to_the_image_of_all_as_written(with_toy: Plumb) -> None:
    """The build refuses an image beyond its limit."""
    held = with_toy.run(with_toy.python, "-c", SYSTEMS, with_toy.image).stdout.split()
    assert held == [*images.image(images.ALL).systems, "toy"]
    report = json.loads(with_toy("run", "toy", "--board", "virtual", "--seconds", "1", "--json").stdout)
    assert (report["verdict"], report["metrics"]["target_vs_fixed_mismatches"]) == ("pass", 0)


IN_THE_TOWER = """
import sys
from pathlib import Path
from plumb.boards.virtual import VirtualBoard
from plumb.errors import PlumbError
from plumb.spec import parameters

with VirtualBoard(Path(sys.argv[1])) as board:
    session = board.session
    print(*session.require_match().systems)
    words = dict(zip((row.name for row in parameters.table()), session.read_parameters()))
    before = list(words.values())
    for name, value in (("toy.share_q16", 65536), ("tower.height_q16", 5), ("pid.kp_q22", 7)):
        words[name] = value
        try:
            session.parameters.change(before, list(words.values()))
            before = list(words.values())
        except PlumbError as error:
            print(error)
            words = dict(zip(words, before))
"""


def test_an_image_holds_what_its_system_stands_on(tower: Plumb) -> None:
    """Step and parameters of the other system, which is not one of the image's."""
    said = tower.run(tower.python, "-c", IN_THE_TOWER, tower.image).stdout.splitlines()
    assert said[0] == "tower" and len(said) == 2
    assert "the board's image has only tower, and does not hold the parameters of pid: " in said[1]
