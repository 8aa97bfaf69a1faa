"""Folders of golden vectors, made of the recipe of the test's own module."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.golden_folder import folder_of


@pytest.fixture(scope="module")
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of `RECIPE`, shared by the tests of the module: they only read it."""
    return folder_of(request.module.RECIPE, tmp_path_factory)


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of it that the test may damage."""
    return Path(shutil.copytree(made, tmp_path / "vectors"))
