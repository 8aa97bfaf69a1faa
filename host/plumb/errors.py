"""Exit codes, errors that a user can act on, one sentence each with its exit code, and counts in sentences."""

from __future__ import annotations

import errno
from enum import IntEnum

from plumb.process_signals import Terminated


class ExitCode(IntEnum):
    """Exit codes of every command."""

    GOOD = 0
    BAD_VERDICT = 1
    """A mismatch, or a limit exceeded."""
    WRONG_USE = 2
    """Wrong use, a bad input file or a missing tool."""
    LINK_TROUBLE = 3
    """Device or link trouble, or a verdict that could not be verified."""
    DEFECT = 4
    """A defect in plumb."""
    INTERRUPTED = 130
    """SIGINT."""
    OUTPUT_NOT_READ = 141
    """The reader of stdout closed it before the verdict."""
    TERMINATED = 143
    """SIGTERM."""


def exit_code_of(verdict: str) -> ExitCode:
    """Exit code of a command that ends with a verdict: pass, fail or unverified."""
    codes = {"pass": ExitCode.GOOD, "fail": ExitCode.BAD_VERDICT, "unverified": ExitCode.LINK_TROUBLE}
    return codes[verdict]


class PlumbError(Exception):
    """An error that the user can correct; the message is one sentence that says how."""

    exit_code = ExitCode.WRONG_USE


class VerdictError(PlumbError):
    """The command did its work and the verdict is bad: a mismatch, or a limit exceeded."""

    exit_code = ExitCode.BAD_VERDICT


class UsageError(PlumbError):
    """Wrong use, a bad input file, an impossible parameter, or a missing tool."""

    exit_code = ExitCode.WRONG_USE

    def saying(self, message: str) -> UsageError:
        """The same error in other words."""
        return UsageError(message)


class SettingError(UsageError):
    """A setting of a tuning that has no integer, or that other settings do not allow.

    setting: as the message names it; asked: its value; least, most: it may be so much while the others stay as they
    are, infinite where it has no limit (0 stands for "above 0", 360 deg/s for "below 360 deg/s").
    """

    def __init__(self, message: str, setting: str, asked: float, least: float, most: float) -> None:
        super().__init__(message)
        self.setting, self.asked, self.least, self.most = setting, asked, least, most

    def __reduce__(self) -> tuple[type[SettingError], tuple[str, str, float, float, float]]:
        """A worker process can hand it over."""
        return SettingError, (str(self), self.setting, self.asked, self.least, self.most)

    def saying(self, message: str) -> SettingError:
        return SettingError(message, self.setting, self.asked, self.least, self.most)


class LinkError(PlumbError):
    """Device or link trouble: no port, no answer, a connection that closed, a version that differs."""

    exit_code = ExitCode.LINK_TROUBLE


class UnverifiedError(PlumbError):
    """Nothing could be verified: neither pass nor fail."""

    exit_code = ExitCode.LINK_TROUBLE


class RecordingWarning(UserWarning):
    """Python warning: what an audit is sure is wrong with a recording or with arrays of sensors; they are used as they
    are."""


NO_DEFECT = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM)
"""Errors of the machine, not of plumb, wherever they are raised."""


def sentence_and_code(error: BaseException) -> tuple[str, int]:
    """The sentence and the exit code of an exception that ends a command. An unforeseen exception is WRONG_USE when the
    machine lacks something, else DEFECT."""
    if isinstance(error, PlumbError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        terminated = isinstance(error, Terminated)
        return ("terminated.", ExitCode.TERMINATED) if terminated else ("interrupted.", ExitCode.INTERRUPTED)
    if isinstance(error, MemoryError):
        sentence = "this machine has too little memory for that: ask for fewer steps, or give a smaller file"
        return sentence, ExitCode.WRONG_USE
    if isinstance(error, OSError) and (error.filename is not None or error.errno in NO_DEFECT):
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{error.strerror}; put that right and run it again", ExitCode.WRONG_USE
    if isinstance(error, ModuleNotFoundError) and error.name and not error.name.startswith("plumb"):
        missing = f"the Python module '{error.name}' is not installed"
        return f"{missing}: run tools/setup.sh in a checkout of plumb", ExitCode.WRONG_USE
    said = str(error).strip().partition("\n")[0]
    what = f"{type(error).__name__}: {said}" if said else type(error).__name__
    sentence = f"this is a defect in plumb ({what}): run it again with --debug, and report what that shows"
    return sentence, ExitCode.DEFECT


def counted(number: int, what: str, many: str = "") -> str:
    """The number, with commas from 1,000 on, and the noun in its number: "1 flight", "2 flights". many: the plural of a
    noun that does not take an s."""
    return f"{number:,} {what if number == 1 else many or what + 's'}"
