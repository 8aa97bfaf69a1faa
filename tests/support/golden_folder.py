"""A folder of golden vectors that a test makes of its own recipe."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb.proof import golden, golden_recipe


def folder_of(recipe: str, factory: pytest.TempPathFactory) -> Path:
    folder = factory.mktemp("vectors")
    (folder / golden_recipe.RECIPE).write_text(recipe)
    golden.make(folder)
    return folder
