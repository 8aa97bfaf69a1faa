"""What the documents tell a reader to type is understood, and what they point at is there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from plumb import systems
from plumb.cli import verbs
from plumb.spec import parameters

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands(page: Path) -> list[str]:
    """Indented lines that call plumb, without their comments; what only sketches a command has dots in it."""
    found = re.findall(r"^(?: {4,})plumb ([^#\n]*)", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [line.removesuffix("&").strip().rstrip("&").strip() for line in found if "..." not in line]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_that_is_told_can_be_typed(page: Path) -> None:
    for line in commands(page):
        name, *rest = shlex.split(line)
        verbs.command_parser(name).parse_args(rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        assert "://" in target or (page.parent / target).exists(), target


def test_parameters_that_the_guide_sets_exist_and_take_the_value() -> None:
    rows = {row.name: row for row in parameters.table()}
    text = (ROOT / "docs/tutorials/bring-up.md").read_text(encoding="utf-8")
    assignments = [
        part for line in re.findall(r"plumb params set ([^\n]*)", text) for part in line.split() if "=" in part
    ]
    assert assignments
    for part in assignments:
        name, value = part.split("=")
        assert rows[name].min <= int(value) <= rows[name].max
    for name in re.findall(r"\b((?:esc\.\w+|arm_hold_ms|esc_period_us))\b", text):
        assert name in rows, name


def figures(page: Path) -> set[tuple[str, ...]]:
    """The rows of a page's tables of figures, cell by cell."""
    rows = (re.split(r" {2,}", line.strip()) for line in page.read_text(encoding="utf-8").splitlines())
    return {tuple(row) for row in rows if len(row) > 4 and re.search(r"\d\.\d{3}\b", " ".join(row))}


def test_readme_and_the_systems_pages_tell_the_same_figures() -> None:
    """Each figure that README shows is on the page of a system: one command, one time it was run."""
    short = figures(ROOT / "README.md")
    pages = set().union(*(figures(ROOT / f"docs/systems/{name}.md") for name in systems.SYSTEMS))
    assert sorted(short - pages) == []
