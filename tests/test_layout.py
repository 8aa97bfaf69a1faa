"""Where tests lie: a floor of host/plumb each, what they share in tests/support, and none imports another."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
FLOORS = {path.name for path in (TESTS.parent / "host" / "plumb").iterdir() if (path / "__init__.py").exists()}
OTHERS = {"support", "c", "defects", "fuzz", "library", "vectors", "second_chip", "toy_systems", "guest_systems"}
"""What tests share, the tests in C, declared defects of the firmware, the tests of the C library as it is installed,
the fuzz targets, the golden vectors, the chip model that is written a second time,
and a system that is added from outside."""


def python_files() -> list[str]:
    return sorted(path.relative_to(TESTS).as_posix() for path in TESTS.rglob("*.py"))


def imported_by(file: str) -> set[str]:
    """Dotted names that a file imports, and each name it takes from them."""
    found = set()
    for node in ast.walk(ast.parse((TESTS / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module or ''}.{alias.name}" for alias in node.names}
    return found


def test_every_folder_is_a_floor_or_has_a_purpose_of_its_own() -> None:
    folders = {path.name for path in TESTS.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders - FLOORS == OTHERS


@pytest.mark.parametrize("file", python_files())
def test_no_test_imports_another(file: str) -> None:
    parts = {part for name in imported_by(file) for part in name.split(".")}
    assert not {part for part in parts if part.startswith("test_")}


@pytest.mark.parametrize("file", [file for file in python_files() if file.startswith("support/")])
def test_support_has_no_tests_of_its_own(file: str) -> None:
    assert "def test_" not in (TESTS / file).read_text(encoding="utf-8")
