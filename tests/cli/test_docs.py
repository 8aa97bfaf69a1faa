"""The commands in the documents parse, and the targets of their links exist."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from plumb import systems
from plumb.cli import verbs
from plumb.spec import declarations
from plumb.systems import shipped_tunings
from plumb.tuning import quantities

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tools"))
import docs_navigation  # type: ignore[import-not-found]  # noqa: E402

DOCS = ROOT / "docs"
COMMANDS = DOCS / "reference/commands"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


def commands(page: Path) -> list[str]:
    """Lines of code that call plumb, without their comments; what only sketches a command has dots in it."""
    text = page.read_text(encoding="utf-8")
    # The examples of the help texts, which stand in the pages of the commands, have a comment without a mark.
    prefix = r"\$ " if page.parent == COMMANDS else r"(?: {4,}|\$ )"
    found = re.findall(rf"^{prefix}plumb ([^#\n]*)", text, re.MULTILINE)
    return [line.removesuffix("&").strip().rstrip("&").strip() for line in found if "..." not in line]


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"(?ms)^```.*?^```", "", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """The names that a link into the page may have: those that mkdocs makes of headings, and `<a id>`."""
    headings = re.findall(r"(?m)^#+ (.*)$", prose(page))
    words = (re.sub(r"[^\w\s-]", "", heading.replace("`", "")).strip().lower() for heading in headings)
    return {re.sub(r"[-\s]+", "-", name) for name in words} | set(re.findall(r'<a id="([\w-]+)"', prose(page)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_documented_command_can_be_typed(page: Path) -> None:
    refused = []
    for line in commands(page):
        name, *rest = shlex.split(line)
        try:
            verbs.command_parser(name).parse_args(rest)
        except SystemExit:
            refused.append(line)
    assert refused == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        to = page.parent / name if name else page
        assert to.exists(), target
        assert not anchor or anchor in anchors(to), target


def test_parameters_that_the_guide_sets_exist_and_take_the_value() -> None:
    tables = {system: shipped_tunings.table_of(system, None) for system in systems.SYSTEMS}
    pages = {page.stem: page.read_text(encoding="utf-8") for page in (DOCS / "tutorials/bring-up").glob("*.md")}
    text = "".join(pages.values())
    lines = [(page, line) for page, whole in pages.items() for line in re.findall(r"plumb params set ([^\n]*)", whole)]
    assert lines
    for page, line in lines:
        table = tables.get(page, tables["quad" if line.startswith("esc") else "balancer"])
        assignments = [part for part in line.split() if "=" in part]
        quantities.changed(table, quantities.assignments(assignments, table))
    names = re.findall(r"\b((?:esc\.\w+|arm_hold_ms|esc_period_us))\b", text)
    assert len(names) > 5
    for name in names:
        quantities.find(name, quantities.quantities_of(tables["quad"]))


def figures(page: Path) -> set[tuple[str, ...]]:
    """The rows of a page's tables of figures, cell by cell."""
    rows = (re.split(r" {2,}", line.strip()) for line in page.read_text(encoding="utf-8").splitlines())
    return {tuple(row) for row in rows if len(row) > 4 and re.search(r"\d\.\d{3}\b", " ".join(row))}


def test_a_figure_is_the_same_on_every_page() -> None:
    """README and the page of all systems show rows of the systems' own pages: one command, one time it was run."""
    short = figures(DOCS / "systems/index.md")
    pages = set().union(*(figures(DOCS / f"systems/{name}.md") for name in systems.SYSTEMS))
    assert sorted(short - pages) == []
    headlines = re.findall(r"(?m)^\| \[`\w+`\].*$", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(headlines) == len(systems.with_part("figures"))
    for row in headlines:
        numbers = re.findall(r"(?<![\d.])-?\d+\.\d{3}\b", row)
        assert any(set(numbers) <= set(found) for found in short), row


def stale(tool: str, *arguments: str) -> str:
    """What a generator says of a page that is not what it would write; "" for one that is."""
    command = [sys.executable, f"tools/{tool}.py", "--check", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr or "the generator failed"


def test_the_page_of_the_commands_has_their_help() -> None:
    assert stale("gen_commands", "--help-only") == ""


@pytest.mark.slow
def test_the_page_of_the_commands_has_what_they_print() -> None:
    assert stale("gen_commands") == ""


def test_the_table_of_formats_has_what_the_readers_declare() -> None:
    assert stale("gen_formats") == ""


def test_the_page_of_the_c_library_has_the_comments_of_its_headers() -> None:
    assert stale("gen_c_reference") == ""


def test_the_sensors_of_the_tutorial_give_what_its_page_shows() -> None:
    text = (DOCS / "tutorials/your-own-sensor.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?ms)^```(?:python|text)[^\n]*\n(.*?)^```", text)
    assert len(blocks) == 4
    for program, printed in zip(blocks[::2], blocks[1::2], strict=True):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        assert done.stdout == printed


def test_every_page_is_in_the_navigation() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    entries = re.findall(r"- (?:[\w ]+: )?([\w/*-]+\.md)(?: #.*)?$", text, re.MULTILINE)
    found = docs_navigation.expanded(entries, DOCS, set(entries))
    assert isinstance(found, list) and len(found) == len(set(found))
    assert set(found) == {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}


def test_the_pages_of_the_systems_stand_in_the_order_of_their_numbers() -> None:
    systems = ["systems/index.md", *(f"systems/{name}.md" for name in declarations.names())]
    assert docs_navigation.expanded(["systems/index.md", "systems/*.md"], DOCS, {"systems/index.md"}) == systems
