"""Questions to the user: asked on the terminal, or answered from a file for machines and tests."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from plumb.errors import UsageError, VerdictError
from plumb.files import toml_text

MOST_BYTES = 1 << 16
MOST_REFUSALS = 3
"""Readings that may be refused in a row where nobody can act on the reason."""


class Questions(Protocol):
    """wait: until this is done. begin: until somebody is ready to do this. refused: a reading was not taken, for this
    reason."""

    def choose(self, key: str, text: str, choices: Sequence[str], default: str) -> str: ...
    def agree(self, key: str, text: str, default: bool) -> bool: ...
    def wait(self, text: str) -> None: ...
    def begin(self, text: str) -> None: ...
    def refused(self, reason: str) -> None: ...


class Terminal:
    """Asks on the terminal, on stderr: stdout is for results."""

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise UsageError("nobody is there to answer: run it on a terminal, or give the answers with --answers FILE")

    def choose(self, key: str, text: str, choices: Sequence[str], default: str) -> str:
        """One of the choices, or another text where a choice ends with `...`; Enter takes the default."""
        free = any(choice.endswith("...") for choice in choices)
        while True:
            said = self._ask(f"{text} ({', '.join(choices)}) [{default}] ") or default
            if free or said in choices:
                return said
            self._print(f"  '{said}' is none of these")

    def agree(self, key: str, text: str, default: bool) -> bool:
        while True:
            said = self._ask(f"{text} [{'Y/n' if default else 'y/N'}] ").lower()
            if said in ("", "y", "yes", "n", "no"):
                return default if not said else said[0] == "y"
            self._print("  y or n")

    def wait(self, text: str) -> None:
        self._ask(f"{text}; then press Enter ")

    def begin(self, text: str) -> None:
        self._ask(f"press Enter, then {text} ")

    def refused(self, reason: str) -> None:
        self._print(f"  not taken: {reason}")

    def _ask(self, text: str) -> str:
        self._print(text, end="")
        try:
            return input().strip()
        except EOFError:
            raise KeyboardInterrupt from None

    @staticmethod
    def _print(text: str, end: str = "\n") -> None:
        print(text, end=end, file=sys.stderr, flush=True)


class Answers:
    """Answers from a TOML file: `key = "text"` for a choice, `key = true` or `false` for a question. Every question
    needs its answer; what only waits is not asked."""

    def __init__(self, path: Path) -> None:
        from plumb.files.input_files import read_text

        self._path = path
        self._refusals = 0
        try:
            self._said = toml_text.parse(read_text(path, MOST_BYTES, "give a TOML file of answers"))
        except ValueError as error:
            raise UsageError(f"{path} is no TOML ({error}): write one answer a line, as in write = true") from None

    def choose(self, key: str, text: str, choices: Sequence[str], default: str) -> str:
        said = self._answer(key, text)
        free = any(choice.endswith("...") for choice in choices)
        if not isinstance(said, str) or not (free or said in choices):
            raise UsageError(f"{self._path}: {key} = {said!r} is none of {', '.join(choices)}")
        return said

    def agree(self, key: str, text: str, default: bool) -> bool:
        said = self._answer(key, text)
        if not isinstance(said, bool):
            raise UsageError(f"{self._path}: {key} = {said!r}: write true or false")
        return said

    def wait(self, text: str) -> None:
        return None

    def begin(self, text: str) -> None:
        return None

    def refused(self, reason: str) -> None:
        self._refusals += 1
        if self._refusals >= MOST_REFUSALS:
            raise VerdictError(f"{reason} (refused {MOST_REFUSALS} times, and nobody is there to act)")

    def _answer(self, key: str, text: str) -> object:
        if key not in self._said:
            raise UsageError(f"{self._path} does not answer '{key}' ({text.strip()}): add {key} = ...")
        return self._said[key]


def questions(answers: Path | None) -> Questions:
    return Terminal() if answers is None else Answers(answers)
