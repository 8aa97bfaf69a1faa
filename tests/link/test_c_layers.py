"""The C files use each other in one direction: what a file includes, or calls, never leads back to it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "firmware"
LINKED = {
    "native": (ROOT / "build" / "native" / "tests" / "c" / "CMakeFiles" / "plumb_board_trapping.dir", "nm"),
    "stm32f103": (ROOT / "build" / "stm32f103" / "CMakeFiles", "arm-none-eabi-gcc-nm"),
}
"""Port -> the folder of the objects of its program, and the tool that lists their names."""


def units() -> dict[str, set[str]]:
    """File without its suffix -> those it includes: a .c and its .h are one."""
    found: dict[str, set[str]] = {}
    for path in sorted(FIRMWARE.rglob("*.[ch]")):
        unit = path.relative_to(FIRMWARE).with_suffix("").as_posix()
        for name in re.findall(r'^#include "(.+)\.h"', path.read_text(encoding="utf-8"), re.MULTILINE):
            header = path.parent / f"{name}.h"
            public = f"include/{name}" if name.startswith("plumb/") else name
            other = header.relative_to(FIRMWARE).with_suffix("").as_posix() if header.exists() else public
            if other != unit:
                found.setdefault(unit, set()).add(other)
    return found


def calls(port: str) -> dict[str, set[str]]:
    """C file -> those whose functions and variables it uses, as the linker sees them."""
    folder, tool = LINKED[port]
    objects = {path.stem: path for path in sorted(folder.rglob("*.c.o*")) if "qemu" not in path.as_posix()}
    owner: dict[str, str] = {}
    wanted: dict[str, set[str]] = {}
    for name, path in objects.items():
        listed = subprocess.run([tool, "-P", path], capture_output=True, text=True, check=True).stdout
        for symbol, kind, *_ in (line.split() for line in listed.splitlines()):
            if kind == "U":
                wanted.setdefault(name, set()).add(symbol)
            elif kind.isupper():
                owner[symbol] = name
    return {name: {owner[one] for one in wanted.get(name, ()) if one in owner} - {name} for name in objects}


def in_order(graph: Mapping[str, set[str]]) -> list[str]:
    """The files, each after those that it uses."""
    try:
        return list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise AssertionError(" -> ".join(reversed(error.args[1]))) from error


def test_no_file_leads_back_to_itself() -> None:
    assert len(in_order(units())) > 60


@pytest.mark.parametrize("port", LINKED)
def test_no_call_leads_back_to_its_file(port: str) -> None:
    used = calls(port)
    order = in_order(used)
    assert len(order) > 50 and "session.c" in used["loop.c"]


def test_the_session_knows_its_owners_and_no_owner_knows_the_session() -> None:
    including = {unit for unit, others in units().items() if "link/session" in others}
    requests = {"link/requests", "link/execution", "link/run_requests", "link/table_requests"}
    loop = {"app/loop", "app/loop_links"}
    assert including <= requests | loop | {unit for unit in including if unit.startswith("ports/native/")}


def test_no_file_declares_what_another_header_offers() -> None:
    """A prototype in a .c file would hide a use from these tests."""
    for path in sorted(FIRMWARE.rglob("*.c")):
        text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        for name in re.findall(r"^(?:extern )?[a-z][\w ]*[ *]((?!__)\w+)\([^{};]*\);", text, re.MULTILINE):
            assert name == "main" or re.search(rf"^\w[\w ]*[ *]{name}\([^;]*?\) \{{", text, re.MULTILINE), (
                path.name,
                name,
            )
