"""The flash image of a test, which is skipped where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.flash.image import find_image


def image_path() -> Path:
    try:
        return find_image()
    except UsageError as error:
        pytest.skip(str(error))
