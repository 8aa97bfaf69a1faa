"""Workflow commands of GitHub Actions: an annotation for every vector that a board does not pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from plumb.proof.golden_file import SUFFIX
from plumb.proof.golden_result import Result


def workflow_commands(results: Mapping[str, Result], errors: Mapping[str, str], folder: Path) -> Iterator[str]:
    """A line each, also for a board whose check ended early. folder: of the vectors, named relative to the working
    directory where it lies in it, so that GitHub finds the file."""
    for board, result in results.items():
        for row in result.rows:
            if row.verdict != "pass":
                file = _relative(folder / (row.vector + SUFFIX))
                title = f"golden vector {row.vector} on {board}"
                yield f"::error file={_property(file)},title={_property(title)}::{_data(row.describe())}"
    for board, why in errors.items():
        yield f"::error title={_property(f'golden vectors on {board}')}::{_data(why)}"


def _relative(path: Path) -> str:
    whole, here = path.resolve(), Path.cwd().resolve()
    return (whole.relative_to(here) if whole.is_relative_to(here) else whole).as_posix()


def _data(text: str) -> str:
    """Escape the text after `::`: GitHub decodes these three sequences."""
    plain = text.encode("utf-8", "backslashreplace").decode()
    return plain.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
