"""The errors a person can act on: one sentence each, and the exit code that goes with it."""

from __future__ import annotations


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
