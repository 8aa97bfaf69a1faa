"""The `plumb` command: find the command's module, import only that, run it, and convert errors to exit codes.

Exit codes: 0 good, 1 the verdict is bad, 2 wrong use or a bad input file or a missing tool, 3 device or link trouble
(or a verdict that could not be verified), 4 a defect in plumb, 130 interrupted, 141 the output's reader left before the
verdict, 143 terminated. `plumb.errors.ExitCode` names them.

Only modules that Python has loaded anyway are imported here: until `entry` has set its handlers, Ctrl-C is a traceback.
"""

from __future__ import annotations

import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def top_level_help() -> str:
    from plumb.cli.verbs import commands
    from plumb.spec import declarations

    known = commands()
    width = max(map(len, known))
    lines = [
        "usage: plumb COMMAND [options]      options of a command: plumb COMMAND --help",
        "",
        "Attitude estimation and control in integers for the STM32F103,",
        "and the proof that board and model agree to the bit.",
        "",
        "commands:",
        *(f"  {name:<{width}}  {text}" for name, text in known.items()),
        "",
        "systems:  " + " | ".join(declarations.names()),
        "boards:   native | qemu | virtual | serial:PORT[@BAUD] | can:INTERFACE:CHANNEL[@KBIT] | auto",
        "exit:     0 good, 1 bad verdict, 2 wrong use, bad file or missing tool, 3 link trouble, 4 defect in plumb,",
        "          130 interrupted, 141 output not read, 143 terminated; --debug shows the traceback of an error",
    ]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code. Every error comes out as one sentence on stderr."""
    from plumb import process_signals
    from plumb.cli.command_line import shown
    from plumb.errors import ExitCode, sentence_and_code

    arguments = list(sys.argv[1:] if argv is None else argv)
    process_signals.raised.clear()
    try:
        return _run([argument for argument in arguments if argument != "--debug"])
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, BrokenPipeError) and (not _flush_stdout() or _reader_left()):
            return ExitCode.OUTPUT_NOT_READ  # for example `plumb monitor | head`
        if "--debug" in arguments:
            import traceback

            _say("".join(traceback.format_exception(error)).rstrip())
        sentence, code = sentence_and_code(process_signals.raised[0] if process_signals.raised else error)
        _say(f"plumb: {shown(sentence)}")
        return code


def _run(arguments: list[str]) -> int:
    import shlex

    from plumb.errors import ExitCode

    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(top_level_help())
        return ExitCode.GOOD if arguments else ExitCode.WRONG_USE
    name, rest = arguments[0], arguments[1:]
    if name in ("-V", "--version"):
        from plumb.version import installed

        commit = installed().commit
        print(f"plumb {installed().version}" + f" ({commit})" * bool(commit))
        return 0
    from plumb.cli.command_line import check_arguments, check_numbers
    from plumb.cli.options import check_typed, settle_board
    from plumb.cli.verbs import command_module, command_parser

    module = command_module(name)
    check_arguments(rest)
    parsed = command_parser(name).parse_args(rest)
    check_numbers(vars(parsed))
    parsed.command_line = shlex.join(["plumb", *arguments])
    check_typed(parsed)
    if hasattr(module, "check"):
        module.check(parsed)
    settle_board(parsed)
    return int(module.main(parsed))


def _say(text: str) -> None:
    """To stderr, as far as it takes it: the exit code matters more."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _to_nowhere(2)


def _flush_stdout() -> bool:
    """Whether stdout takes what is left. If not, the rest goes nowhere, or Python would trip over it at exit."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _to_nowhere(1)
        return False
    return True


def _reader_left() -> bool:
    """Whether stdout is a pipe that nobody reads. A write that failed may have left nothing to flush."""
    import select

    if not hasattr(select, "poll"):  # Windows: the pipe that broke is taken for this one
        _to_nowhere(1)
        return True
    poll = select.poll()
    poll.register(1, 0)
    left = any(event & select.POLLERR for _, event in poll.poll(0))
    if left:
        _to_nowhere(1)
    return left


def _to_nowhere(descriptor: int) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


def _quit_at_once(_number: int, _frame: object) -> None:
    """Ctrl-C before the command begins: nothing is open yet, and an exception would come out as a traceback."""
    os.write(2, b"plumb: interrupted.\n")
    os._exit(130)


def _open_closed_streams() -> None:
    """Open the null device for each stream that the caller closed (`plumb ... >&-`): else the next file or port that is
    opened gets the descriptor, and with it what is printed."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):  # the lowest free descriptor is the next's
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, mode))


def entry() -> None:
    """The program: signals, `main`, and what the output's reader has not taken yet."""
    _open_closed_streams()
    takes_interrupts = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not in the background of a shell
    if takes_interrupts:
        signal.signal(signal.SIGINT, _quit_at_once)
    import contextlib

    from plumb.cli.python_can import load_without_mf4
    from plumb.process_signals import raise_at_once

    load_without_mf4()
    with contextlib.suppress(AttributeError):  # a file's name need not be text
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    code = 130
    try:
        if takes_interrupts:
            signal.signal(signal.SIGINT, raise_at_once)
        signal.signal(signal.SIGTERM, raise_at_once)
        code = main()
    except KeyboardInterrupt:  # between two lines of ours
        _say("plumb: interrupted.")
    except SystemExit as end:  # argparse: help, or wrong use
        code = end.code if isinstance(end.code, int) else 2
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if takes_interrupts:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        _flush_stdout()
    except OSError as error:
        _say(f"plumb: the output cannot be written: {error.strerror}; choose another place for it")
        _to_nowhere(1)
        code = code or 2
    sys.exit(code)


if __name__ == "__main__":
    entry()
