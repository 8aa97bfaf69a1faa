"""The C files use each other in one direction: what a file includes never leads back to it."""

from __future__ import annotations

import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

FIRMWARE = Path(__file__).parents[2] / "firmware"


def units() -> dict[str, set[str]]:
    """File without its suffix -> those it includes: a .c and its .h are one."""
    found: dict[str, set[str]] = {}
    for path in sorted(FIRMWARE.rglob("*.[ch]")):
        unit = path.relative_to(FIRMWARE).with_suffix("").as_posix()
        for name in re.findall(r'^#include "(.+)\.h"', path.read_text(encoding="utf-8"), re.MULTILINE):
            beside = path.parent / f"{name}.h"
            public = f"include/{name}" if name.startswith("plumb/") else name
            other = beside.relative_to(FIRMWARE).with_suffix("").as_posix() if beside.exists() else public
            if other != unit:
                found.setdefault(unit, set()).add(other)
    return found


def test_no_file_leads_back_to_itself() -> None:
    try:
        order = list(TopologicalSorter(units()).static_order())
    except CycleError as error:
        raise AssertionError(" -> ".join(reversed(error.args[1]))) from error
    assert len(order) > 60


def test_the_session_knows_its_owners_and_no_owner_knows_the_session() -> None:
    including = {unit for unit, others in units().items() if "link/session" in others}
    assert including <= {"link/requests", "app/loop"} | {unit for unit in including if unit.startswith("ports/native/")}


def test_no_file_declares_what_another_header_offers() -> None:
    """A prototype in a .c file would hide a use from these tests."""
    for path in sorted(FIRMWARE.rglob("*.c")):
        text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        for name in re.findall(r"^(?:extern )?[a-z][\w ]*[ *]((?!__)\w+)\([^{};]*\);", text, re.MULTILINE):
            assert name == "main" or re.search(rf"^\w[\w ]*[ *]{name}\([^;]*?\) \{{", text, re.MULTILINE), (
                path.name,
                name,
            )
