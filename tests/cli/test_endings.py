"""How the program ends: signals, a reader that leaves, a full disk, a defect. One sentence, and the right exit code."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.cli import verbs
from plumb.errors import UsageError, VerdictError
from plumb.flash.image import find_image

FULL = Path("/dev/full")
ENTRY = "from plumb.__main__ import entry\n"


def program(text: str, *arguments: str, stdout: int = subprocess.PIPE) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a Python program that is the `plumb` command with something in its way."""
    done = subprocess.run(
        [sys.executable, "-c", text, *arguments],
        stdout=stdout, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, timeout=120, check=False,
        env={**os.environ, "PYTHONUNBUFFERED": ""},
    )  # fmt: skip
    return done.returncode, done.stdout or "", done.stderr


def in_the_way(command: str, body: str) -> str:
    """The program, with this body as the command's main."""
    return (
        f"import os, signal, sys, plumb.cli.{command} as module\n{ENTRY}"
        f"def instead(arguments):\n    {body}\nmodule.main = instead\nentry()"
    )


# ---- Ctrl-C and SIGTERM ----

INTERRUPTED_AT_IMPORT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
left = int(sys.argv.pop(1))
def hook(event, details):
    global left, begun
    if event == "import":
        begun = begun or details[0] == "plumb.process_signals"
        left -= begun
        if left == 0:
            left = -1
            os.kill(os.getpid(), signal.SIGINT)
begun = False
sys.addaudithook(hook)
from plumb.__main__ import entry
entry()
"""
"""Ctrl-C at one of the imports, counted from the first of `entry`."""


@pytest.mark.parametrize("import_number", [1, 2, 5, 12, 40, 80, 83, 200])
def test_an_interrupt_while_modules_load_is_one_line_and_130(import_number: int) -> None:
    code, out, err = program(INTERRUPTED_AT_IMPORT, str(import_number), "golden", "check", "--board", "native")
    assert (code, out, err) == (130, "", "plumb: interrupted.\n")


def test_the_front_door_itself_imports_nothing_that_takes_time() -> None:
    text = "import sys\nbefore = set(sys.modules)\nimport plumb.__main__\nprint(*sorted(set(sys.modules) - before))"
    code, out, _ = program(text)
    assert code == 0 and not {"argparse", "re", "json", "plumb.errors", "numpy"} & set(out.split())


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [("SIGINT", 130, "plumb: interrupted.\n"), ("SIGTERM", 143, "plumb: terminated.\n")],
)
def test_a_signal_ends_a_command_in_good_order(number: str, code: int, said: str) -> None:
    body = f"signal.signal(signal.SIGINT, signal.default_int_handler); os.kill(os.getpid(), signal.{number}); return 0"
    assert program(in_the_way("ports", body), "ports") == (code, "", said)


TERMINATED_IN_FLIGHT = """
import os, signal
from plumb.boards.virtual import VirtualBoard
from plumb.link.session import Session
connect, receive, close, machine, driving = VirtualBoard._connect, Session.receive, VirtualBoard.close, None, 0
def pulses():
    return machine.pwm("PB6").pulse_us, machine.pwm("PB7").pulse_us
def connected(board):
    global machine
    machine = board.machine
    return connect(board)
def received(session, timeout_s):
    global driving
    frames = receive(session, timeout_s)
    driving += 1000.0 not in pulses()
    if driving == 50:
        print("driving", *pulses())
        os.kill(os.getpid(), signal.SIGTERM)
    return frames
def closed(board):
    close(board)
    machine.advance_us(50_000)
    print("after", *pulses())
VirtualBoard._connect, Session.receive, VirtualBoard.close = connected, received, closed
from plumb.__main__ import entry
entry()
"""
"""SIGTERM in the middle of an armed run, and what the motors get before it and 50 ms after the link was closed."""


def test_sigterm_in_a_live_run_leaves_the_motors_at_neutral_and_no_files(tmp_path: Path) -> None:
    pytest.importorskip("unicorn")
    try:
        find_image()
    except UsageError as missing:
        pytest.skip(str(missing))
    out = tmp_path / "out"
    arguments = ["run", "quad", "--board", "virtual", "--live", "--seconds", "20", "--out", str(out)]
    code, said, err = program(TERMINATED_IN_FLIGHT, *arguments)
    assert (code, err) == (143, "plumb: terminated.\n")
    driving, after = said.splitlines()
    assert driving.split()[1:] != ["1000.0", "1000.0"] and after.split()[1:] == ["1000.0", "1000.0"]
    assert not out.exists()


# ---- a reader that leaves ----


def closed_pipe() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize("verdict", [0, 1, 3])
def test_a_reader_that_left_does_not_change_a_verdict(verdict: int) -> None:
    writer = closed_pipe()
    try:
        code, _, err = program(in_the_way("ports", f"print('said'); return {verdict}"), "ports", stdout=writer)
    finally:
        os.close(writer)
    assert (code, err) == (verdict, "")


def test_a_reader_that_leaves_before_the_verdict_is_no_0() -> None:
    writer = closed_pipe()
    try:
        code, _, err = program(in_the_way("ports", "print('said', flush=True); return 0"), "ports", stdout=writer)
    finally:
        os.close(writer)
    assert (code, err) == (141, "")


# ---- no room for the output ----


@pytest.mark.skipif(not FULL.exists(), reason="the system has no /dev/full")
@pytest.mark.skipif(sys.platform == "win32", reason="the descriptors of a POSIX shell")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize("verdict", [0, 1])
def test_a_stream_that_the_caller_closed_leads_to_nowhere(closed: str, verdict: int, tmp_path: Path) -> None:
    """No traceback, the verdict's exit code, and what is printed does not end up in a file that is opened next."""
    body = f"file = open('file', 'w'); print('said'); print('trouble', file=sys.stderr); return {verdict}"
    words = [sys.executable, "-c", in_the_way("ports", body), "ports"]
    command = f'exec "$@" {closed}'
    done = subprocess.run(
        ["sh", "-c", command, "sh", *words], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == verdict
    assert done.stdout == ("said\n" if closed in ("2>&-", "<&-") else "")
    assert done.stderr == ("" if "2>&-" in closed else "trouble\n")
    assert (tmp_path / "file").read_text() == ""


@pytest.mark.parametrize(("verdict", "code"), [(0, 2), (1, 1)])
def test_output_that_cannot_be_written_is_a_sentence_and_no_0(verdict: int, code: int) -> None:
    with FULL.open("w", encoding="utf-8") as full:
        got, _, err = program(in_the_way("ports", f"print('said'); return {verdict}"), "ports", stdout=full.fileno())
    assert got == code
    assert err.count("\n") == 1 and "No space left on device" in err


@pytest.mark.skipif(not FULL.exists(), reason="the system has no /dev/full")
def test_a_sentence_that_cannot_be_written_keeps_its_exit_code() -> None:
    with FULL.open("w", encoding="utf-8") as full:
        done = subprocess.run([sys.executable, "-m", "plumb", "soar"], stderr=full, timeout=60, check=False)
    assert done.returncode == 2


# ---- defects ----


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (IndexError("list index out of range"), 4, "defect in plumb (IndexError: list index out of range)"),
        (AssertionError(), 4, "defect in plumb (AssertionError)"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
        (FileNotFoundError(2, "No such file or directory", "here"), 2, "here: No such file or directory"),
        (MemoryError(), 2, "too little memory"),
        (ModuleNotFoundError("No module named 'unicorn'", name="unicorn"), 2, "'unicorn' is not installed"),
        (ModuleNotFoundError("No module named 'plumb.x'", name="plumb.x"), 4, "defect in plumb"),
        (BrokenPipeError(32, "Broken pipe"), 4, "defect in plumb"),
    ],
)
def test_an_exception_that_nobody_foresaw_is_a_sentence(
    error: Exception, code: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def defective(_name: str) -> None:
        raise error

    monkeypatch.setattr(verbs, "command_parser", defective)
    assert front.main(["ports"]) == code
    err = capsys.readouterr().err
    assert said in err and err.startswith("plumb: ") and err.count("\n") == 1
    assert ("--debug" in err) == (code == 4)


@pytest.mark.parametrize("error", [IndexError("where it broke"), VerdictError("where it broke")])
@pytest.mark.parametrize("arguments", [["--debug", "ports"], ["ports", "--debug"]])
def test_debug_shows_where_an_error_comes_from(
    error: Exception, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def defective(_name: str) -> None:
        raise error

    monkeypatch.setattr(verbs, "command_parser", defective)
    assert front.main(arguments) in (1, 4)
    err = capsys.readouterr().err
    assert "Traceback" in err and "in defective" in err
    assert err.splitlines()[-1].startswith("plumb: ")


def test_the_help_names_the_exit_codes() -> None:
    text = front.top_level_help()
    assert "4 defect in plumb" in text and "143 terminated" in text and "--debug" in text


def test_sigterm_is_an_interrupt_to_whoever_cleans_up() -> None:
    from plumb.process_signals import Terminated, raise_ending

    assert issubclass(Terminated, KeyboardInterrupt)
    with pytest.raises(Terminated):
        raise_ending([signal.SIGTERM, signal.SIGINT])
    with pytest.raises(KeyboardInterrupt) as interrupted:
        raise_ending([signal.SIGINT])
    assert interrupted.type is KeyboardInterrupt
