"""Every mechanism has a row or a test that goes red when the mechanism is broken (tests/defects, `support.defects`)."""

from __future__ import annotations

import os
import random
import re
import shutil
from collections.abc import Iterator

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.proof.faults import table
from plumb.proof.faults.limits import seen_red
from support.defect_tree import Tree, judged
from support.defects import ROOT, Defect, declared, equivalents, replaced

SAMPLE_SEED, SAMPLE = 1, 1
"""`make test` builds so many defects, each caught by a single row: the way from a defect to its verdict is one."""
FEATURES = frozenset({"analog", "chips", "bridge", "esc"})
"""Of a system, by its sensors and by what it drives: the difference between two rows of one name."""
NO_TOOLS = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or shutil.which("ninja") is None, reason="no compiler of the flash image"
)


def sample() -> list[Defect]:
    quick = [defect for defect in declared() if len(defect.rows) == 1 and not defect.tests]
    return random.Random(SAMPLE_SEED).sample(quick, SAMPLE)


@pytest.fixture(scope="module")
def tree() -> Iterator[Tree]:
    """A copy for each process that runs tests."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "alone")
    with Tree.opened(ROOT / "build" / "defects" / worker) as tree:
        yield tree


@pytest.mark.parametrize("defect", declared(), ids=lambda defect: defect.name)
def test_a_declared_defect_is_of_the_present_source_and_rows(defect: Defect) -> None:
    """A defect whose line was changed is stale: write it anew, for the line that has the mechanism now."""
    text = (ROOT / defect.source).read_text(encoding="utf-8")
    assert defect.applied(text) != text
    assert defect.caught_by
    faults = {fault.name for fault in table.FAULTS}
    assert {row.partition("@")[0] for row in defect.rows} <= faults
    for test in defect.tests:
        path, _, name = test.partition("::")
        assert (ROOT / path).is_file(), test
        function = name.partition("[")[0].rpartition("::")[2]  # none: the whole file
        assert not function or f"def {function}(" in (ROOT / path).read_text(encoding="utf-8"), test


def row_keys() -> list[str]:
    """Every row by name; by ROW@FEATURE where another one of the name comes before it, which lacks the feature."""
    first: dict[str, frozenset[str]] = {}
    keys = []
    for fault in table.FAULTS:
        own = fault.needs - first.get(fault.name, fault.needs)
        keys.append(f"{fault.name}@{min(own & FEATURES)}" if own else fault.name)
        first.setdefault(fault.name, fault.needs)
    return keys


def test_every_row_names_a_declared_defect_that_turns_it_red() -> None:
    """A new row has a defect: write the one-line change of the firmware that it is there for into tests/defects, see it
    red with tools/try_defects.py, and name it in limits.toml."""
    named, rows = seen_red(), {defect.name: defect.rows for defect in declared()}
    assert list(named) == row_keys()
    wrong = {row: name for row, name in named.items() if row not in rows.get(name, ())}
    assert wrong == {}, "these defects do not name these rows in caught_by"


def test_defects_have_names_of_their_own_and_equivalents_a_reason() -> None:
    names = [defect.name for defect in declared()]
    assert len(set(names)) == len(names)
    for one in equivalents():
        text = (ROOT / one.source).read_text(encoding="utf-8")
        assert replaced(text, one.line, one.becomes, one.after, one.source) != text
        assert one.line != one.becomes and len(one.reason) > 20, one.line


def test_rows_that_security_md_says_were_seen_to_fail_have_a_declared_defect() -> None:
    text = (ROOT / "docs/explanation/security.md").read_text("utf-8")
    promises = re.findall(r"(?m)^\d+\. \*\*.*(?:\n(?!\d+\. |\n).*)*", text)
    noticed = {name.rpartition("::")[2].partition("@")[0] for defect in declared() for name in defect.caught_by}
    seen = [set(re.findall(r"`([^`]+)`", promise.partition("Seen to fail")[2])) for promise in promises]
    assert sum(len(names) >= 3 for names in seen) >= 8
    for promise, names in zip(promises, seen, strict=True):
        assert names <= noticed, f"{promise}\nno declared defect turned {sorted(names - noticed)} red"


def test_every_row_and_test_that_security_md_names_exists() -> None:
    text = (ROOT / "docs/explanation/security.md").read_text("utf-8")
    promises = text.partition("\n1. **")[2]
    parts = re.findall(r"(?:Held by|Seen to fail:)((?:.|\n)*?)(?=Seen to fail|\n\d+\. \*\*|\n\n)", promises)
    named = {name for part in parts for name in re.findall(r"`([^`]+)`", part)}
    tests = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"(?m)^def (test_\w+)\(", path.read_text("utf-8"))
    }
    assert len(named) > 60 and sum(name in tests for name in named) >= 8
    assert named - tests - {fault.name for fault in table.FAULTS} == set()


@NO_TOOLS
@pytest.mark.slow
def test_a_sample_of_the_defects_is_noticed(tree: Tree) -> None:
    """One test, so that one process builds the healthy image for all of them."""
    for defect in sample():
        verdicts, wrong = judged(tree, defect)
        assert wrong == [] and all(said.red and said.image for said in verdicts), defect.name


@NO_TOOLS
@pytest.mark.long
@pytest.mark.parametrize("defect", declared(), ids=lambda defect: defect.name)
def test_every_declared_defect_is_noticed(tree: Tree, defect: Defect) -> None:
    verdicts, wrong = judged(tree, defect)
    assert wrong == [] and all(said.red and said.image for said in verdicts)
