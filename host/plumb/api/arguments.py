"""Arguments of the public functions, checked for their types: a wrong one is a sentence, not a traceback of an inner
module."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from pathlib import Path

from plumb.errors import UsageError
from plumb.readers.recording import MOST_STEPS

LINKS = ("serial", "can")


def require_text(**given: object) -> None:
    """Each is a text or None; raises UsageError."""
    for name, value in given.items():
        if value is not None and not isinstance(value, str):
            raise UsageError(f"{name} = {shown(value)}: give a text")


def require_number(**given: object) -> None:
    """Each is a real number or None; raises UsageError."""
    for name, value in given.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, numbers.Real)):
            raise UsageError(f"{name} = {shown(value)}: give a number")


def require_whole(**given: object) -> None:
    """Each is a whole number; raises UsageError."""
    for name, value in given.items():
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise UsageError(f"{name} = {shown(value)}: give a whole number")


def require_names(**given: object) -> None:
    """Each is a list of texts or None; raises UsageError."""
    for name, value in given.items():
        if value is None:
            continue
        if isinstance(value, str) or not isinstance(value, Sequence | frozenset | set):
            raise UsageError(f"{name} = {shown(value)}: give a list of texts")
        require_text(**{f"{name}[{place}]": one for place, one in enumerate(value)})


def require_mapping(**given: object) -> None:
    """Each is a mapping from names or None; raises UsageError."""
    for name, value in given.items():
        if value is not None and not (isinstance(value, Mapping) and all(isinstance(key, str) for key in value)):
            raise UsageError(f"{name} = {shown(value)}: give a dictionary by name")


def path_of(name: str, value: object) -> Path:
    """A path; raises UsageError for what is none."""
    if not isinstance(value, str | Path) or "\0" in str(value):
        raise UsageError(f"{name} = {shown(value)}: give the path of a file")
    return Path(value)


def optional_path_of(name: str, value: object) -> Path | None:
    """A path, or None as it is; raises UsageError for what is neither."""
    return None if value is None else path_of(name, value)


def require_link(link: object) -> None:
    """Raises UsageError for a link that there is not."""
    if link not in LINKS:
        raise UsageError(f"link = {shown(link)}: it is serial or can")


def require_steps(name: str, steps: int) -> None:
    """Raises UsageError for more steps than a run may have."""
    if steps > MOST_STEPS:
        raise UsageError(f"{name} has {steps} samples: a run has at most {MOST_STEPS}")


def shown(value: object) -> str:
    """The beginning of what was given, on one line."""
    return " ".join(repr(value).split())[:40]
