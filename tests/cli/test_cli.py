"""The front door: every verb is known, help is light, and every failure is one sentence with the right exit code."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.cli import options, verbs
from plumb.errors import LinkError, PlumbError, UsageError, VerdictError, exit_code_of

HEAVY = {"numpy", "can", "cantools", "serial", "unicorn", "matplotlib"}


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["--help"], *([name, "--help"] for name in verbs.commands())])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    program = (
        "import sys\nfrom plumb.__main__ import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        f"print('HEAVY', sorted({HEAVY!r} & set(sys.modules)))"
    )
    answer = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines()[-1] == "HEAVY []"
    assert "usage: plumb" in answer.stdout


def test_top_level_help_names_every_verb() -> None:
    text = front.top_level_help()
    assert all(f"  {name} " in text for name in verbs.commands())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["soar"], "there is no command 'soar'"),
        (["run", "quad", "--board", "toaster"], "'toaster' is not a board"),
        (["run", "quad", "--board", "serial:/dev/no-such-port@fast"], "baud rate"),
        (["replay", "no-such-file.npz", "--board", "native"], "no-such-file.npz"),
    ],
)
def test_wrong_use_is_one_sentence_and_exit_2(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(arguments) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert len(captured.err.strip().splitlines()) == 1
    assert captured.out == ""


def test_golden_check_refuses_a_wrong_board_before_any_vector_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    checked: list[object] = []
    monkeypatch.setattr("plumb.proof.golden.check", lambda board, *_, **__: checked.append(board))
    assert front.main(["golden", "check", "--board", "toaster"]) == 2
    assert "'toaster' is not a board" in capsys.readouterr().err
    assert not checked


def test_a_port_that_does_not_exist_is_link_trouble(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["run", "quad", "--board", "serial:/dev/no-such-port", "--seconds", "1"]) == 3
    assert "/dev/no-such-port" in capsys.readouterr().err


def test_a_missing_image_names_the_command_that_makes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "firmware.bin"
    assert front.main(["run", "quad", "--board", "virtual", "--image", str(missing), "--seconds", "1"]) == 2
    assert "firmware.bin" in capsys.readouterr().err


@pytest.mark.parametrize(("error", "code"), [(VerdictError, 1), (UsageError, 2), (LinkError, 3)])
def test_exit_codes_follow_the_kind_of_trouble(error: type[PlumbError], code: int) -> None:
    assert error("why").exit_code == code


@pytest.mark.parametrize(("verdict", "code"), [("pass", 0), ("fail", 1), ("unverified", 3)])
def test_the_exit_code_follows_the_verdict(verdict: str, code: int) -> None:
    assert exit_code_of(verdict) == code


def test_an_interrupt_is_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(_name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(verbs, "command_parser", interrupted)
    assert front.main(["ports"]) == 130
    assert capsys.readouterr().err == "plumb: interrupted.\n"


def test_the_default_system_of_a_command_is_declared_and_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = argparse.Namespace(system=None)
    name = options.system_with(asked, "replay")
    options.print_default(asked, name, "replay")
    others = [other for other in systems.with_part("replay") if other != name]
    said = f"system {name}, the default of replay; --system takes {', '.join(others)}, too\n"
    assert capsys.readouterr().err == said
    assert options.system_with(argparse.Namespace(system=others[-1]), "replay") == others[-1]
    monkeypatch.setattr(systems, "with_part", lambda part: ("balancer", others[-1]))
    with pytest.raises(UsageError, match=f"say which system, with --system: balancer, {others[-1]}"):
        options.system_with(asked, "replay")
