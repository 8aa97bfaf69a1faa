"""Checks of every command line: no empty values, finite numbers; and text made safe to print."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from plumb.errors import UsageError

MOST = 10**18 - 1
"""Largest whole number accepted: results calculated from it fit 64 bits and floating point."""

WORD_ECHO = 80
LONG_WORD = re.compile(r"\S{301,}")
"""A word that `shown` cuts after WORD_ECHO characters; paths are rarely this long."""


def check_arguments(arguments: Sequence[str]) -> None:
    """Raises UsageError for an argument with an empty value; argparse would treat some of them as absent."""
    for argument in arguments:
        name, _, value = argument.partition("=")
        if not argument or (name.startswith("--") and argument != name and value in ("", "--")):
            raise UsageError(f"'{argument}' has no value: write one, or leave it out")


def check_numbers(values: Mapping[str, object]) -> None:
    """Raises UsageError for the first number that is not finite or too large. values: parsed options, by
    destination."""
    for name, value in values.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise UsageError(f"--{name.replace('_', '-')} {value}: give a finite number")
        if isinstance(value, int) and abs(value) > MOST:
            raise UsageError(f"--{name.replace('_', '-')}: give a number of at most 18 digits")


def shown(text: str) -> str:
    """The text on one line: line ends, terminal sequences and invalid bytes as escapes, a very long word cut."""
    text = LONG_WORD.sub(lambda word: f"{word[0][:WORD_ECHO]}...", text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
