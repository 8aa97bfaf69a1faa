"""The user who types it wrong: every mistake is one sentence on one line, exit code 2 or 3, and no traceback."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.cli import verbs
from plumb.cli.command_line import shown

NOT_TEXT = os.fsdecode(b"n\xff\xfe")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with what is no input."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "circle").symlink_to("circle")
    for suffix in ("", ".npz", ".csv", ".asc", ".blf", ".trc", ".log", ".toml", ".bin"):
        (tmp_path / f"empty{suffix}").write_bytes(b"")
        (tmp_path / f"garbage{suffix}").write_bytes(bytes(range(256)) * 8)
    (tmp_path / f"{NOT_TEXT}.csv").write_text("time_s,a\n1,2\n")


def answer(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and the last line on stderr, which is all there is unless argparse shows the usage first."""
    try:
        code = front.main(arguments)
        own = True
    except SystemExit as end:
        code, own = int(end.code or 0), False
    err = capsys.readouterr().err
    lines = err.splitlines()
    assert "Traceback" not in err and "defect" not in err, err
    assert not own or len(lines) == 1, err
    return code, lines[-1] if lines else ""


RUN = ["run", "quad", "--board", "native", "--open-loop"]
SHORT = [*RUN, "--seconds", "0.1"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        # nothing where a value belongs
        (["run", ""], 2, "'' has no value"),
        (["systems", "--system="], 2, "'--system=' has no value"),
        (["systems", "--system=--"], 2, "'--system=--' has no value"),
        (["systems", "--system", "quad", "--confirm="], 2, "'--confirm=' has no value"),
        (["golden", "check", "--vectors="], 2, "'--vectors=' has no value"),
        # numbers that are none
        ([*RUN, "--seconds", "nan"], 2, "--seconds nan: give a finite number"),
        ([*RUN, "--seconds=inf"], 2, "--seconds inf: give a finite number"),
        ([*RUN, "--seconds=-inf"], 2, "--seconds -inf: give a finite number"),
        ([*RUN, "--seconds=1e400"], 2, "--seconds inf: give a finite number"),
        (["systems", "--table", "--seconds=nan"], 2, "--seconds nan"),
        (["monitor", "--board", "virtual", "--seconds=nan"], 2, "--seconds nan"),
        (["flash", "--port", "none", "--wait=nan"], 2, "--wait nan"),
        (["bandwidth", "nan"], 2, "nan"),
        ([*RUN, "--seconds", "soon"], 2, "invalid float value: 'soon'"),
        ([*RUN, "--seed", "1.5"], 2, "'1.5' is no whole number; write for example 1000"),
        ([*RUN, "--seed", "9" * 19], 2, "--seed: give a number of at most 18 digits"),
        ([*RUN, "--seed", "9" * 400], 2, "at most 18 digits"),
        (["link-test", "--board", "virtual", "--seed=-1"], 2, "a seed is 0 or more, not -1"),
        # names that are none
        (["fly\n"], 2, r"there is no command 'fly\n'"),
        (["run", "QUAD", "--board", "native"], 2, "there is no system 'QUAD'"),
        (["run", "quad\n", "--board", "native"], 2, r"there is no system 'quad\n'"),
        (["run", "\x1b[31m", "--board", "native"], 2, r"there is no system '\x1b[31m'"),
        (["run", NOT_TEXT, "--board", "native"], 2, r"there is no system 'n\udcff\udcfe'"),
        (["run", "../quad", "--board", "native"], 2, "there is no system '../quad'"),
        ([*SHORT, "--tuning", "best"], 2, "no tuning 'best'"),
        ([*SHORT, "--condition", "bandwidth_hz"], 2, "sets nothing"),
        ([*SHORT, "--condition", "bandwidth_hz=nan"], 2, "a number from 0 up"),
        ([*SHORT, "--fault", "stuck:gyro@nan"], 2, "stuck:gyro@nan"),
        ([*SHORT, "--fault", "@"], 2, "'@'"),
        # ports
        (["monitor", "--board", "serial:folder"], 2, "'folder' is a folder, not a serial port"),
        (["monitor", "--board", "serial:garbage"], 2, "'garbage' is a file, not a serial port"),
        (["monitor", "--board", "can:slcan:garbage@115200"], 2, "'garbage' is a file, not a serial port"),
        (["monitor", "--board", "serial:/dev/null"], 3, "/dev/null is not a serial port"),
        (["monitor", "--board", "serial:missing@115200"], 3, "there is no port missing"),
        (["monitor", "--board", "serial:socket://127.0.0.1:70000"], 2, "write socket://HOST:PORT"),
        (["monitor", "--board", "serial:rfc2217://127.0.0.1:1"], 3, "127.0.0.1:1 (Connection refused): check"),
        (["virtual-board", "--serial", "tcp:0", "--symlink", "board"], 2, "--symlink names a terminal"),
        (["sensor-board", "quad", "--bus", "tcp:127.0.0.1:0", "--symlink", "x"], 2, "--symlink names a terminal"),
        (["monitor", "--board", "can:socketcand:127.0.0.1:99999:can0"], 2, "can:socketcand:HOST:PORT:CHANNEL"),
        (["record", "--bus", "udp:65536", "--out", "a.asc"], 2, "a port is a number up to 65535"),
        # files
        (["replay", "/", "--board", "native"], 2, "/ holds no table of a gyro and an accelerometer"),
        (["replay", f"{NOT_TEXT}.csv", "--board", "native"], 2, r"n\udcff\udcfe.csv needs columns"),
        (["replay", "garbage.npz", "--board", "native"], 2, "damaged"),
        (["virtual-board", "--keep", "nowhere/board.flash"], 2, "there is no folder nowhere"),
        (["virtual-board", "--vcd", "a", "--keep", "folder/../a"], 2, "folder/../a is named twice"),
        (["virtual-board", "--vcd", "circle", "--keep", "circle"], 2, "circle is named twice"),
        (["cockpit", "--board", "virtual", "--out", "empty"], 2, "empty is no folder"),
        (["cockpit", "--board", "virtual", "--out", "garbage/recordings"], 2, "garbage is no folder"),
        (["cockpit", "--board", "virtual", "--out", "circle"], 2, "circle is no folder"),
        (["golden", "check", "--junit", "a", "--html", "./a"], 2, "a is named twice"),
        (["replay", "folder", "--board", "native"], 2, "a folder"),
        (["record", "--bus", "file:garbage.blf", "--out", "a.asc"], 2, "garbage.blf holds no frames in a format"),
        (["record", "--bus", "file:missing.asc", "--out", "a.asc"], 2, "No such file"),
        (["record", "--bus", "file:folder", "--out", "a.asc"], 2, "a folder"),
        (["golden", "check", "--vectors", "garbage"], 2, "holds no recipe.toml"),
        (["run", "quad", "--board", "virtual", "--image", "garbage.bin", "--seconds", "1"], 2, "no"),
        (["run", "quad", "--board", "virtual", "--image", "folder", "--seconds", "1"], 2, "folder"),
    ],
    ids=str,
)  # fmt: skip
def test_a_mistake_is_one_sentence(
    arguments: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    got, line = answer(arguments, capsys)
    assert (got, said in line) == (code, True), line


def options(parser: argparse.ArgumentParser, verb: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """Every long option that takes a value, with the verbs before it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from options(inner, (*verb, name))
        elif action.option_strings and action.nargs is None:
            yield verb, action.option_strings[-1]


@pytest.mark.parametrize("board", [[], ["--board", "serial:/no/such/port"]], ids=["no board", "a board that is gone"])
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "hexacopter"], "there is no system 'hexacopter'; this version has quad"),
        (["run", "quad", "--scenario", "x"], "quad has no scenario 'x'; it has motion"),
        (["run", "quad", "--tuning", "x"], "quad has no tuning 'x'; it has adaptive"),
        (["run", "quad", "--start", "x"], "quad has no start-up mode 'x'; it has paper"),
        (["run", "quad", "--fault", "x"], "'x' is no fault"),
        (["run", "quad", "--condition", "a=1"], "quad has no condition 'a'"),
        (["run", "quad", "--change", "3:pid.kp=1"], "--change is for --live"),
        (["replay", "nothere.plog"], "cannot read nothere.plog: No such file"),
        (["replay", "nothere.csv"], "cannot read nothere.csv: No such file"),
        (["params", "load", "nothere.toml"], "cannot read nothere.toml: No such file"),
        (["params", "tuning", "hexacopter"], "there is no system 'hexacopter'"),
        (["calibrate", "--answers", "nothere"], "cannot read nothere: No such file"),
        (["monitor", "--system", "hexacopter"], "there is no system 'hexacopter'"),
    ],
    ids=str,
)
def test_what_was_typed_wrong_is_named_before_the_board(
    arguments: list[str], said: str, board: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, line = answer([*arguments, *board], capsys)
    assert (code, said in line) == (2, True), line


@pytest.mark.parametrize("image", ["nothere.bin"])
def test_an_image_that_is_not_there_is_named_before_the_board(image: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, line = answer(["link-test", "--image", image], capsys)
    assert (code, "there is no file nothere.bin" in line) == (2, True), line


EVERY_OPTION = [(name, *found) for name in verbs.commands() for found in options(verbs.command_parser(name))]


@pytest.mark.parametrize("value", ["=", "=--"])
@pytest.mark.parametrize(("name", "verb", "option"), EVERY_OPTION, ids=str)
def test_an_option_without_a_value_is_never_taken_as_not_given(
    name: str, verb: tuple[str, ...], option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = f"plumb: '{option}{value}' has no value: write one, or leave it out"
    assert answer([name, *verb, option + value], capsys) == (2, said)


def test_what_is_shown_is_one_line_of_text() -> None:
    assert shown("as it is: 1.5 µm, Grüße") == "as it is: 1.5 µm, Grüße"
    assert shown("a\nb\x1b[0m\udcff") == r"a\nb\x1b[0m\udcff"


def test_a_long_word_is_cut(capsys: pytest.CaptureFixture[str]) -> None:
    word = 100_000 * "x"
    for arguments in ([word], ["run", word, "--board", "native"], ["monitor", "--board", f"serial:{word}"]):
        code, line = answer(arguments, capsys)
        assert code in (2, 3) and "xxx..." in line and len(line) < 500
    path = "/a/folder" * 20
    assert shown(f"there is no folder {path}") == f"there is no folder {path}"


def test_a_name_that_is_no_text_can_be_said(capfd: pytest.CaptureFixture[str]) -> None:
    with contextlib.suppress(SystemExit):
        front.main(["replay", f"{NOT_TEXT}.csv", "--board", "native"])
    assert r"n\udcff\udcfe.csv needs columns" in capfd.readouterr().err
