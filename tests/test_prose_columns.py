"""tools/wrap_prose.py breaks prose and nothing else."""

from __future__ import annotations

import importlib.util
import textwrap
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
LONG = "word " * 40 + "end"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wrap_prose", ROOT / "tools/wrap_prose.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def widest(text: str) -> int:
    return max(map(len, text.split("\n")))


@pytest.mark.parametrize("first", ["", "- ", "1. ", "    - "])
def test_long_prose_is_broken_and_keeps_its_indent(tool: ModuleType, first: str) -> None:
    before = "- item\n\n" if first.startswith(" ") else ""
    found = tool.wrapped(f"{before}{first}{LONG}\n")
    assert widest(found) <= 120 and found.split() == f"{before}{first}{LONG}".split()
    *_, line, last, _ = found.split("\n")
    assert line.startswith(first + "word") and last.startswith(" " * len(first) + "word")
    assert tool.wrapped(found) == found and tool.too_long(found) == []


@pytest.mark.parametrize(
    "text",
    [
        f"| {LONG} |", f"# {LONG}", f"```\n{LONG}\n```", f"text\n\n    {LONG}", f"<!-- {LONG} -->", f"> {LONG}",
        f"---\ntitle: {LONG}\n---", f"one\\\n{LONG}", f"`{LONG}`", f"[a]({LONG.replace(' ', '_')})",
        f"- item\n\n<!-- mark -->\n\n    {LONG}",
    ],
)  # fmt: skip
def test_what_is_no_prose_stays(tool: ModuleType, text: str) -> None:
    assert tool.wrapped(text) == text and tool.too_long(text) == []


def test_no_line_begins_with_what_markdown_takes_for_markup(tool: ModuleType) -> None:
    for at in range(108, 122):
        found = tool.wrapped("x" * at + " - 1. # > " + LONG)
        assert not any(line.startswith(("- ", "1. ", "# ", "> ")) for line in found.split("\n")), at


def test_paragraphs_that_fit_stay_as_they_were_broken(tool: ModuleType) -> None:
    text = textwrap.dedent("""\
        a short line
        and another

        - an item
          that goes on
        """)
    assert tool.wrapped(text) == text


def test_a_long_line_is_named_by_its_number(tool: ModuleType) -> None:
    assert tool.too_long(f"fits\n\n- one\n- {LONG}\n") == [4]
