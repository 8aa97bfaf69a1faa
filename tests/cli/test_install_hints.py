"""The distribution is `plumb-imu`. On PyPI `plumb` is another project, so no text may name it for installation."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from plumb.extras import install_hint

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FOREIGN = re.compile(r"plumb\[[a-z]|pip3? install [^\n]*\bplumb\b(?!-imu)")
"""An extra of, or an installation of, the distribution that is not ours."""


def tracked_texts() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    kinds = {".py", ".md", ".toml", ".sh", ".txt", ".c", ".h", ".yml", ".yaml", ".json", ""}
    paths = [ROOT / name for name in listed.split("\0") if name and Path(name).suffix in kinds]
    return [path for path in paths if path != Path(__file__) and path.is_file()]


def test_the_distribution_has_a_name_of_its_own() -> None:
    assert PROJECT["name"] == "plumb-imu"
    assert PROJECT["scripts"] == {"plumb": "plumb.__main__:entry"}
    extras = PROJECT["optional-dependencies"].values()
    assert not [entry for extra in extras for entry in extra if FOREIGN.search(entry)]


@pytest.mark.parametrize(
    "text", ["pip install 'plumb[flash]'", "pip install plumb", "the extra plumb[virtual]", "pip3 install -U plumb"]
)
def test_the_pattern_recognises_the_wrong_name(text: str) -> None:
    assert FOREIGN.search(text)


@pytest.mark.parametrize("text", ["pip install .", "pip install -e '.[flash]'", "pip install plumb-imu", "plumb[0]"])
def test_the_pattern_lets_the_right_ones_by(text: str) -> None:
    assert not FOREIGN.search(text)


def test_no_text_says_to_install_the_name_of_a_stranger() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in tracked_texts()
        for line in path.read_text(errors="replace").splitlines()
        if FOREIGN.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("extra", ["virtual", "bench", "report", "flash", "monitor", "compare", "mavlink"])
def test_a_hint_names_an_extra_that_exists(extra: str) -> None:
    assert extra in PROJECT["optional-dependencies"]
    assert f"'.[{extra}]'" in install_hint(extra)
