"""The page of golden vectors in a user's CI is followed from an empty folder, and its files are the examples.

Of its fenced blocks, `sh` is run, a block with a title is written to the file of that name, and `text` is what the `sh`
before it prints.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from plumb.boards import program
from plumb.cli import verbs
from support.wheel import NEEDS_IMAGE, users_environment

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/tutorials/golden-vectors-in-your-ci.md"


class Block(NamedTuple):
    """One fenced block. file: its title, where it has one."""

    kind: str
    file: str
    text: str


def blocks() -> list[Block]:
    found = re.findall(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', PAGE.read_text(), re.MULTILINE | re.DOTALL)
    return [Block(*one) for one in found]


@pytest.mark.slow
@NEEDS_IMAGE
def test_the_steps_can_be_followed_from_an_empty_folder(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """With the wheel: pytest finds the plugin by its entry point."""
    scripts = users_environment(tmp_path_factory) / "bin"
    environment = {"PATH": f"{scripts}{os.pathsep}{os.defpath}", "HOME": str(tmp_path)}
    said, ran, compared = "", 0, 0
    for block in blocks():
        if block.file:
            (tmp_path / block.file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / block.file).write_text(block.text)
        elif block.kind == "sh":
            done = subprocess.run(
                ["sh", "-e", "-c", block.text],
                cwd=tmp_path,
                env=environment,
                capture_output=True,
                text=True,
                timeout=240,
            )
            assert done.returncode == 0, block.text + done.stdout + done.stderr
            said, ran = done.stdout, ran + 1
        elif block.kind == "text":
            assert said == block.text
            compared += 1
    assert ran >= 7 and compared >= 4
    assert "raw_1" in (tmp_path / "golden.html").read_text() and "<failure" in (tmp_path / "golden.xml").read_text()


def test_the_files_of_the_page_are_the_examples() -> None:
    files = {block.file: block.text for block in blocks() if block.file}
    assert files["library.py"] == (ROOT / "examples/golden/library.py").read_text()
    assert files[".github/workflows/golden.yml"] == (ROOT / "examples/ci/golden.yml").read_text()


def test_every_plumb_command_of_the_workflow_can_be_typed() -> None:
    lines = re.findall(r"run: plumb (.*)", (ROOT / "examples/ci/golden.yml").read_text())
    assert len(lines) >= 2
    for line in lines:
        name, *rest = shlex.split(line)
        verbs.command_parser(name).parse_args(rest)


def test_the_page_names_every_line_of_the_protocol() -> None:
    """As the module that speaks it does."""
    text = PAGE.read_text()
    keys = re.findall(r"^    ([a-z][\w-]*) ", program.__doc__ or "", re.MULTILINE)
    assert len(set(keys)) >= 8
    for key in keys:
        assert f"`{key} " in text, key
