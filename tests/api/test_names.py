"""The public names of `plumb`: loaded when they are used first, and as they are documented."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import plumb

LISTED = "import sys; before = set(sys.modules); import plumb; print(*sorted(set(sys.modules) - before))"


def test_import_plumb_loads_no_other_module_of_the_package() -> None:
    loaded = subprocess.run([sys.executable, "-c", LISTED], capture_output=True, text=True, check=True).stdout.split()
    assert [name for name in loaded if name.split(".")[0] in ("plumb", "numpy", "can", "cantools", "serial")] == [
        "plumb"
    ]


@pytest.mark.parametrize("name", plumb.__all__)
def test_a_public_name_is_there_and_documented(name: str) -> None:
    found = getattr(plumb, name)
    assert found.__doc__ and name in dir(plumb)


def test_submodules_are_found_as_well_as_the_names() -> None:
    assert importlib.import_module("plumb.api.golden") is plumb.golden
    with pytest.raises(AttributeError, match="'plumb' has no attribute 'estimator'"):
        _ = plumb.estimator  # type: ignore[attr-defined]
