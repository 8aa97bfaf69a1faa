"""`make test-changed` runs the floor of a change and the floors above it."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).resolve().parents[1] / "tools"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    sys.path.insert(0, str(TOOLS))
    try:
        import changed_tests  # type: ignore[import-not-found]
    finally:
        sys.path.remove(str(TOOLS))
    module: ModuleType = changed_tests
    return module


def folders(tool: ModuleType, *paths: str) -> set[str]:
    return {path for path in tool.wanted(set(paths), tool.floors()) if not path.endswith(".py")}


def test_a_change_runs_its_floor_and_those_above(tool: ModuleType) -> None:
    found = folders(tool, "host/plumb/boards/native/board.py")
    assert {"tests/boards", "tests/proof", "tests/cli"} <= found
    assert not {"tests/link", "tests/kernels", "tests/spec"} & found


def test_a_module_that_is_a_floor_counts_as_one(tool: ModuleType) -> None:
    assert folders(tool, "host/plumb/errors.py") >= {"tests/files", "tests/spec"}


def test_a_change_of_the_firmware_runs_from_the_kernels_on(tool: ModuleType) -> None:
    found = folders(tool, "firmware/core/pid.c")
    assert "tests/kernels" in found and "tests/spec" not in found


def test_a_changed_test_runs_with_its_folder_alone(tool: ModuleType) -> None:
    assert folders(tool, "tests/kernels/test_pid.py") == {"tests/kernels"}


def test_shared_code_of_the_tests_runs_them_all(tool: ModuleType) -> None:
    assert {"tests/files", "tests/cli"} <= folders(tool, "tests/support/native_board.py")


def test_a_change_of_a_page_runs_the_tests_outside_the_floors(tool: ModuleType) -> None:
    found = tool.wanted({"docs/index.md"}, tool.floors())
    assert found and all(path.startswith("tests/test_") for path in found)
    assert tool.wanted(set(), tool.floors()) == []
