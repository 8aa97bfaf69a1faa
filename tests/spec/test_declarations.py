"""A declaration that cannot be used is refused in one sentence that names the file and the entry."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.spec.system import System

ERROR = '{ name = "error_counts_q16", type'
"""The second entry of the record."""
TOY = Path(__file__).resolve().parents[1] / "toy_systems" / "toy" / "system.toml"


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
        ("groups = []", 'groups = []\noutput = { kind = "PULSES", word = "clamped_steps" }', "driven by 2 words"),
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
        ('doc = "what is', 'calibration = "gyro", doc = "what is', "calibration = 'gyro': it is one of the groups"),
        ('doc = "what is', 'calibration = "toy", doc = "what is', "a calibration has the rows raw_min"),
        ("min = 1\nmax = 429496729", 'was = "old"\nmin = 1\nmax = 429496729', "was is a list of former names"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = TOY.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(UsageError) as refused:
        load(tmp_path, text.replace(old, new, 1))
    sentence = str(refused.value)
    assert said in sentence and str(tmp_path / "toy" / "system.toml") in sentence and "\n" not in sentence
