"""Completion with values, asked of the shells themselves. Each shell has a `plumb` that answers from this plumb."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.cli import completion, verbs
from plumb.link.served_boards import Entry

ASKED = [
    ("plumb moni", ["monitor"]),
    ("plumb run quad", ["quad", "quadrotor"]),
    ("plumb run quad --scenario hol", ["hold"]),
    ("plumb monitor --board virt", ["virtual"]),
    ("plumb params set pid.kp", ["pid.kp="]),
    ("plumb settings bo", ["board="]),
    ("plumb replay a.c", ["a.csv"]),
    ("plumb run quad --board nati", ["native"]),
]
BASH = """\
plumb() { "$PYTHON" -m plumb "$@"; }
source ./plumb.bash
COMP_LINE=$1 COMP_POINT=${#1} COMPREPLY=()
_plumb 2>/dev/null
printf '%s\\n' "${COMPREPLY[@]}"
"""
FISH = "function plumb; $PYTHON -m plumb $argv; end; source ./plumb.fish; complete -C $argv[1]"
ZSH = """\
plumb() { $PYTHON -m plumb $@ }
compadd() { local array=${@[-1]}; print -rl -- ${(P)array} }
_arguments() { : }
source ./plumb.zsh
_plumb_values -J -default- $1
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("shell")
    for shell in ("bash", "zsh", "fish"):
        (place / f"plumb.{shell}").write_text(completion.script(shell))
    (place / "a.csv").write_text("")
    return place


def answers(folder: Path, command: list[str]) -> list[str]:
    done = subprocess.run(
        ["env", f"PYTHON={sys.executable}", *command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert not done.stderr, done.stderr
    return done.stdout.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize(("line", "wanted"), ASKED)
def test_bash(line: str, wanted: list[str], folder: Path) -> None:
    assert answers(folder, ["bash", "-c", BASH, "bash", line]) == wanted


@pytest.mark.slow
def test_bash_completes_names_with_colons(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For bash serial:socket://127... is several words; it wants the end of the last one."""
    with Entry("quad") as entry:
        entry.add("serial:socket://127.0.0.1:4000")
        line = "plumb monitor --board serial:socket:"
        assert answers(folder, ["bash", "-c", BASH, "bash", line]) == ["//127.0.0.1:4000"]


@pytest.mark.slow
@pytest.mark.parametrize(("line", "wanted"), ASKED)
def test_fish(line: str, wanted: list[str], folder: Path) -> None:
    got = answers(folder, ["fish", "--no-config", "-c", FISH, line])
    assert [one.partition("\t")[0] for one in got] == wanted


@pytest.mark.slow
def test_zsh(folder: Path) -> None:
    """The script is sound, and its function for values passes those of the kind on, behind options that zsh adds."""
    assert answers(folder, ["zsh", "-n", "plumb.zsh"]) == []
    assert answers(folder, ["zsh", "-f", "-c", ZSH, "zsh", "setting"]) == completion.values("setting")
    text = (folder / "plumb.zsh").read_text()
    assert ":_plumb_values board" in text and ":_plumb_values assignment" in text and "hold" in text


def test_every_kind_has_values_and_opens_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.Serial.open", lambda self: pytest.fail("a port was opened"))
    for kind in completion.KINDS:
        assert completion.values(kind) or kind == "bus"


def test_every_command_is_in_every_script(folder: Path) -> None:
    for shell in ("bash", "zsh", "fish"):
        text = (folder / f"plumb.{shell}").read_text()
        assert all(name in text for name in verbs.commands())


@pytest.mark.parametrize("arguments", [["values"], ["bash", "board"]])
def test_values_need_a_kind_and_a_shell_has_none(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["completion", *arguments]) == 2
    assert "plumb completion values KIND" in capsys.readouterr().err
