"""Parse TOML that people edit, bounded in time: tomllib's time grows with the square of the parts of a key, so that a
key of a few hundred kilobytes would take hours."""

from __future__ import annotations

import re
import tomllib
from typing import Any

MOST_KEY_PARTS = 32
"""Parts of a key between dots; plumb's own have four at most."""
_QUOTED = re.compile(r""" "(?:[^"\\\n]|\\.)*+"? | '[^'\n]*+'? | \#[^\n]* """, re.VERBOSE)
"""A string on one line, or a comment. One without an end goes to the line's end: nothing is tried twice."""
_LONG_KEY = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{MOST_KEY_PARTS}}}")


def parse(text: str) -> dict[str, Any]:  # Any: as tomllib has it
    """The tables of a text. Raises ValueError, with the reason on one line, for a text that is no TOML, or more than
    plumb's files need: longer keys, deeper nesting, a string over several lines."""
    if '"""' in text or "'''" in text:
        raise ValueError("it holds three quotes in a row: write a text on one line")
    if _LONG_KEY.search(_QUOTED.sub(_without_dots, text)):
        raise ValueError(f"a key has more than {MOST_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError as error:  # of a number with too many digits, ValueError itself
        raise ValueError(str(error).partition("\n")[0]) from None


def _without_dots(found: re.Match[str]) -> str:
    return "" if found[0].startswith("#") else "q"
