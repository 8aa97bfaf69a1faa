"""Suggest the name that a mistyped one may stand for."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LIKENESS = 0.6
"""Similarity of two names that are taken for the same, as difflib measures it."""
LONGEST = 60
"""Characters of a name that is compared: longer ones are no slip of the finger."""


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """` (did you mean NAME?)` with the nearest of these names; "" where none is near."""
    found = difflib.get_close_matches(name[:LONGEST].lower(), list(names), 1, LIKENESS) if len(name) <= LONGEST else []
    return f" (did you mean {found[0]}?)" if found else ""
