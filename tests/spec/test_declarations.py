"""A declaration that cannot be used is refused in one sentence that names the file and the entry."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.spec import declarations, images
from plumb.spec.system import System

ERROR = '{ name = "error_counts_q16", type'
"""The second entry of the record."""
DRIVEN = 'kind = "BRIDGE", word = "filtered_counts_q16"'
LEARNED = 'learned = {{ word = "{}", parameter = "{}" }}'
REASONED = 'record = [ { name = "stop_reason", type = "uint32", unit = "", format = "bits", doc = "why" },'
TOY = Path(__file__).resolve().parents[1] / "toy_systems" / "toy" / "system.toml"


def fallen(bit: int) -> str:
    return f'{{ bit = {bit}, name = "fallen", doc = "it fell" }}'


def load(folder: Path, text: str) -> System:
    shutil.copytree(TOY.parents[1] / "judging", folder / "judging")
    (folder / "toy").mkdir()
    (folder / "toy" / "system.toml").write_text(text, encoding="utf-8")
    return declarations.load_system(folder / "toy")


def test_the_toy_is_accepted_as_it_is(tmp_path: Path) -> None:
    assert load(tmp_path, TOY.read_text(encoding="utf-8")).name == "toy"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("number = 17", "number = 17.0", "number is an integer from 0 to 17, not 17.0"),
        ("number = 17", "number = true", "number is an integer"),
        ("number = 17", 'number = "17"', "number is an integer"),
        ("number = 17", "number = 99", "number is an integer"),
        ("number = 17\n", "", "number is missing"),
        ("record = [", 'record = [ "x",', "'x' is no table"),
        (
            ERROR,
            '{ name = "error_counts_q16", count = -3, type',
            "count of error_counts_q16",
        ),
        (
            ERROR,
            '{ name = "e", count = 3, names = ["a"], type',
            "has 1 names for 3 words",
        ),
        (ERROR, '{ name = "e", block = "zzz", type', "there is no block 'zzz'"),
        ('format = "Q16", doc = "filtered level"', 'format = "Q99x", doc = "filtered level"', "the format is Q"),
        ('format = "Q16", doc = "filtered level"', 'format = 16, doc = "filtered level"', "a line of text"),
        ('name = "error_counts_q16"', 'name = "int"', "cannot be a name in C"),
        ('name = "error_counts_q16"', 'name = "steps; }"', "cannot be a name in C"),
        ('doc = "filtered level"', 'doc = "ends */ here"', "a line of text"),
        ('doc = "filtered level"', 'doc = "two\\nlines"', "a line of text"),
        ('name = "LEVEL"', 'name = "LE VEL"', "cannot be a name in C"),
        ('half = { name = "flags"', 'half = { name = "filtered"', "both parts are named filtered"),
        ('half = { name = "flags"', 'half = { shift = 99, name = "flags"', "shift is 0 to 31"),
        ('name = "CLAMPED"', "name = 5", "a flag is a line of text"),
        ("min = 1\nmax = 429496729", "max = 429496729", "toy.dt_s_q32: min is missing"),
        ("min = 1\nmax = 429496729", 'min = "1"\nmax = 429496729', "min is an integer"),
        ("min = 1\nmax = 429496729", "mean = 5\nmin = 1\nmax = 429496729", "mean is unknown"),
        ('name = "toy.raw_max"', 'name = "rawmax"', "cannot be a name"),
        ('period = "toy.dt_s_q32"', 'period = "nix.dt"', "names a parameter of the groups"),
        ("groups = []", f"groups = []\n{LEARNED.format('nix', 'toy.share_q16')}", "no word 'nix' that a step learns"),
        ("groups = []", f"groups = []\n{LEARNED.format('total_counts', 'nix.x')}", "reads no parameter 'nix.x'"),
        (
            "groups = []",
            f"groups = []\n{LEARNED.format('total_counts', 'toy.share_q16')}",
            "has the type and the format",
        ),
        ("groups = []", 'groups = []\noutput = { kind = "PULSES", word = "clamped_steps" }', "driven by 2 words"),
        (
            "groups = []",
            f"groups = []\noutput = {{ {DRIVEN} }}",
            "output.checks is one of axis, flight, ride, own, none, not",
        ),
        ("groups = []", f'groups = []\noutput = {{ {DRIVEN}, checks = "some" }}', "output.checks is one of axis"),
        ("groups = []", f'groups = []\noutput = {{ {DRIVEN}, checks = "own" }}', "no flag says fails = true"),
        ("groups = []", f'groups = []\noutput = {{ {DRIVEN}, checks = "none" }}', "output.unchecked says why"),
        ("groups = []", f'groups = []\noutput = {{ {DRIVEN}, checks = "axis", unchecked = "x" }}', "only then"),
        ("saturated = true,", "saturated = true, fails = true,", "fails and unready are for an output"),
        ("saturated = true,", "saturated = true, fails = 1,", "are true or false"),
        ("groups = []", "groups = " + "[" * 5000, "nested too deep"),
        ("groups = []", 'groups = []\ndefault_for = ["replay"]', "replay is replay.py, which is missing"),
        ("groups = []", "groups = []\ndefault_for = [5]", "default_for is a line of text"),
        ("toy-time =", "toy-space =", "toy-space is commands/toy_space.py, which is missing"),
        ("toy-time =", '"../toy" =', "is no name"),
        ('toy-time = "the time constant of a share"', "toy-time = 5", "command toy-time is a line of text"),
        ("groups = []", 'groups = ["nonsense"]', "no shared group 'nonsense'; there are gyro, accel,"),
        ("groups = []", 'groups = ["toy"]', "there is no shared group 'toy'"),
        ("groups = []", "groups = [7]", "there is no shared group 7"),
        ("groups = []", 'groups = "gyro"', "groups is a list"),
        ('unit = "count", doc = "what', 'unit = "cuont", doc = "what', "channel level: unit 'cuont' has 'cuont'"),
        ('unit = "step", format', 'unit = "step/sec", format', "unit 'step/sec' has 'sec'"),
        ('unit = "s"\nformat = "Q32"', 'unit = "second"\nformat = "Q32"', "parameter toy.dt_s_q32: unit 'second'"),
        ("record = [", f"stop_reasons = [{fallen(5)}]\nrecord = [", "stop_reasons: the record has no word stop_reason"),
        ("record = [", f"stop_reasons = [{fallen(8)}]\n{REASONED}", "stop reason fallen: bit is 0 to 7, not 8"),
        ("record = [", f"stop_reasons = [{fallen(3)}, {fallen(3)}]\n{REASONED}", "bit 3 is that of fallen"),
        ('doc = "what is', 'calibration = "gyro", doc = "what is', "calibration = 'gyro': it is one of the groups"),
        ('doc = "what is', 'calibration = "toy", doc = "what is', "a calibration has the rows raw_min"),
        ("min = 1\nmax = 429496729", 'was = "old"\nmin = 1\nmax = 429496729', "was is a list of former names"),
        ("groups = []", 'groups = []\nstands_on = "toy"', "stands_on is a list of names of systems, not 'toy'"),
        ("groups = []", "groups = []\nstands_on = [7]", "stands_on is a list of names of systems, not [7]"),
        ("groups = []", 'groups = []\nstands_on = ["toy"]', "stands_on: toy cannot stand on itself"),
        ("groups = []", 'groups = []\nstands_on = ["nothing"]', "stands_on: there is no system 'nothing'; there are "),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = TOY.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(UsageError) as refused:
        load(tmp_path, text.replace(old, new, 1))
    sentence = str(refused.value)
    assert said in sentence and str(tmp_path / "toy" / "system.toml") in sentence and "\n" not in sentence


def on_each_other(folder: Path, **stands_on: str) -> None:
    """Copies of the toy, each with a name and a number of its own, and a group of that name; each stands on one, or on
    none (""). Its period is the toy's."""
    shutil.copytree(TOY.parents[1] / "judging", folder / "judging")
    text = TOY.read_text(encoding="utf-8").replace("toy.", "NAME.").partition("[commands]")[0]
    for number, (name, base) in enumerate(stands_on.items(), 15):
        own = text.replace("NAME", name).replace("number = 17", f"number = {number}")
        if base:
            own = own.replace("groups = []", f'groups = []\nstands_on = ["{base}"]')
            own = own.replace(f'period = "{name}.', f'period = "{base}.')
        (folder / name).mkdir()
        (folder / name / "system.toml").write_text(own, encoding="utf-8")


def test_a_system_has_the_groups_of_what_it_stands_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_each_other(tmp_path, low="", middle="low", high="middle")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    high = declarations.system("high")
    assert (high.stands_on, high.all_groups) == (("middle",), ("low", "middle", "high"))
    assert declarations.system("low").all_groups == ("low",)
    assert [one.name for one in declarations.with_bases(["high"])] == ["low", "middle", "high"]
    held = images.held_groups(["high"])
    assert {"low", "middle", "high"} < held and "low" in images.held_groups(["low"])
    assert "high" not in images.held_groups(["low"]) and images.image("high").systems == ("high",)


def test_systems_that_stand_on_each_other_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_each_other(tmp_path, one="two", two="one")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    with pytest.raises(UsageError, match=r"one.system\.toml: .*two.system\.toml: stands_on: one stands on two already"):
        declarations.load_system(tmp_path / "one")


def test_a_group_of_what_a_system_stands_on_is_not_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_each_other(tmp_path, low="", high="low")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    declared = tmp_path / "high" / "system.toml"
    declared.write_text(declared.read_text(encoding="utf-8").replace("high.share", "low.part"), encoding="utf-8")
    with pytest.raises(UsageError, match=r"parameter low\.part_q16: low, on which it stands, has this group$"):
        declarations.load_system(tmp_path / "high")


def test_a_system_that_something_stands_on_cannot_go_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_each_other(tmp_path, low="", high="low")
    monkeypatch.setenv(declarations.SEARCH_PATH, str(tmp_path))
    shutil.rmtree(tmp_path / "low")
    with pytest.raises(UsageError, match=r"high.system\.toml: stands_on: there is no system 'low'"):
        declarations.systems()
