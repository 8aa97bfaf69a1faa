"""The errors a person can act on: one sentence each, and the exit code that goes with it."""

from __future__ import annotations

import errno

from plumb.process_signals import Terminated


class PlumbError(Exception):
    """Something the user can put right; the message is one sentence that says how."""

    exit_code = 2


class VerdictError(PlumbError):
    """The work was done and the answer is bad: a mismatch, or a limit exceeded."""

    exit_code = 1


class UsageError(PlumbError):
    """Wrong use, a bad input file, a parameter that cannot be, or a missing tool."""

    exit_code = 2


class LinkError(PlumbError):
    """Device or link trouble: no port, no answer, a connection that closed, a version that differs."""

    exit_code = 3


NO_DEFECT = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM)
"""Of the system, wherever they come up."""


def sentence_and_code(error: BaseException) -> tuple[str, int]:
    """What ends a command, as a sentence and an exit code. An exception that no command foresaw: 2 when the machine is
    short of something, else 4, a defect in plumb."""
    if isinstance(error, PlumbError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return ("terminated.", 143) if isinstance(error, Terminated) else ("interrupted.", 130)
    if isinstance(error, MemoryError):
        return "this machine has too little memory for that: ask for fewer steps, or give a smaller file", 2
    if isinstance(error, OSError) and (error.filename is not None or error.errno in NO_DEFECT):
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{error.strerror}; put that right and run it again", 2
    if isinstance(error, ModuleNotFoundError) and error.name and not error.name.startswith("plumb"):
        return f"the Python module '{error.name}' is not installed: run tools/setup.sh in a checkout of plumb", 2
    said = str(error).strip().partition("\n")[0]
    what = f"{type(error).__name__}: {said}" if said else type(error).__name__
    return f"this is a defect in plumb ({what}): run it again with --debug, and report what that shows", 4
