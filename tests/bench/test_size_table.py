"""The size table adds up to the image, names what takes the room, and says what a change made of it."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from plumb.flash.elf import Elf
from support.linked_images import with_flash_limit

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "build/stm32f103/firmware.elf"
TOOL = ROOT / "tools/size_table.py"

needs_image = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")


@pytest.fixture
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("size_table", TOOL)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(TOOL), *arguments], capture_output=True, text=True, check=False)


@needs_image
def test_modules_add_up_to_the_image(tool: ModuleType) -> None:
    sizes = tool.sizes_of(IMAGE)
    modules = sizes["modules"]
    binary = IMAGE.with_suffix(".bin").stat().st_size
    named = sum(module["flash"] for module in modules.values())
    assert sizes["totals"]["flash"] == binary
    assert 0 <= binary - named < 64, "only alignment is nobody's"
    for module in modules.values():
        for kind in ("flash", "ram"):
            assert module[kind] == sum(item[kind] for item in module["items"].values())
    reserved = sizes["totals"]["ram"] - sum(module["ram"] for module in modules.values())
    assert 1024 <= reserved < 1024 + 96  # the stack, its guard, alignment


@needs_image
def test_functions_and_variables_stand_with_the_file_they_are_from(tool: ModuleType) -> None:
    modules = tool.sizes_of(IMAGE)["modules"]
    step = modules["core/systems.c"]["items"]["control_step"]
    assert step["flash"] > 20 and step["deepest"] >= step["stack"]
    assert modules["ports/stm32f103/uart.c"]["items"]["rx_ring"] == {"flash": 0, "ram": 1024}
    assert modules["app/loop.c"]["items"]["loop_turn"]["deepest"] > modules["app/loop.c"]["items"]["loop_turn"]["stack"]
    assert modules["ports/stm32f103/startup.c"]["items"][".vectors"]["flash"] == 4 * 76
    assert {name.split("/")[0] for name in modules} >= {"app", "core", "link", "ports"}


@needs_image
def test_no_tool_of_the_cross_compiler_is_asked(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Symbols, mapping symbols and debug information say it all: no listing for people is read."""
    monkeypatch.setenv("PATH", str(tmp_path))
    modules = tool.sizes_of(IMAGE)["modules"]
    assert modules["core/systems.c"]["items"]["control_step"]["flash"] > 20
    nobodys = modules["(link and port)"]["flash"]
    assert 0 <= nobodys < 100, "alignment alone; functions that the linker made one are counted once"


@needs_image
def test_the_build_left_the_table_in_the_folder_of_the_image(tool: ModuleType) -> None:
    left = json.loads(IMAGE.with_suffix(".size.json").read_text())
    assert left["totals"] == tool.sizes_of(IMAGE)["totals"]
    assert left["limits"] == Elf(IMAGE).limits
    assert all(left["totals"][kind] <= limit for kind, limit in left["limits"].items())


def sizes(**items: dict[str, int]) -> dict[str, Any]:
    return {
        "totals": {"flash": sum(item["flash"] for item in items.values()), "ram": 10, "stack": 20},
        "modules": {"core/a.c": {"flash": 0, "ram": 0, "items": items}},
    }


def test_differences_are_named_largest_first(tool: ModuleType) -> None:
    old = sizes(same={"flash": 10, "ram": 0}, grows={"flash": 10, "ram": 0, "deepest": 8}, goes={"flash": 30, "ram": 4})
    new = sizes(
        same={"flash": 10, "ram": 0}, grows={"flash": 14, "ram": 0, "deepest": 24}, comes={"flash": 0, "ram": 2}
    )
    *changed, totals = tool.differences(old, new)
    assert [line.split() for line in changed] == [
        ["core/a.c", "goes", "flash", "-30,", "ram", "-4"],
        ["core/a.c", "grows", "flash", "+4,", "stack", "+16"],
        ["core/a.c", "comes", "ram", "+2"],
    ]
    assert totals == "flash 24 (-26), ram 10 (+0), stack 20 (+0)"
    assert tool.differences(old, old) == ["flash 50 (+0), ram 10 (+0), stack 20 (+0)"]


@needs_image
def test_over_the_limit_that_the_image_carries_is_exit_1(tmp_path: Path) -> None:
    for suffix in (".elf", ".map"):
        shutil.copy(IMAGE.with_suffix(suffix), tmp_path)
    answer = run(str(with_flash_limit(tmp_path / "firmware.elf", 1000)))
    assert answer.returncode == 1 and "is over its limit of 1000" in answer.stderr


@needs_image
def test_what_cannot_be_compared_is_one_sentence(tmp_path: Path) -> None:
    answer = run(str(IMAGE), "--against", "no-such-commit")
    assert answer.returncode == 2 and answer.stderr.startswith("size_table: git rev-parse failed")
    assert len(answer.stderr.splitlines()) == 1
    shutil.copy(IMAGE, tmp_path)
    answer = run(str(tmp_path / "firmware.elf"))
    assert answer.returncode == 2 and "build the image with: make image" in answer.stderr


@needs_image
def test_without_a_commit_before_there_is_nothing_to_compare(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["size_table", str(IMAGE), "--against", "previous"])
    assert tool.main() == 0
    assert "no commit before this one" in capsys.readouterr().out


@needs_image
def test_a_previous_commit_that_does_not_build_is_reported_only(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def commit(text: str) -> None:
        (tmp_path / "CMakeLists.txt").write_text(text)
        for words in (["add", "-A"], ["-c", "user.name=a", "-c", "user.email=a@example.org", "commit", "-qm", "a"]):
            subprocess.run(["git", "-C", str(tmp_path), *words], check=True)

    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    (tmp_path / ".gitignore").write_text("build/\n")
    commit("message(FATAL_ERROR broken)\n")
    commit("# mended\n")
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["size_table", str(IMAGE), "--against", "previous"])
    assert tool.main() == 0
    assert "nothing to compare sizes with: " in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["size_table", str(IMAGE), "--against", "HEAD~1"])
    assert tool.main() == 2
    assert "does not build here" in capsys.readouterr().err
