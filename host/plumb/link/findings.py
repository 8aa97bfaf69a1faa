"""Finding of an examination: good or not, and the command that mends it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One line of `plumb doctor`. needed: plumb cannot do its work where this is not good. mend: a command, or an
    action, that mends it; "" where nothing is to be done or the detail says it."""

    what: str
    good: bool
    needed: bool
    detail: str
    mend: str = ""
